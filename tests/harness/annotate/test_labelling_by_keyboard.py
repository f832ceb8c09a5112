"""A whole clip labelled in a browser by keys alone, and nothing lost by undo, reload or a killed server."""

from __future__ import annotations

import os
import signal
import threading
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import tomlkit

from harness.clips.manifest import ClipManifest, load_manifest
from harness.labels.files import format_annotations
from harness.labels.labels import IGNORED
from harness.sources import Clip
from tests.annotating import LOOKS_AROUND, serve, served_by_the_program, shown, true_labels, wait_for
from tests.browser import chromium, set_width
from tests.disk import write_text
from tests.repository import REPOSITORY
from vfoa.types import StereoFrame

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

KEYS = {"laptop": "1", "mug": "2", "book": "3", "bottle": "4", "vase": "5", "none": "n", "ignore": "i"}


class Gate:
    """A clip whose frames come when the test lets them, so that playing waits where the test has to press a key."""

    def __init__(self, clip: Clip) -> None:
        self._clip = clip
        self._open_to, self._changed = 1, threading.Condition()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._clip, name)

    def frame(self, number: int) -> StereoFrame:
        with self._changed:
            self._changed.wait_for(lambda: number <= self._open_to)
        return self._clip.frame(number)

    def open_to(self, number: int) -> None:
        with self._changed:
            self._open_to = number
            self._changed.notify_all()


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
def browser(tmp_path: Path) -> Iterator[Chrome]:
    with chromium(tmp_path / "profile") as browser:
        set_width(browser, 1280)
        yield browser


@pytest.fixture
def studio(tmp_path: Path) -> Path:
    """A working directory with a studio clip that nobody has labelled yet."""
    document = tomllib.loads((REPOSITORY / "datasets" / "studio_table.toml").read_text())
    document |= {"name": "tabletop", "source": LOOKS_AROUND.model_dump()}
    return write_text(tmp_path / "datasets" / "tabletop.toml", tomlkit.dumps(document))


def test_a_clip_is_labelled_while_it_plays_and_survives_all_that_can_happen(browser: Chrome, studio: Path) -> None:
    gates: list[Gate] = []

    def gated(manifest: ClipManifest) -> Any:
        gates.append(Gate(manifest.open()))
        return gates[0]

    clip = load_manifest(str(studio)).open()
    truth = true_labels(clip, clip.frames)
    looked_at = [each.label.target for each in truth.ranges if each.label.target != IGNORED]
    assert len(clip.frames) == 60
    assert sum(one != other for one, other in pairwise(looked_at)) == 6
    keyboard = Keyboard(browser)
    file = studio.parents[1] / "annotations" / "tabletop.csv"

    with serve(clip=str(studio), open_clip=gated) as page:
        browser.get(page.address)
        wait_for(lambda: shown(browser) == 1)
        keyboard.press(KEYS[truth.ranges[0].label.target], " ")
        for each in truth.ranges[1:]:
            gates[0].open_to(each.first_frame)
            wait_for(lambda frame=each.first_frame: shown(browser) == frame)
            keyboard.press(KEYS[each.label.target])
        gates[0].open_to(60)
        wait_for(lambda: shown(browser) == 60)
        assert keyboard.presses <= 20
        wait_for(lambda: file.exists() and file.read_text() == format_annotations(truth))
        assert "60 of 60 labelled (100 %)" in browser.find_element("id", "progress").text

        # undo and redo, over a reload
        keyboard.press("z")
        wait_for(lambda: format_annotations(truth) != file.read_text())
        browser.refresh()
        wait_for(lambda: shown(browser) is not None)
        keyboard.press("y")
        wait_for(lambda: file.read_text() == format_annotations(truth))

    # killed in mid-work, twice, and started again: what was said is there, and can be undone
    with served_by_the_program(studio.parents[1], "tabletop") as (process, address):
        browser.get(address)
        wait_for(lambda: shown(browser) == 1)
        keyboard.press(KEYS["none"])
        wait_for(lambda: f"1,{truth.ranges[0].last_frame},anna,none," in file.read_text())
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        keyboard.press(KEYS["vase"])
        wait_for(lambda: "nothing you do now is saved" in browser.find_element("id", "notice").text)
    with served_by_the_program(studio.parents[1], "tabletop") as (process, address):
        browser.get(address)
        wait_for(lambda: shown(browser) == 1)
        assert "anna: none" in browser.find_element("id", "label").text
        keyboard.press("z")
        wait_for(lambda: file.read_text() == format_annotations(truth))
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 0
