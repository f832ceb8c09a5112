"""The report page where it is read: in a browser, from disk."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from PIL import Image, ImageColor

from harness.files.io import atomic_write
from harness.labels.labels import Labels
from harness.report.page.data import ERROR_COLOURS
from harness.report.thumbnails import Thumbnail, ThumbnailSubject, lines_path, picture_path
from harness.report.thumbnails.writer import picture
from harness.score.reference import Reference
from harness.score.verdicts import ERROR_TYPES
from tests.browser import point_at, requested, set_width, wait_until_drawn
from tests.records import answers, frame_record, labels, score_run, subject_record, target_record

if TYPE_CHECKING:
    from selenium.webdriver import Chrome
    from selenium.webdriver.remote.webelement import WebElement

CUP, CAN = target_record(1, "cup"), target_record(2, "can")
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
"""The verdict of frame 2, whose truth is the cup and whose answer is the dragon."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("a run")
    records = [
        each
        for clip in ("clip", "other")
        for name, given in GIVEN.items()
        for each in answers(given, configuration=name, clip=clip)
    ]
    atomic_write(picture_path(run, "clip", 2), picture(np.full((100, 200, 3), PICTURE_RGB, dtype=np.uint8)))
    atomic_write(lines_path(run, "clip", "one"), msgspec.json.encode(SEEN) + b"\n")
    score_run(run, records, Reference(labels={name: labels(*TRUTH) for name in ("clip", "other")}))
    return run / "report.html"


@pytest.fixture(params=[1280, 390], ids=["wide", "phone"])
def browser(chrome: Chrome, page: Path, request: pytest.FixtureRequest) -> Chrome:
    """The page, freshly opened."""
    chrome.get("about:blank")
    chrome.get_log("browser")
    requested(chrome)
    set_width(chrome, request.param)
    _open(chrome, page)
    return chrome


def _open(browser: Chrome, page: Path, **shown: Any) -> None:
    browser.get(page.as_uri() + ("#" + "&".join(f"{key}={value}" for key, value in shown.items()) if shown else ""))
    wait_until_drawn(browser)


def _press(browser: Chrome, *keys: str) -> None:
    browser.find_element("id", "timeline").send_keys(*keys)


def _wait_for_box(browser: Chrome, text: str) -> str:
    """The text of a frame's box, as soon as it contains this."""
    from selenium.webdriver.support.wait import WebDriverWait

    box = browser.find_element("id", "frame")
    WebDriverWait(browser, 60).until(lambda _: text in box.text, text)
    return box.text


def _wait_until_closed(browser: Chrome) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    WebDriverWait(browser, 60).until(lambda found: not found.find_element("id", "frame").is_displayed())


def _button(browser: Chrome, words: str) -> WebElement:
    """The part of a figure whose label begins with these words, as soon as it is drawn."""
    from selenium.webdriver.support.wait import WebDriverWait

    part = f'[role="button"][aria-label^="{words}"]'
    return WebDriverWait(browser, 60).until(lambda found: found.find_element("css selector", part))


def test_it_asks_nobody_for_anything_complains_of_nothing_and_fits(browser: Chrome, page: Path) -> None:
    for fold in browser.find_elements("css selector", "details:not([open]) > summary"):
        browser.execute_script("arguments[0].click()", fold)
    assert requested(browser) == [page.as_uri()]
    assert browser.get_log("browser") == []
    assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")


def test_the_first_screen_is_the_answer(browser: Chrome) -> None:
    best, baseline, difference, why, step = browser.find_element("id", "verdict").text.split("\n")
    assert best.startswith("Best of 2: it's two, right in 100.0 % ")
    assert "simple rule" in baseline
    assert "one or it's two" in difference
    assert "60.0 points" in difference
    assert why.startswith("2 of 6 wrong frames ")
    assert step.startswith("Next: ")
    rates = [
        _button(browser, f"{name}: FRR {rate} %").get_attribute("aria-label")
        for name, rate in (("one", "40.0"), ("it's two", "100.0"))
    ]
    assert all("n 10," in str(each) for each in rates)
    low = browser.find_element("css selector", "#draw-forest [role=button]").rect
    assert low["y"] + low["height"] < 900


