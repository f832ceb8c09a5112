"""The web viewer in a browser: it opens at the frame and the subject that the page beside it asks for."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from PIL import Image
from rerun.chunk import RrdReader
from starlette.applications import Starlette

from harness.record.composed import RecordedClip, find_clips, find_recordings
from harness.record.viewer import page_files, web_viewer_files
from harness.record.web_app import failures_routes, site
from harness.report.page.data import Served
from harness.report.page.render import render_page
from harness.report.write import run_tables
from harness.score.reference import Reference
from harness.score.verdicts import Verdict
from tests.browser import WEBGL, chromium, let_out, point_at, requested, set_width, wait_for
from tests.harness.record.conftest import ANN, CONFIGURATION, Recorded
from tests.records import labels, run_manifest, scored_records
from tests.web import running

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

LOADED_S = 180.0
SIZE_PX = (500, 400)
"""Of windows: software draws their pixels."""
LEFT_VIEW = (57, 92, 186, 124)
"""The place of the left image in the viewer in a window of that size: x, y, width, height in pixels."""


@pytest.fixture(scope="module")
def drawing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    """A browser that draws the viewer, which takes the processor seconds for each time that it is loaded."""
    with chromium(tmp_path_factory.mktemp("profile"), WEBGL) as browser:
        yield browser


@pytest.fixture
def browser(drawing: Chrome) -> Iterator[Chrome]:
    """The browser with one empty window of few pixels, and without earlier requests."""
    (window,) = drawing.window_handles
    requested(drawing)
    set_width(drawing, *SIZE_PX)
    yield drawing
    for other in {*drawing.window_handles} - {window}:
        drawing.switch_to.window(other)
        drawing.close()
    drawing.switch_to.window(window)
    drawing.get("about:blank")


@pytest.fixture(scope="module")
def viewer_files() -> dict[str, bytes]:
    return web_viewer_files()


BEN = "Ben"
"""The first tab of the recordings: whoever asks for nobody sees him."""


@pytest.fixture
def clip(frames: list[Any], record_run: Callable[..., Any]) -> RecordedClip:
    return _two_tabs(record_run(frames))


def _two_tabs(recorded: Recorded) -> RecordedClip:
    return replace(find_clips(recorded.run, None, None)[0], subjects=(BEN, ANN))


@pytest.fixture
def report(frames: list[Any], clip: RecordedClip, viewer_files: dict[str, bytes]) -> Iterator[str]:
    """The address of a report on four frames, the last one wrong."""
    recording = clip.compose()
    truth = labels(*["red cup"] * 14, subject=ANN)
    records = (shown.record for shown in frames)
    scores, attention, _ = scored_records(records, Reference(labels={"clip": truth}))
    served = Served(run="/a/run", recordings={("clip", "two cones"): recording.name})
    page = render_page(scores, run_tables(scores), attention, run_manifest(scores.clips), served=served)
    with running(site({recording.name: recording}, viewer_files, page=lambda where: page)) as server:
        yield server.address


def _click(browser: Chrome, frame: int) -> None:
    point_at(browser, "two cones", frame).click().perform()


def _shows(frame: int) -> bytes:
    """The bytes of the viewer's state at that frame: Protocol Buffers with timeline "frame", a sequence, its time."""
    return b"\n\x05frame\x10\x01\x1a\x02\x08" + bytes([frame])


def _picture(browser: Chrome) -> np.ndarray:
    """The canvas, at the bottom of the page, (H, W, 3); asked for again where the driver waits too briefly."""
    from selenium.common.exceptions import TimeoutException

    deadline = time.monotonic() + LOADED_S
    while True:
        try:
            png = browser.get_screenshot_as_png()
        except TimeoutException:
            if time.monotonic() > deadline:
                raise
        else:
            return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[-SIZE_PX[1] :]


def _wait_for(browser: Chrome, frame: int) -> np.ndarray:
    """The viewer's picture at that frame, once it stands still; (H, W, 3)."""
    deadline = time.monotonic() + LOADED_S
    now = before = None
    while now is None or before is None or (now != before).any():
        assert time.monotonic() < deadline, f"the viewer did not come to frame {frame}: {browser.current_url}"
        time.sleep(0.3)
        before, now = now, _picture(browser) if _shows(frame) in _state(browser) else None
    return now


def _assert_picture(browser: Chrome, frame: int, frames: list[Any]) -> None:
    """The left image that the viewer draws, which is noise, is like the one of that frame and unlike any other's."""
    deadline, alike = time.monotonic() + LOADED_S, {frame: 0.0}
    while alike[frame] <= 0.5:  # a slow machine stands still before it has decoded the pictures
        assert time.monotonic() < deadline, alike
        shown = _wait_for(browser, frame)
        alike = {each.frame.index: _likeness(shown, each.frame.left) for each in frames}
    assert max(likeness for other, likeness in alike.items() if other != frame) < 0.3


_SAMPLER = """
window.seen = [];
setInterval(() => {
  if (!window._handle) return;
  const fields = fieldsOf(window._handle.viewer_state());
  seen.push([getComputedStyle(canvas).opacity === "0", fields.has(RECORDINGS), fields.has(LOADING)]);
}, 100);
"""
"""Samples of what the page shows: whether the canvas is covered, and whether recordings are there and still loading."""


