"""A served report in a browser: a click on a frame opens the recording at that frame."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from PIL import Image

from harness.record.composed import find_clips
from harness.record.web_app import site
from harness.record.web_viewer import web_viewer_files
from harness.report.page.attention_log import AttentionLog
from harness.report.page.data import Served
from harness.report.page.render import render_page
from harness.score.reference import Reference
from harness.score.score import score
from tests.browser import WEBGL, chromium, let_out, point_at, set_width
from tests.harness.record.conftest import ANN
from tests.records import labels
from tests.web import running

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

LOADED_S = 180.0
LEFT_VIEW = (128, 64, 211, 141)
"""The place of the left image in the viewer, in a window of this test's size: x, y, width, height in pixels."""


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Chrome]:
    with chromium(tmp_path / "profile", WEBGL) as browser:
        set_width(browser, 900, 600)
        yield browser


@pytest.fixture
def report(frames: list[Any], record_run: Callable[..., Any]) -> Iterator[str]:
    """The address of a report on four frames, the last one wrong."""
    recording = find_clips(record_run(frames).run, None, None)[0].compose()
    attention = AttentionLog()
    truth = labels(*["red cup"] * 14, subject=ANN)
    scores = score(attention.watch(shown.record for shown in frames), Reference(labels={"clip": truth}))
    served = Served(run="/a/run", recordings={("clip", "two cones"): recording.name})
    page = render_page(scores, attention, served=served)
    with running(site({recording.name: recording}, web_viewer_files(), page=lambda: page)) as server:
        yield server.address


def _click(browser: Chrome, frame: int) -> None:
    point_at(browser, "two cones", frame).click().perform()


def _shows(frame: int) -> bytes:
    """The bytes of the viewer's state at that frame: Protocol Buffers with timeline "frame", a sequence, its time."""
    return b"\n\x05frame\x10\x01\x1a\x02\x08" + bytes([frame])


def _wait_for(browser: Chrome, frame: int) -> np.ndarray:
    """The viewer's picture at that frame, once it stands still; (H, W, 3)."""
    from selenium.common.exceptions import TimeoutException

    deadline = time.monotonic() + LOADED_S
    now = before = b""
    while not now or now != before:
        assert time.monotonic() < deadline, f"the viewer did not come to frame {frame}: {browser.current_url}"
        time.sleep(0.5)
        before = now
        with suppress(TimeoutException):  # a slow machine draws for longer than the driver waits
            now = browser.get_screenshot_as_png() if _shows(frame) in _state(browser) else b""
    return np.asarray(Image.open(io.BytesIO(now)).convert("RGB"))


def _state(browser: Chrome) -> bytes:
    """The viewer's own account of what it shows; empty until it has started."""
    return bytes(browser.execute_script("return window._handle ? Array.from(window._handle.viewer_state()) : []"))


def test_a_click_on_a_frame_opens_the_recording_at_that_frame(browser: Chrome, report: str, frames: list[Any]) -> None:
    browser.get(report)
    page = browser.current_window_handle
    _click(browser, 14)
    (viewer,) = set(browser.window_handles) - {page}
    browser.switch_to.window(viewer)
    shown = _wait_for(browser, 14)
    # the left images are noise: the picture is like its own frame's and unlike any other's
    alike = {each.frame.index: _likeness(shown, each.frame.left) for each in frames}
    assert alike[14] > 0.5
    assert max(value for frame, value in alike.items() if frame != 14) < 0.3
    assert all(url.startswith("http://127.0.0.1:") for url in let_out(browser))
    browser.switch_to.window(page)
    box = browser.find_element("id", "frame").text
    assert "Frame 14 – wrong" in box
    assert "vfoa view /a/run --clip clip --config 'two cones' --frame 14" in box
    link = browser.find_element("link text", "The label is wrong").get_attribute("href")
    assert parse_qs(urlsplit(link).query) == {"clip": ["clip"], "subject": [ANN], "frame": ["14"]}
    _click(browser, 10)
    assert set(browser.window_handles) == {page, viewer}


def _likeness(picture: np.ndarray, left: np.ndarray) -> float:
    """The correlation of a left image with the place in the viewer where it is drawn, free of what is drawn over it."""
    x, y, width, height = LEFT_VIEW
    drawn = picture[y : y + height, x : x + width].mean(axis=2)
    expected = np.asarray(Image.fromarray(left).resize((width, height), Image.Resampling.NEAREST)).mean(axis=2)
    bottom = slice(int(0.7 * height), None)
    return float(np.corrcoef(drawn[bottom].ravel(), expected[bottom].ravel())[0, 1])
