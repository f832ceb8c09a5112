"""A whole clip labelled in a browser by keys alone, and nothing lost by undo, reload or a killed server."""

from __future__ import annotations

import os
import signal
import tomllib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import tomlkit

from harness.clips.manifest import load_manifest
from harness.labels.files import format_annotations
from harness.labels.labels import IGNORED
from tests.annotating import (
    LOOKS_AROUND,
    MANIFEST,
    serve,
    served_by_the_program,
    shown,
    true_labels,
)
from tests.browser import wait_for
from tests.disk import moving_picture, share_rendered_frames, write_text, write_video
from tests.repository import REPOSITORY

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

KEYS = {"laptop": "1", "mug": "2", "book": "3", "bottle": "4", "vase": "5", "none": "n", "ignore": "i"}


CLOCK = "window.vfoaClock = 0; performance.now = () => window.vfoaClock;"
"""The time stands still until the test sets it, so that playing is where the test has to press a key."""
LONG_KEYS = {"cup": "1", "book": "2", "ann": "3", "ben": "4", "none": "n", "ignore": "i"}


class Keyboard:
    """Presses keys in the page, and counts them."""

    def __init__(self, browser: Chrome) -> None:
        self._browser, self.presses = browser, 0

    def press(self, *keys: str) -> None:
        from selenium.webdriver import ActionChains

        for key in keys:
            ActionChains(self._browser).send_keys(key).perform()
            self.presses += 1


@pytest.fixture
def studio(tmp_path: Path) -> Path:
    """A working directory with a studio clip that nobody has labelled yet."""
    document = tomllib.loads((REPOSITORY / "datasets" / "studio_table.toml").read_text())
    document |= {"name": "tabletop", "source": LOOKS_AROUND.model_dump()}
    share_rendered_frames(tmp_path / "cache")
    return write_text(tmp_path / "datasets" / "tabletop.toml", tomlkit.dumps(document))


def test_a_clip_is_labelled_while_it_plays_and_survives_all_that_can_happen(browser: Chrome, studio: Path) -> None:
    clip = load_manifest(str(studio)).open()
    truth = true_labels(clip, clip.frames)
    looked_at = [each.label.target for each in truth.ranges if each.label.target != IGNORED]
    assert len(clip.frames) == 60
    assert sum(one != other for one, other in pairwise(looked_at)) == 6
    keyboard = Keyboard(browser)
    file = studio.parents[1] / "annotations" / "tabletop.csv"

    with serve(clip=str(studio)) as page:
        browser.get(page.address)
        wait_for(lambda: shown(browser) == 1)
        browser.execute_script(CLOCK)
        keyboard.press(KEYS[truth.ranges[0].label.target], " ")
        for each in truth.ranges[1:]:
            _play_to(browser, each.first_frame, clip.rate_hz)
            wait_for(lambda frame=each.first_frame: shown(browser) == frame)
            keyboard.press(KEYS[each.label.target])
        _play_to(browser, 60, clip.rate_hz)
        wait_for(lambda: shown(browser) == 60)
        assert keyboard.presses <= 20
        wait_for(lambda: file.exists() and file.read_text() == format_annotations(truth))
        wait_for(lambda: "60 of 60 labelled (100 %)" in browser.find_element("id", "progress").text)
        assert browser.find_element("id", "unlabelled").text == "anna: all labelled"

        # undo and redo, over a reload
        keyboard.press("z")
        wait_for(lambda: format_annotations(truth) != file.read_text())
        browser.refresh()
        wait_for(lambda: shown(browser) is not None)
        keyboard.press("y")
        wait_for(lambda: file.read_text() == format_annotations(truth))

    # killed in mid-work: what was said is there, what is said meanwhile is kept and sent again, all can be undone
    with served_by_the_program(studio.parents[1], "tabletop") as (process, address):
        browser.get(address)
        wait_for(lambda: shown(browser) == 1)
        keyboard.press(KEYS["none"])
        wait_for(lambda: f"1,{truth.ranges[0].last_frame},anna,none," in file.read_text())
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        keyboard.press(KEYS["vase"])
        wait_for(lambda: "What you do is kept here" in browser.find_element("id", "notice").text)
    with served_by_the_program(studio.parents[1], "tabletop") as (process, again):
        assert again == address
        wait_for(lambda: f"1,{truth.ranges[0].last_frame},anna,vase," in file.read_text())
        wait_for(lambda: not browser.find_element("id", "notice").is_displayed())
        wait_for(lambda: "anna: vase" in browser.find_element("id", "label").text)
        keyboard.press("z", "z")
        wait_for(lambda: file.read_text() == format_annotations(truth))
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 0


def test_no_press_of_fast_hands_is_lost_or_misplaced_and_a_killed_server_changes_nothing(
    browser: Chrome, tmp_path: Path
) -> None:
    """Two subjects, faster than fifteen presses a second, with a server that is killed in between."""
    from selenium.webdriver import ActionChains

    frames = 80
    for side, first in (("left", 0), ("right", 1000)):
        write_video(tmp_path / "pairs" / f"{side}.mkv", [moving_picture(first + number) for number in range(frames)])
    text = MANIFEST.replace('"left"', '"left.mkv"\nlayout = "videos"').replace('"right"', '"right.mkv"')
    manifest = load_manifest(str(write_text(tmp_path / "datasets" / "noise.toml", text)))
    random = np.random.default_rng(7)
    changes = {
        name: {0, *random.choice(np.arange(1, frames), 24, replace=False).tolist()} for name in manifest.subjects
    }
    truth: dict[str, list[str]] = {name: [] for name in manifest.subjects}
    presses: list[str] = []
    for name, found in truth.items():
        for at in range(frames):
            others = [each for each in LONG_KEYS if each not in (name, *found[-1:])]
            found.append(str(random.choice(others)) if at in changes[name] else found[-1])
            presses += ["\ue014"] * (at > 0) + [LONG_KEYS[found[-1]]] * (at in changes[name])
        presses += ["s"] * (name == "ann")
    third = len(presses) // 3

    def press(keys: Sequence[str]) -> None:
        for start in range(0, len(keys), 50):
            actions = ActionChains(browser, duration=0)
            for key in keys[start : start + 50]:
                actions.send_keys(key)
            actions.perform()

    file = tmp_path / "annotations" / "noise.csv"
    with served_by_the_program(tmp_path, "noise") as (process, address):
        browser.get(address)  # the first presses come before the first frame
        press(presses[:third])
        wait_for(file.exists, at_most_s=600)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        press(presses[third : 2 * third])
    with served_by_the_program(tmp_path, "noise") as (process, _):
        press(presses[2 * third :])
        is_settled = "return document.body.getAttribute('aria-busy') === 'false'"
        wait_for(lambda: browser.execute_script(is_settled), at_most_s=900)  # 200 presses on a slow computer
        labels = manifest.read(file, None)
        for name, found in truth.items():
            written = [label.target for at in range(frames) if (label := labels.at(at, name))]
            assert written == found
        assert browser.find_element("id", "unlabelled").text == "ben: all labelled"


def _play_to(browser: Chrome, frame: int, rate_hz: float | None) -> None:
    """Set the clock to the middle of a frame's time, from frame 1, once no picture is on its way."""
    assert rate_hz is not None
    wait_for(lambda: browser.execute_script("return document.body.getAttribute('aria-busy') === 'false'"))
    browser.execute_script("window.vfoaClock = arguments[0]", 1000 * (frame - 1 + 0.5) / rate_hz)
