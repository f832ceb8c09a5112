"""The report page where it is read: in a browser, from disk."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pytest
from PIL import Image

from harness.files import atomic_write
from harness.report.thumbnails import Thumbnail, ThumbnailSubject, lines_path, picture_path
from harness.report.thumbnails.writer import picture
from harness.report.write import score_run
from harness.run.results import to_line
from harness.score.reference import Reference
from harness.score.verdicts import ERROR_TYPES
from tests.browser import chromium, requested, set_width
from tests.records import answers, labels

if TYPE_CHECKING:
    from selenium.webdriver import Chrome
    from selenium.webdriver.remote.webelement import WebElement

TRUTH = ("cup", "cup", "dragon", "none", "ignore", "cup")
GIVEN = {
    "one": ("cup", "dragon", "dragon", "cup", "cup", None),
    "it's two": ("cup", "cup", "dragon", "none", "cup", "cup"),
}
PICTURE_RGB = (200, 40, 160)
SEEN = Thumbnail(
    frame=2,
    size=(200, 100),
    boxes=[(1, "cup", (20, 30, 60, 70)), (2, "dragon", (120, 30, 160, 70)), (3, "lamp", (180, 10, 190, 30))],
    subjects=[ThumbnailSubject(name="girl", head=(90, 5, 110, 25), focus=2, lines=[("gaze", [100, 15, 140, 50])])],
)
"""What was seen in frame 2, where the truth is the cup and the answer the dragon."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("a run")
    records = [each for name, given in GIVEN.items() for each in answers(given, configuration=name)]
    (run / "results.jsonl").write_text("".join(map(to_line, records)), encoding="utf-8")
    atomic_write(picture_path(run, "clip", 2), picture(np.full((100, 200, 3), PICTURE_RGB, dtype=np.uint8)))
    atomic_write(lines_path(run, "clip", "one"), msgspec.json.encode(SEEN) + b"\n")
    score_run(run / "results.jsonl", Reference(labels={"clip": labels(*TRUTH)}))
    return run / "report.html"


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    with chromium(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.fixture(params=[1280, 390], ids=["wide", "phone"])
def browser(session: Chrome, page: Path, request: pytest.FixtureRequest) -> Chrome:
    """The page, freshly opened."""
    requested(session)
    set_width(session, request.param)
    session.get(page.as_uri())
    return session


def _cell(browser: Chrome, config: str, frame: int) -> WebElement:
    return browser.find_element("css selector", f'[data-clip="clip"][data-config="{config}"][data-frame="{frame}"]')


def _box(browser: Chrome) -> WebElement:
    return browser.find_element("id", "frame")


def test_it_asks_nobody_for_anything_and_complains_of_nothing(browser: Chrome, page: Path) -> None:
    assert requested(browser) == [page.as_uri()]
    assert browser.get_log("browser") == []


def test_it_is_no_wider_than_the_screen(browser: Chrome) -> None:
    assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")


def test_every_frame_of_every_configuration_has_a_cell_that_says_its_outcome_in_words(browser: Chrome) -> None:
    cells = browser.find_elements("css selector", "#strips .cell")
    assert [(each.get_attribute("data-config"), each.get_attribute("data-frame")) for each in cells] == [
        (name, str(frame)) for name in GIVEN for frame in range(1, 7)
    ]
    said = [str(each.get_attribute("aria-label")) for each in cells[:6]]
    assert [each.split(", ")[1] for each in said] == [
        *("correct", "wrong: missed", "correct", "wrong: false attention", "unscored", "wrong: no subject")
    ]
    assert [each.text for each in cells[:6]] == ["", "M", "", "F", "·", "S"]


def test_the_keyboard_goes_from_failure_to_failure_and_shows_each(browser: Chrome, page: Path) -> None:
    from selenium.webdriver.common.keys import Keys

    assert not _box(browser).is_displayed()
    browser.execute_script("arguments[0].focus()", _cell(browser, "one", 1))
    for frame, truth, predicted, error_type in (
        (2, "cup", "dragon", "missed"),
        (4, "none", "cup", "false_attention"),
        (6, "cup", "no prediction", "no_subject"),
    ):
        browser.switch_to.active_element.send_keys("n")
        assert browser.switch_to.active_element.get_attribute("data-frame") == str(frame)
        text = _box(browser).text
        assert f"Frame {frame} – wrong" in text
        assert f"Truth: {truth}. Predicted: {predicted}." in text
        assert ERROR_TYPES[error_type].lower() in text.lower()
    browser.switch_to.active_element.send_keys(Keys.ARROW_DOWN)
    assert "Frame 6 – correct" in _box(browser).text
    command = _box(browser).find_element("tag name", "code").text
    assert command == f"""vfoa view '{page.parent}' --clip clip --config 'it'"'"'s two' --frame 6"""
    browser.switch_to.active_element.send_keys(Keys.ESCAPE)
    assert not _box(browser).is_displayed()


def test_pointing_at_a_cell_shows_the_attention_of_its_frame(browser: Chrome) -> None:
    from selenium.webdriver import ActionChains

    cell = _cell(browser, "one", 2)
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", cell)
    ActionChains(browser).move_to_element(cell).perform()
    rows = _box(browser).find_elements("css selector", "tr")
    assert [row.text for row in rows] == ["Attention total gaze head", "dragon (predicted) 0.500 0.500 –"]


def test_a_wrong_cell_shows_its_frame_with_truth_and_answer_marked(browser: Chrome) -> None:
    browser.execute_script("arguments[0].focus()", _cell(browser, "one", 2))
    thumbnail = _box(browser).find_element("css selector", "svg.thumbnail")
    browser.execute_script("arguments[0].scrollIntoView()", thumbnail)
    shown = np.asarray(Image.open(io.BytesIO(thumbnail.screenshot_as_png)).convert("RGB"))
    height, width = shown.shape[:2]
    assert width / height == pytest.approx(2, rel=0.02)
    corner = shown[int(0.9 * height), int(0.3 * width)]
    assert np.abs(corner.astype(int) - PICTURE_RGB).max() < 12  # lossy, but it is that picture
    marked = {
        role: [
            thumbnail.find_element("css selector", f"rect.{role}").get_dom_attribute(name) for name in ("x", "width")
        ]
        for role in ("truth", "predicted", "face", "other")
    }
    assert marked == {"truth": ["20", "40"], "predicted": ["120", "40"], "face": ["90", "20"], "other": ["180", "10"]}
    words = [each.text for each in thumbnail.find_elements("tag name", "text")]
    assert {"✓ truth: cup", "✗ predicted: dragon", "girl", "lamp"} == set(words)
    dashes = thumbnail.find_element("css selector", "rect.predicted").value_of_css_property("stroke-dasharray")
    assert dashes != "none"
    assert thumbnail.find_element("css selector", "polyline.gaze").get_dom_attribute("points") == "100,15 140,50"


def test_a_cell_without_a_picture_has_none(browser: Chrome) -> None:
    for config, frame in (("one", 4), ("it's two", 2)):
        browser.execute_script("arguments[0].focus()", _cell(browser, config, frame))
        assert _box(browser).find_elements("css selector", "svg.thumbnail") == []


def test_a_strip_is_one_stop_of_the_tab_key(browser: Chrome) -> None:
    stops = browser.find_elements("css selector", '#strips .cell[tabindex="0"]')
    assert [each.get_attribute("data-config") for each in stops] == list(GIVEN)


def test_curves_are_drawn_over_the_true_targets(browser: Chrome) -> None:
    plots = browser.find_elements("css selector", ".plot")
    assert len(plots) == len(GIVEN)
    bands = [each.get_attribute("title") for each in plots[0].find_elements("tag name", "i")]
    assert bands == ["cup", "dragon", "none", "ignore", "cup"]
    assert all(plot.find_elements("tag name", "polyline") for plot in plots)
