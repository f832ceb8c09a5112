"""A whole clip labelled in a browser by keys alone, and nothing lost by undo, reload or a killed server."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from harness.clips.manifest import ClipManifest, load_manifest
from harness.labels.files import format_annotations
from harness.labels.labels import IGNORED, Label, Labels, ranges_of
from tests.annotating import MANIFEST, serve, served_by_the_program, shown
from tests.browser import wait_for
from tests.disk import moving_picture, write_text, write_video

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

CLOCK = "window.vfoaClock = 0; performance.now = () => window.vfoaClock;"
"""The time stands still until the test sets it, so that playing is where the test has to press a key."""
OF_BOTH = {"cup": "1", "book": "2", "ann": "3", "ben": "4", "none": "n", "ignore": "i"}
OF_ANN = {"cup": "1", "book": "2", "none": "n", "ignore": "i"}
LOOKS = (
    ("cup", 9),
    (IGNORED, 2),
    ("book", 8),
    (IGNORED, 3),
    ("cup", 7),
    ("none", 9),
    ("book", 5),
    ("cup", 10),
    ("none", 7),
)
"""What ann looks at in 60 frames, and for how many each: six changes of what is looked at."""


class Keyboard:
    """Presses keys in the page, and counts them."""

    def __init__(self, browser: Chrome) -> None:
        self._browser, self.presses = browser, 0

    def press(self, *keys: str) -> None:
        from selenium.webdriver import ActionChains

        for key in keys:
            ActionChains(self._browser).send_keys(key).perform()
            self.presses += 1


def _videos(work: Path, frames: int, manifest: str = MANIFEST) -> ClipManifest:
    """A clip of two videos in a working directory, which nobody has labelled yet."""
    for side, first in (("left", 0), ("right", 1000)):
        write_video(work / "pairs" / f"{side}.mkv", [moving_picture(first + number) for number in range(frames)])
    text = manifest.replace('"left"', '"left.mkv"\nlayout = "videos"').replace('"right"', '"right.mkv"')
    return load_manifest(str(write_text(work / "datasets" / "noise.toml", text)))


def test_a_clip_is_labelled_while_it_plays_and_survives_all_that_can_happen(browser: Chrome, tmp_path: Path) -> None:
    ann_alone = MANIFEST.replace('[subjects.ben]\ncategory = "person"\nfrom_left = 2\n', "")
    clip = _videos(tmp_path, 60, ann_alone).open()
    targets = [target for target, frames in LOOKS for _ in range(frames)]
    truth = Labels(ranges_of("ann", ((frame, Label(target=target)) for frame, target in enumerate(targets))))
    keyboard = Keyboard(browser)
    file = tmp_path / "annotations" / "noise.csv"

    with serve(clip=str(tmp_path / "datasets" / "noise.toml")) as page:
        browser.get(page.address)
        wait_for(lambda: shown(browser) == 0)
        browser.execute_script(CLOCK)
        keyboard.press(OF_ANN[truth.ranges[0].label.target], " ")
        for each in truth.ranges[1:]:
            _play_to(browser, each.first_frame, clip.rate_hz)
            wait_for(lambda frame=each.first_frame: shown(browser) == frame)
            keyboard.press(OF_ANN[each.label.target])
        _play_to(browser, 59, clip.rate_hz)
        wait_for(lambda: shown(browser) == 59)
        assert keyboard.presses <= 20
        wait_for(lambda: file.exists() and file.read_text() == format_annotations(truth))
        wait_for(lambda: "60 of 60 labelled (100 %)" in browser.find_element("id", "progress").text)
        assert browser.find_element("id", "unlabelled").text == "ann: all labelled"

        # undo and redo, over a reload
        keyboard.press("z")
        wait_for(lambda: format_annotations(truth) != file.read_text())
        browser.refresh()
        wait_for(lambda: shown(browser) is not None)
        keyboard.press("y")
        wait_for(lambda: file.read_text() == format_annotations(truth))

    # killed in mid-work: what was said is there, what is said meanwhile is kept and sent again, all can be undone
    with served_by_the_program(tmp_path, "noise") as (process, address):
        browser.get(address)
        wait_for(lambda: shown(browser) == 0)
        keyboard.press(OF_ANN["none"])
        wait_for(lambda: f"0,{truth.ranges[0].last_frame},ann,none," in file.read_text())
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        keyboard.press(OF_ANN["book"])
        wait_for(lambda: "What you do is kept here" in browser.find_element("id", "notice").text)
    with served_by_the_program(tmp_path, "noise") as (process, again):
        assert again == address
        wait_for(lambda: f"0,{truth.ranges[0].last_frame},ann,book," in file.read_text())
        wait_for(lambda: not browser.find_element("id", "notice").is_displayed())
        wait_for(lambda: "ann: book" in browser.find_element("id", "label").text)
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
    manifest = _videos(tmp_path, frames)
    random = np.random.default_rng(7)
    changes = {
        name: {0, *random.choice(np.arange(1, frames), 24, replace=False).tolist()} for name in manifest.subjects
    }
    truth: dict[str, list[str]] = {name: [] for name in manifest.subjects}
    presses: list[str] = []
    for name, found in truth.items():
        for at in range(frames):
            others = [each for each in OF_BOTH if each not in (name, *found[-1:])]
            found.append(str(random.choice(others)) if at in changes[name] else found[-1])
            presses += ["\ue014"] * (at > 0) + [OF_BOTH[found[-1]]] * (at in changes[name])
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
    """Set the clock to the middle of a frame's time, from frame 0, once no picture is on its way."""
    assert rate_hz is not None
    wait_for(lambda: browser.execute_script("return document.body.getAttribute('aria-busy') === 'false'"))
    browser.execute_script("window.vfoaClock = arguments[0]", 1000 * (frame + 0.5) / rate_hz)