def _samples(browser: Chrome) -> list[list[bool]]:
    return list(browser.execute_script("return window.seen || []"))


def _state(browser: Chrome) -> bytes:
    """The viewer's own account of what it shows; empty until it has started."""
    return bytes(browser.execute_script("return window._handle ? Array.from(window._handle.viewer_state()) : []"))


def test_a_click_on_a_frame_opens_the_recording_at_that_frame(
    browser: Chrome, report: str, frames: list[Any], tmp_path: Path
) -> None:
    from selenium.webdriver.common.keys import Keys

    browser.get(report)
    page = browser.current_window_handle
    _click(browser, 14)
    (viewer,) = set(browser.window_handles) - {page}
    browser.switch_to.window(viewer)
    set_width(browser, *SIZE_PX)
    _assert_picture(browser, 14, frames)
    assert _tabs_in_front(browser, tmp_path) == {ANN}
    assert all(url.startswith("http://127.0.0.1:") for url in let_out(browser))
    browser.execute_script("window.isTheFirst = true")
    browser.switch_to.window(page)
    box = browser.find_element("id", "frame").text
    assert "Frame 14 – wrong" in box
    assert f"vfoa view /a/run --clip clip --config 'two cones' --frame 14 --subject '{ANN}'" in box
    link = browser.find_element("link text", "The label is wrong").get_attribute("href")
    back = urlsplit(browser.current_url)
    assert parse_qs(urlsplit(link).query) == {
        "clip": ["clip"],
        "subject": [ANN],
        "frame": ["14"],
        "back": [f"/#{back.fragment}"],
    }
    browser.find_element("id", "timeline").send_keys("p")
    link = browser.find_element("link text", "Open the recording at this frame").get_attribute("href")
    asked = parse_qs(urlsplit(link).query)
    assert (asked["subject"], asked["frame"]) == ([ANN], ["13"])
    browser.switch_to.window(viewer)
    _wait_for(browser, 13)  # it followed
    browser.switch_to.window(page)
    browser.find_element("id", "timeline").send_keys(Keys.ARROW_LEFT, Keys.ENTER)
    assert set(browser.window_handles) == {page, viewer}
    browser.switch_to.window(viewer)
    _wait_for(browser, 12)
    assert _tabs_in_front(browser, tmp_path) == {ANN}
    assert browser.execute_script("return window.isTheFirst")  # without loading the viewer again


def _tabs_in_front(browser: Chrome, scratch: Path) -> set[str]:
    """The subjects whose tab is active in the layout that the viewer has now; none while it has no layout."""
    (scratch / "now.rbl").write_bytes(
        bytes(browser.execute_script("return Array.from(window._handle.save_blueprint())"))
    )
    if not (scratch / "now.rbl").stat().st_size:
        return set()
    reader = RrdReader(scratch / "now.rbl")
    containers: dict[str, dict[str, str]] = {}
    for store in reader.blueprints():
        for chunk in reader.stream(store=store):
            batch = chunk.to_record_batch()
            for component in {"ContainerBlueprint:display_name", "ContainerBlueprint:active_tab"} & {
                *batch.schema.names
            }:
                values = batch.column(component).to_pylist()[-1]
                containers.setdefault(chunk.entity_path.lstrip("/"), {})[component] = values[0] if values else ""
    active = {
        container.get("ContainerBlueprint:active_tab", "") for container in containers.values()
    } & containers.keys()
    return {containers[path]["ContainerBlueprint:display_name"] for path in active}


def _failures(clip: RecordedClip, files: dict[str, bytes]) -> Starlette:
    """The page of three failures, of Ann and of Ben, beside a viewer of these files."""
    told = {"truth": "red cup", "predicted": "book#4", "outcome": "wrong"}
    wrong = [
        Verdict(clip="clip", configuration=CONFIGURATION, frame=frame, subject=subject, error_type=error_type, **told)
        for frame, subject, error_type in ((10, ANN, "missed"), (11, BEN, "outscored"), (14, BEN, "missed"))
    ]
    recording = clip.compose()
    more = failures_routes(lambda: wrong, {("clip", CONFIGURATION): recording})
    return site({recording.name: recording}, files, more=more)