def test_the_keyboard_goes_from_failure_to_failure_round_and_round(browser: Chrome, page: Path) -> None:
    from selenium.webdriver.common.keys import Keys

    assert not browser.find_element("id", "frame").is_displayed()
    for frame, truth, predicted, error_type in (
        (2, "cup", "dragon", "missed"),
        (4, "none", "cup", "false_attention"),
        (6, "cup", "no prediction", "no_subject"),
        (2, "cup", "dragon", "missed"),  # of the other clip
    ):
        _press(browser, "n")
        text = _wait_for_box(browser, f"Frame {frame} – wrong")
        assert f"Truth: {truth}. Predicted: {predicted}." in text
        assert ERROR_TYPES[error_type].lower() in text.lower()
        assert f"frame={frame}" in browser.current_url
        said = str(browser.find_element("id", "timeline").get_attribute("aria-valuetext"))
        assert (
            said
            == f"Frame {frame}, girl, one: wrong: {error_type.replace('_', ' ')}. Truth {truth}, predicted {predicted}."
        )
    _press(browser, "p")
    _wait_for_box(browser, "Frame 6 – wrong")
    _press(browser, Keys.ARROW_DOWN)
    _wait_for_box(browser, "Frame 6 – correct")
    command = browser.find_element("css selector", "#frame code").text
    assert command == f"""vfoa view '{page.parent}' --clip clip --config 'it'"'"'s two' --frame 6 --subject girl"""
    _press(browser, Keys.ESCAPE)
    _wait_until_closed(browser)