def test_a_page_beside_a_viewer_covers_a_recording_until_it_is_whole_and_steps_from_failure_to_failure(
    browser: Chrome, frames: list[Any], record_run: Callable[..., Any], viewer_files: dict[str, bytes], tmp_path: Path
) -> None:
    """Of JPEG images; the test above draws those of a video."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.keys import Keys

    def press(key: str) -> None:
        ActionChains(browser).send_keys(key).perform()

    def after_tab() -> str | None:
        press(Keys.TAB)
        return browser.switch_to.active_element.get_attribute("id")

    def shows(frame: int, subject: str, place: str) -> None:
        wait_for(lambda: _shows(frame) in _state(browser), at_most_s=LOADED_S, every_s=0.2)
        wait_for(lambda: _tabs_in_front(browser, tmp_path) == {subject}, at_most_s=LOADED_S, every_s=0.2)
        assert browser.find_element("id", "place").text == place
        assert browser.execute_script("return frameShown()") == str(frame)

    clip = _two_tabs(record_run(frames, jpeg=True))
    set_width(browser, SIZE_PX[0], round(SIZE_PX[1] / 0.6))  # the list is above, 40 % of the page
    sampler = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": _SAMPLER})
    with running(_failures(clip, viewer_files)) as server:
        browser.get(server.address)
        wait_for(lambda: _samples(browser)[-1:] == [[False, True, False]], at_most_s=LOADED_S, every_s=0.2)
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", sampler)
        first, samples = _picture(browser), _samples(browser)
        assert [True, True, False] in samples
        assert [False, True, True] not in samples  # what loads is never seen
        changed = np.abs(np.subtract(first.mean(axis=2), _wait_for(browser, 10).mean(axis=2))) > 40
        assert changed.mean() < 0.25  # the same panes in the same places
        _assert_picture(browser, 10, frames)
        shows(10, ANN, "1 of 3")
        press("n")  # nothing was clicked: the canvas has the focus
        shows(11, BEN, "2 of 3")
        browser.find_element("id", "next").click()
        shows(14, BEN, "3 of 3")
        ActionChains(browser).click(browser.find_element("id", "canvas")).perform()
        press("P")
        shows(11, BEN, "2 of 3")
        assert {"previous", "next"} <= {after_tab() for _ in range(6)}  # the canvas does not keep the focus
        assert len(browser.window_handles) == 1
        assert all(url.startswith("http://127.0.0.1:") for url in let_out(browser))


def test_failures_of_one_type_or_subject_are_chosen(chrome: Chrome, clip: RecordedClip) -> None:
    from selenium.webdriver.support.select import Select

    with running(_failures(clip, page_files())) as server:

        def shows(frame: int, place: str) -> None:
            wait_for(lambda: chrome.find_element("id", "place").text == place)
            assert parse_qs(urlsplit(chrome.current_url).fragment)["frame"] == [str(frame)]

        def choose(what: str, value: str) -> None:
            Select(chrome.find_element("name", what)).select_by_value(value)

        chrome.get(server.address)
        shows(10, "1 of 3")
        choose("error_type", "missed")
        chrome.find_element("id", "next").click()
        shows(14, "2 of 2")
        choose("error_type", "")
        choose("subject", ANN)
        shows(10, "1 of 1")


def test_the_address_of_the_page_names_the_wrong_frame(chrome: Chrome, clip: RecordedClip) -> None:
    browser = chrome
    with running(_failures(clip, page_files())) as server:

        def shows(place: str) -> None:
            wait_for(lambda: browser.find_element("id", "place").text == place)

        browser.get(server.address)
        shows("1 of 3")
        browser.find_element("id", "next").click()
        shows("2 of 3")
        address = browser.current_url
        named = {"clip": ["clip"], "configuration": [CONFIGURATION], "subject": [BEN], "frame": ["11"]}
        assert parse_qs(urlsplit(address).fragment) == named
        for opened, place in ((address, "2 of 3"), (address.replace("frame=11", "frame=14"), "3 of 3")):
            browser.get("about:blank")
            browser.get(opened)
            shows(place)
        browser.get("about:blank")
        browser.get(address.replace("frame=11", "frame=10"))  # Ben is right there
        wait_for(lambda: "frame 10" in browser.find_element("id", "place").text)
        assert not browser.find_elements("css selector", "[aria-current]")
        browser.find_element("id", "next").click()
        shows("1 of 3")


@pytest.mark.parametrize(
    ("jpeg", "decodes", "warns"), [(False, "false", True), (False, "true", False), (True, "false", False)]
)
def test_a_browser_that_does_not_decode_the_video_says_which_setting_helps(
    frames: list[Any], record_run: Callable[..., Any], chrome: Chrome, jpeg: bool, decodes: str, warns: bool
) -> None:
    (recording,) = find_recordings(record_run(frames, jpeg=jpeg).run, None, None)
    stub = f"window.VideoDecoder = {{isConfigSupported: async ({{codec}}) => ({{supported: {decodes}}})}};"
    with running(site({recording.name: recording}, page_files())) as server:
        added = chrome.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": stub})
        chrome.get(server.address)
        chrome.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)
        chrome.execute_async_script("warnOfVideo(asked.get('codec'), () => true).then(arguments[0])")
        message = chrome.find_element("id", "warned")
        assert message.is_displayed() == warns
        assert "--recording jpeg" in str(message.get_attribute("textContent"))


def _likeness(picture: np.ndarray, left: np.ndarray) -> float:
    """The correlation of a left image with the place in the viewer where it is drawn, free of what is drawn over it."""
    x, y, width, height = LEFT_VIEW
    drawn = picture[y : y + height, x : x + width].mean(axis=2)
    expected = np.asarray(Image.fromarray(left).resize((width, height), Image.Resampling.NEAREST)).mean(axis=2)
    bottom = slice(int(0.7 * height), None)
    return float(np.corrcoef(drawn[bottom].ravel(), expected[bottom].ravel())[0, 1])