@pytest.fixture(scope="module")
def crowded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of two clips, subjects and configurations with five wrong frames; frame numbers are 1 and 2."""
    run, wrong = tmp_path_factory.mktemp("crowded"), set(WRONG)
    records = []
    for clip, name, frame in product(("a", "b"), ("one", "two"), (1, 2)):
        focus = {who: 2 if (name, clip, who, frame) in wrong else 1 for who in ("girl", "boy")}
        subjects = [
            subject_record(who, totals={given: 0.5}, focus=given, track_id=track)
            for track, (who, given) in enumerate(focus.items())
        ]
        records.append(frame_record([CUP, CAN], subjects, frame=frame, clip=clip, configuration=name))
    both = Labels(row for who in ("girl", "boy") for row in labels("cup", "cup", subject=who).ranges)
    score_run(run, records, Reference(labels={"a": both, "b": both}))
    return run / "report.html"


WRONG = (
    ("one", "a", "boy", 1),
    ("one", "a", "girl", 2),
    ("one", "b", "boy", 1),
    ("one", "b", "boy", 2),
    ("two", "a", "girl", 1),
)
"""Configuration, clip, subject and frame of each wrong frame, in the order in which N visits them."""


def _wait_for_place(browser: Chrome, place: tuple[str, str, str, int]) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    canvas = browser.find_element("id", "timeline")
    keys = ("data-config", "data-clip", "data-subject", "data-frame")
    wanted = [str(each) for each in place]
    WebDriverWait(browser, 60).until(lambda _: [canvas.get_attribute(key) for key in keys] == wanted, str(place))


def test_keys_visit_the_wrong_frames_of_all_configurations_clips_and_subjects(chrome: Chrome, crowded: Path) -> None:
    chrome.get("about:blank")
    set_width(chrome, 1280)
    _open(chrome, crowded)
    for place in (*WRONG, *WRONG[:2]):
        _press(chrome, "n")
        _wait_for_place(chrome, place)
    for place in (WRONG[0], *WRONG[::-1]):
        _press(chrome, "p")
        _wait_for_place(chrome, place)
    _press(chrome, "n", "n", "n")  # faster than the page is drawn
    _wait_for_place(chrome, WRONG[3])


def test_keys_stay_in_what_was_selected_in_a_figure(chrome: Chrome, crowded: Path) -> None:
    chrome.get("about:blank")
    set_width(chrome, 1280)
    _open(chrome, crowded)
    _button(chrome, "one: 4 of 8 frames missed").send_keys("\ue007")  # of all clips
    for place in (*WRONG[:4], *WRONG[:1]):
        _wait_for_place(chrome, place)
        _press(chrome, "n")
    chrome.execute_script(
        "arguments[0].dispatchEvent(new MouseEvent('click', {bubbles: true}))",
        _button(chrome, "one: truth cup, answer can: 2 of 4"),  # of the first clip
    )
    for place in (*WRONG[:2], *WRONG[:1]):
        _wait_for_place(chrome, place)
        _press(chrome, "n")
    assert chrome.find_element("css selector", ".chip").text.startswith("N and P: cup answered as can, one, a")
    from_outside = {"clip": "b", "config": "two", "subject": "girl", "frame": 1}
    for key, place in (("n", WRONG[0]), ("p", WRONG[1])):
        chrome.execute_script(
            "location.hash = arguments[0]", "&".join(f"{key}={value}" for key, value in from_outside.items())
        )
        _wait_for_place(chrome, ("two", "b", "girl", 1))
        _press(chrome, key)
        _wait_for_place(chrome, place)


def test_an_address_shows_its_frame(chrome: Chrome, page: Path) -> None:
    chrome.get("about:blank")
    _open(chrome, page, clip="other", config="one", subject="girl", frame=4)
    assert "other, girl, one" in _wait_for_box(chrome, "Frame 4 – wrong: false attention")


def test_pointing_at_a_frame_shows_its_attention_and_a_click_keeps_it(browser: Chrome) -> None:
    point_at(browser, "one", 2).perform()
    _wait_for_box(browser, "Frame 2 – wrong")
    rows = [row.text for row in browser.find_elements("css selector", "#frame tr")]
    assert rows == ["Attention total gaze head", "dragon (predicted) 0.50 0.50 –"]
    point_at(browser, "it's two", 3).click().perform()
    _wait_for_box(browser, "Frame 3 – correct")
    assert "frame=3" in browser.current_url


WRONG_OF_LONG = (*range(400, 410), 777, 1490)


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of 1,500 frames of which twelve are wrong, the last of them without a person."""
    run = tmp_path_factory.mktemp("long")
    given = [{1490: None}.get(frame, "dragon") if frame in WRONG_OF_LONG else "cup" for frame in range(1, 1501)]
    score_run(run, answers(given), Reference(labels={"clip": labels(*["cup"] * 1500)}))
    return run / "report.html"


@pytest.mark.parametrize("width", [1280, 390])
def test_a_wrong_frame_among_1500_is_found_by_keys_clicks_and_the_filter(
    chrome: Chrome, long: Path, width: int
) -> None:
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.wait import WebDriverWait

    chrome.get("about:blank")
    set_width(chrome, width)
    _open(chrome, long)
    for key, frames in (("n", WRONG_OF_LONG), ("p", WRONG_OF_LONG[-2::-1])):
        for frame in frames:
            _press(chrome, key)
            _wait_for_place(chrome, ("one", "clip", "girl", frame))
    _press(chrome, Keys.ARROW_RIGHT, Keys.PAGE_DOWN, Keys.ARROW_LEFT)
    _wait_for_place(chrome, ("one", "clip", "girl", 425))
    point_at(chrome, "one", 777).click().perform()  # its pixel holds others that are right
    _wait_for_place(chrome, ("one", "clip", "girl", 777))
    _wait_for_box(chrome, "Frame 777 – wrong: missed")
    chrome.execute_script("document.getElementById('wrong-frames').open = true")
    links = "#wrong-frames tbody a"
    WebDriverWait(chrome, 60).until(lambda found: len(found.find_elements("css selector", links)) == 12)
    chrome.find_element("css selector", "#wrong-frames input").send_keys("no subject")
    (link,) = chrome.find_elements("css selector", links)
    chrome.execute_script("arguments[0].click()", link)  # the box of the frame shown covers it
    _wait_for_box(chrome, "Frame 1490 – wrong: no subject")


def test_the_canvas_has_the_outcome_of_each_frame(chrome: Chrome, page: Path) -> None:
    chrome.get("about:blank")
    set_width(chrome, 1280)
    _open(chrome, page)
    one, two = (_pixels_of_strip(chrome, name, len(TRUTH)) for name in GIVEN)
    right, wrong = one[:2]
    assert one[2] == two[0] == two[1] == right
    assert len({right, wrong, *one[3:]}) == 5  # three error types, and unscored


ONE_OF_EACH = {
    "correct": (answers(["cup"])[0], "cup"),
    "unscored": (answers(["cup"])[0], "ignore"),
    "no_subject": (frame_record([CUP]), "cup"),
    "no_eyes_3d": (frame_record([CUP], [subject_record("girl", missing="no_eyes_3d")]), "cup"),
    "face_turned_away": (
        frame_record([CUP], [replace(subject_record("girl", missing="no_direction"), no_gaze="face_turned_away")]),
        "cup",
    ),
    "no_direction": (frame_record([CUP], [subject_record("girl", missing="no_direction")]), "cup"),
    "no_answer": (frame_record([CUP], [subject_record("girl", missing="no_answer")]), "cup"),
    "no_object": (frame_record([CUP], [subject_record("girl", missing="no_object")]), "cup"),
    "target_not_segmented": (frame_record([CAN], [subject_record("girl", totals={2: 0.5}, focus=2)]), "cup"),
    "target_without_box": (frame_record([target_record(1, "cup", center=None)], [subject_record("girl")]), "cup"),
    "false_attention": (answers(["cup"])[0], "none"),
    "wrong_subject": (
        frame_record([CUP, target_record(8, "girl")], [subject_record("girl", totals={8: 0.5}, focus=8)]),
        "cup",
    ),
    "no_hit": (frame_record([CUP], [subject_record("girl", totals={1: 0.0})]), "cup"),
    "missed": (frame_record([CUP, CAN], [subject_record("girl", totals={2: 0.5}, focus=2)]), "cup"),
    "outscored": (frame_record([CUP], [subject_record("girl", totals={1: 0.2})]), "cup"),
}
"""For each state of a frame, a record that has it, and the true target."""


@pytest.fixture(scope="module")
def colourful(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of one subject whose frames have one state after the other."""
    run = tmp_path_factory.mktemp("states")
    records = [replace(record, frame=frame) for frame, (record, _) in enumerate(ONE_OF_EACH.values(), start=1)]
    truth = labels(*(target for _, target in ONE_OF_EACH.values()))
    score_run(run, records, Reference(labels={"clip": truth}))
    return run / "report.html"


@pytest.mark.parametrize(("mode", "scheme"), [(0, "light"), (1, "dark")])
def test_every_error_type_has_a_colour_of_its_own_in_all_figures(
    chrome: Chrome, colourful: Path, mode: int, scheme: str
) -> None:
    chrome.get("about:blank")
    set_width(chrome, 1280)
    chrome.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    )
    try:
        _open(chrome, colourful)
        strip = _pixels_of_strip(chrome, "one", len(ONE_OF_EACH))
        parts = chrome.find_elements("css selector", "#draw-errors .part rect")
        keys = chrome.find_elements("css selector", "#draw-errors .swatch")
        bars, swatches = [[_pixel(each) for each in group] for group in (parts, keys)]
        ground = _rgb(chrome.execute_script("return getComputedStyle(document.body).backgroundColor"))
    finally:
        chrome.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    drawn = dict(zip(ONE_OF_EACH, strip, strict=True))
    wrong = [drawn[name] for name in ERROR_TYPES]
    assert wrong == [ImageColor.getrgb(ERROR_COLOURS[name][mode]) for name in ERROR_TYPES]
    assert bars == wrong
    assert swatches == wrong
    assert len({*strip, ground}) == len(ONE_OF_EACH) + 1


def _pixels_of_strip(browser: Chrome, configuration: str, frames: int) -> list[tuple[int, ...]]:
    """The RGB colour of each of a clip's frames in the timeline of a configuration."""
    pixels = browser.execute_async_script(
        """
        const [name, frames, done] = arguments, sheet = document.getElementById("timeline");
        requestAnimationFrame(() => requestAnimationFrame(() => {
          const {left, width, rows} = JSON.parse(sheet.dataset.places), scale = sheet.width / sheet.clientWidth;
          done(Array.from({length: frames}, (_, i) => {
            const [x, y] = [left + (i + .2) * width / frames, rows[name]].map((each) => Math.round(each * scale));
            return [...sheet.getContext("2d").getImageData(x, y, 1, 1).data];
          }));
        }));
        """,
        configuration,
        frames,
    )
    return [tuple(each[:3]) for each in pixels]


def _pixel(part: WebElement) -> tuple[int, ...]:
    """The colour of a part of the page, left of the letter in its middle."""
    with Image.open(io.BytesIO(part.screenshot_as_png)) as picture:
        return picture.convert("RGB").getpixel((3, picture.height // 2))  # type: ignore[return-value]


def _rgb(css: str) -> tuple[int, ...]:
    return tuple(int(each) for each in re.findall(r"\d+", css)[:3])


def test_a_cell_of_the_confusion_leads_to_its_frames_which_n_then_visits(browser: Chrome) -> None:
    browser.execute_script(
        "arguments[0].dispatchEvent(new MouseEvent('click', {bubbles: true}))",
        _button(browser, "one: truth cup, answer dragon: 1 of 3"),
    )
    _wait_for_box(browser, "Frame 2 – wrong: missed")
    assert "cup answered as dragon" in browser.find_element("css selector", ".chip").text
    _press(browser, "n")
    _wait_for_box(browser, "Frame 2 – wrong: missed")


def test_a_point_of_the_forest_and_an_error_type_lead_to_frames(browser: Chrome) -> None:
    for words, frame in (
        ("one on other:", "Frame 2 – wrong: missed"),
        ("one: 2 of 10 frames no subject", "Frame 6 – wrong"),
    ):
        _button(browser, words).send_keys("\ue007")
        _wait_for_box(browser, frame)
    assert "clip=clip" in browser.current_url


def test_the_forest_rounds_rates_and_intervals_as_the_table_does(chrome: Chrome, tmp_path: Path) -> None:
    """1 of 16 is 6.25 %, a tie that Python rounds to 6.2 and JavaScript's toFixed to 6.3."""
    given = ["cup", *["dragon"] * 15]
    records = [record for clip in ("a", "b") for record in answers(given, clip=clip)]
    of_clips = Reference(labels={clip: labels(*["cup"] * 16) for clip in ("a", "b")})
    score_run(tmp_path, records, of_clips)
    set_width(chrome, 1280)
    last = (tmp_path / "frr.md").read_text(encoding="utf-8").partition("| (all) |")[2].split("|")
    _open(chrome, tmp_path / "report.html")
    shown = {element.text for element in chrome.find_elements("css selector", "svg text")}
    assert {f"{last[3].strip()} %", last[4].strip()} <= shown
    assert f"{last[3].strip()} %" == "6.2 %"


def test_tables_are_sorted_and_filtered(chrome: Chrome, page: Path) -> None:
    chrome.get("about:blank")
    set_width(chrome, 1280)
    _open(chrome, page)
    fold = chrome.find_element("id", "wrong-frames")
    chrome.execute_script("arguments[0].open = true", fold)
    chrome.execute_script("document.querySelector('details[data-table=\"0\"]').open = true")
    from selenium.webdriver.support.wait import WebDriverWait

    rows = "details[data-table='0'] tbody tr"
    WebDriverWait(chrome, 60).until(lambda found: found.find_elements("css selector", rows))
    head = next(
        each for each in chrome.find_elements("css selector", "details[data-table='0'] .head") if each.text == "FRR %"
    )
    for expected in (["100.0"] * 3 + ["40.0"] * 3, ["40.0"] * 3 + ["100.0"] * 3):
        chrome.execute_script("arguments[0].click()", head)
        assert [
            each.find_elements("tag name", "td")[3].text for each in chrome.find_elements("css selector", rows)
        ] == expected
    links = fold.find_elements("css selector", "tbody a")
    assert [link.text for link in links] == ["2", "4", "6"]
    chrome.execute_script("arguments[0].click()", links[1])
    _wait_for_box(chrome, "Frame 4 – wrong")


def test_a_wrong_frame_shows_its_picture_with_truth_and_answer_marked(browser: Chrome) -> None:
    _press(browser, "n")
    _wait_for_box(browser, "Frame 2 – wrong")
    thumbnail = browser.find_element("css selector", "#frame svg.thumbnail")
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
    texts = [each.text for each in thumbnail.find_elements("tag name", "text")]
    assert {"✓ truth: cup", "✗ predicted: dragon", "girl", "lamp"} == set(texts)
    dashes = thumbnail.find_element("css selector", "rect.predicted").value_of_css_property("stroke-dasharray")
    assert dashes != "none"
    assert thumbnail.find_element("css selector", "polyline.gaze").get_dom_attribute("points") == "100,15 140,50"
    _press(browser, "n")
    _wait_for_box(browser, "Frame 4 – wrong")
    assert browser.find_elements("css selector", "#frame svg.thumbnail") == []


def _copy(chrome: Chrome, figure: str, *kinds: str) -> None:
    """Copy a figure as each of these kinds; ``window.copied`` are the blobs."""
    from selenium.webdriver.support.wait import WebDriverWait

    chrome.execute_script(
        "window.copied = []; Object.defineProperty(navigator, 'clipboard', {value: {write: async ([item]) => {"
        "window.copied.push(await item.getType(item.types[0]))}}, configurable: true});"
    )
    for kind in kinds:
        button = chrome.find_element("css selector", f'[aria-label="Copy {figure} as {kind}"]')
        chrome.execute_script("arguments[0].click()", button)
    WebDriverWait(chrome, 60).until(lambda found: found.execute_script("return window.copied.length") == len(kinds))


def test_figures_are_copied_as_csv_and_svg_that_stand_alone(chrome: Chrome, page: Path) -> None:
    chrome.get("about:blank")
    _open(chrome, page)
    _copy(chrome, "Over all clips", "CSV", "SVG")
    table, figure = chrome.execute_async_script(
        "Promise.all(window.copied.map((each) => each.text())).then(arguments[0])"
    )
    assert table.splitlines()[0] == "clip,configuration,n,looks,frr,low,high,baseline"
    assert table.splitlines()[1].startswith("(all),one,10,")
    with (page.parent / "frr.csv").open(encoding="utf-8", newline="") as file:
        (row,) = (row for row in csv.DictReader(file) if (row["clip"], row["configuration"]) == ("(all)", "one"))
    shares = [row[name] for name in ("frr", "interval_low", "interval_high")]
    assert table.splitlines()[1].split(",")[4:7] == shares
    assert figure.startswith("<svg")
    assert "var(" not in figure


def test_a_wrong_frame_that_the_page_has_no_room_for_shows_the_picture_of_the_run(
    chrome: Chrome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from selenium.webdriver.support.wait import WebDriverWait

    monkeypatch.setattr("harness.report.write.BUDGET_BYTES", 0)
    run = tmp_path / "a run"
    for frame in (2, 4):
        atomic_write(picture_path(run, "my clip", frame), picture(np.full((100, 200, 3), PICTURE_RGB, dtype=np.uint8)))
    seen = b"".join(msgspec.json.encode(replace(SEEN, frame=frame)) + b"\n" for frame in (2, 4))
    atomic_write(lines_path(run, "my clip", "one"), seen)
    records = answers(GIVEN["one"], configuration="one", clip="my clip")
    score_run(run, records, Reference(labels={"my clip": labels(*TRUTH)}))
    chrome.get("about:blank")
    _open(chrome, run / "report.html", frame=2)
    _wait_for_box(chrome, "Frame 2 – wrong")
    assert chrome.find_elements("css selector", "#frame svg.thumbnail")
    _press(chrome, "n")
    _wait_for_box(chrome, "Frame 4 – wrong")
    (image,) = chrome.find_elements("css selector", "#frame img.thumbnail")
    WebDriverWait(chrome, 60).until(lambda _: image.get_property("naturalWidth") == 200)
    picture_path(run, "my clip", 4).unlink()  # as where the page was sent to somebody
    chrome.get("about:blank")
    _open(chrome, run / "report.html", frame=4)
    _wait_for_box(chrome, "Frame 4 – wrong")
    WebDriverWait(chrome, 60).until(lambda found: not found.find_elements("css selector", "#frame img"))


@pytest.fixture(scope="module")
def many_clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a run of 20 clips, of which the pager shows eight."""
    run = tmp_path_factory.mktemp("many")
    clips = [f"clip {number:02d}" for number in range(20)]
    records = [
        record
        for clip in clips
        for name, said in {"one": ("cup", "dragon"), "two": ("cup", "cup")}.items()
        for record in answers(said, configuration=name, clip=clip)
    ]
    score_run(run, records, Reference(labels={clip: labels("cup", "cup") for clip in clips}))
    return run / "report.html"


def test_copies_of_figures_hold_every_clip_and_the_legend(chrome: Chrome, many_clips: Path) -> None:
    chrome.get("about:blank")
    _open(chrome, many_clips)
    shown = chrome.find_element("css selector", "#draw-forest > :last-child .drawing")
    assert "clip 07" in shown.text
    assert "clip 08" not in shown.text
    _copy(chrome, "By clip", "SVG", "PNG")
    drawing = chrome.execute_async_script(
        "window.copied.find((each) => each.type.startsWith('text')).text().then(arguments[0])"
    )
    texts = [each.text for each in ElementTree.fromstring(drawing).iter("{http://www.w3.org/2000/svg}text")]
    assert [text for text in texts if text and text.startswith("clip ")] == [
        f"clip {number:02d}" for number in range(20)
    ]
    assert {"By clip", "one", "two"} <= {*texts}
    width, height = (float(re.search(rf'{name}="([\d.]+)"', drawing)[1]) for name in ("width", "height"))  # type: ignore[index]
    picture = chrome.execute_async_script(
        "createImageBitmap(window.copied.find((each) => each.type === 'image/png'))"
        ".then(({width, height}) => arguments[0]([width, height]))"
    )
    assert picture == [2 * width, 2 * height]
    assert not chrome.find_elements("css selector", "[style*='visibility: hidden']")


def test_a_print_holds_every_clip_and_says_which_one_a_figure_is_of(chrome: Chrome, many_clips: Path) -> None:
    chrome.get("about:blank")
    _open(chrome, many_clips)
    chrome.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    chrome.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    figure = chrome.find_element("css selector", "#draw-forest > :last-child .drawing")
    assert [f"clip {number:02d}" in figure.text for number in range(20)] == [True] * 20
    for place in ("errors", "timeline", "confusion"):
        chosen = chrome.find_element("css selector", f"#draw-{place} select")
        assert chosen.is_displayed()
        assert chosen.get_attribute("value") == ("-1" if place == "errors" else "0")
    assert not any(each.is_displayed() for each in chrome.find_elements("css selector", "button"))
    chrome.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    chrome.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert "clip 08" not in figure.text


def test_the_oracle_ablation_is_a_waterfall(chrome: Chrome, tmp_path: Path) -> None:
    said = {"one": ("cup", "dragon", "dragon", "cup"), "one+gaze": ("cup", "dragon", "cup", "cup")}
    records = [record for name, words in said.items() for record in answers(words, configuration=name)]
    score_run(tmp_path, records, Reference(labels={"clip": labels(*["cup"] * 4)}))
    _open(chrome, tmp_path / "report.html")
    titles = chrome.find_elements("css selector", "#draw-oracle rect ~ title, #draw-oracle g > title")
    assert [title.get_attribute("textContent") for title in titles] == [
        "as run: FRR 50.0 %",
        "+ true gaze: FRR 75.0 %, +25.0 points",
    ]
