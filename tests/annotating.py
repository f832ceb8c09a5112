"""A small clip to be labelled, a run of it, and its page served by a thread."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.annotate.app import PageServer
from harness.annotate.session import Session
from harness.labels.labels import IGNORED, Label, Labels, Timeline, ranges_of
from harness.run.records import FrameRecord
from harness.sources import Clip
from harness.studio import StudioSettings
from tests.browser import BrowserPage, wait_for
from tests.disk import stereo_pair_folder, write_text
from tests.records import frame_record, subject_record, target_record, write_run
from tests.repository import REPOSITORY

if TYPE_CHECKING:
    from selenium.webdriver import ActionChains, Chrome
    from selenium.webdriver.remote.webelement import WebElement

MANIFEST = """# A clip of noise, for those who test.
name = "noise"
adapter = "stereo_folder"
root = "../pairs"

[source]
left = "left"
right = "right"

[source.camera]
fx_px = 50.0
cx_px = 31.5
cy_px = 23.5
baseline_m = 0.1

[subjects.ann]  # on the left
category = "person"
from_left = 1

[subjects.ben]
category = "person"
from_left = 2

[targets.cup]
category = "cup"

[targets.book]
category = "book"
"""
LOOKS_AROUND = StudioSettings(scenario="table", frames=60, seed=15, mean_fixation_s=0.3)
"""Somebody at a table of things, who looks at something else six times in 60 frames."""
FRAMES = tuple(range(1, 13))
CUP_PX, BOOK_PX = (4.0, 30.0, 14.0, 44.0), (40.0, 28.0, 60.0, 46.0)
PREDICTED = ("cup",) * 4 + ("book",) * 4 + ("none",) * 4
TOTALS = (0.9, 0.9, 0.8, 0.3, 0.9, 0.7, 0.7, 0.2, 0.0, 0.0, 0.0, 0.0)


class Page:
    """A page that is being served: the session behind it, its address and its token."""

    def __init__(self, session: Session, server: PageServer) -> None:
        self.session, self.address, self.port = session, server.address, server.port
        self.token = server.address.partition("token=")[2]

    @property
    def file(self) -> Path:
        return self.session.path


@contextmanager
def serve(**choices: Any) -> Iterator[Page]:
    """Serve a clip in a thread until the block ends."""
    session = Session(**choices)
    server = PageServer(session)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield Page(session, server)
    finally:
        server.stop()
        thread.join()
        session.close()


@contextmanager
def served_by_the_program(
    work: Path, name: str, installed: Path = REPOSITORY
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``vfoa annotate`` in a working directory as a process of its own, and the address it prints."""
    program = "from harness.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", program, "annotate", name, "--no-open"],
        cwd=work,
        env={**os.environ, "PYTHONPATH": str(installed), "VFOA_CACHE": str(work / "cache")},
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        process.stdout.readline()
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def true_labels(clip: Clip, frames: Sequence[int]) -> Labels:
    """The true labels of a rendered clip of anna; frames of a saccade, which nobody can judge, are ignored."""
    targets = [(number, (clip.truth(number).people or ())[0].target or IGNORED) for number in frames]
    return Labels(ranges_of("anna", ((number, Label(target=target)) for number, target in targets)))


def make_work(folder: Path) -> Path:
    """A working directory with the clip ``noise``, twelve frames of 64 x 48 pixels, and a run of it."""
    stereo_pair_folder(folder / "pairs", FRAMES)
    write_text(folder / "datasets" / "noise.toml", MANIFEST)
    write_run(folder / "run", _records())
    return folder


def _records() -> list[FrameRecord]:
    """Ann looks at what is predicted; of ben the run knows nothing."""
    targets = (
        target_record(1, "ann", box_px=(10.0, 4.0, 30.0, 30.0)),
        target_record(2, "cup", box_px=CUP_PX),
        target_record(3, "book", box_px=BOOK_PX),
        target_record(4, "clock#4", box_px=(50.0, 2.0, 60.0, 12.0)),
    )
    ids = {"cup": 2, "book": 3}
    records = []
    for frame, name, total in zip(FRAMES, PREDICTED, TOTALS, strict=True):
        focus = ids.get(name)
        subject = subject_record("ann", totals={focus: total} if focus else {}, focus=focus, instance_id=1)
        records.append(frame_record(targets, [subject], frame=frame, clip="noise"))
    return records


def shown(browser: Chrome) -> int | None:
    """The number of the frame that the page shows; None before it shows any."""
    frame = browser.execute_script("return document.body.dataset.frame")
    return None if frame is None else int(frame)


def write_labels(work: Path, *rows: str, annotator: str = "", columns: Sequence[str] = ("note",)) -> Path:
    """Labels of the clip ``noise`` as another program writes them; an annotator is named with ``@``."""
    head = ",".join(("first_frame", "last_frame", "subject", "target", *columns))
    path = work / "annotations" / f"noise{annotator}.csv"
    return write_text(path, "\n".join(["# vfoa annotations 1", head, *rows, ""]))


def letters(labels: Labels, subject: str = "ann", frames: Sequence[int] = FRAMES) -> str:
    """A letter for each frame's target; ``-`` for ignore, ``.`` for a frame without a label."""
    found = [labels.at(frame, subject) for frame in frames]
    return "".join("." if each is None else "-" if each.target == IGNORED else each.target[0] for each in found)


STRIP = "#timelines .current > div"
"""The timeline of the subject who is labelled."""


class LabellingPage(BrowserPage):
    """The labelling page in a browser: what a person sees and presses, and the labels that are in the file then."""

    def __init__(self, browser: Chrome, page: Page) -> None:
        super().__init__(browser)
        self.address, self.session = page.address, page.session
        self.open()

    def open(self) -> None:
        """Load the page, and wait until it takes keys."""
        self.browser.get(self.address)
        wait_for(lambda: self.shown is not None)
        self.settle()

    @property
    def shown(self) -> int | None:
        return shown(self.browser)

    def answer_slowly(self, seconds: float = 0.4, *, of: str = "POST") -> None:
        """Let changes (``GET``: all else) take that long, as over a slow connection; until the page is loaded anew."""
        self.js(
            "const [ask, [ms, method]] = [fetch, arguments];"
            "const wait = () => new Promise((over) => setTimeout(over, ms));"
            "fetch = async (path, options) => {"
            "  if ((options?.method ?? 'GET') !== method) return ask(path, options);"
            "  await wait();"
            "  const answer = await ask(path, options);"
            "  await wait();"
            "  return answer; };",
            500 * seconds,
            of,
        )

    def settle(self) -> None:
        """Wait until the page shows and has saved everything."""
        wait_for(lambda: self.js("return document.body.getAttribute('aria-busy') === 'false'"))

    @property
    def focused(self) -> WebElement:
        return self.browser.switch_to.active_element

    def actions(self) -> ActionChains:
        from selenium.webdriver import ActionChains

        return ActionChains(self.browser, duration=0)

    def keys(self, *keys: str) -> None:
        """Press keys, each after the page has shown and saved what the one before did."""
        for key in keys:
            self.actions().send_keys(key).perform()
            self.settle()

    def shown_after(self, *keys: str) -> int | None:
        """The frame that is shown after these keys."""
        self.keys(*keys)
        return self.shown

    def click(self, selector: str) -> None:
        self.actions().move_to_element(self.find(selector)).click().perform()
        self.settle()

    def drag(self, start: float, end: float, *, on: str = STRIP, frames: int = len(FRAMES)) -> None:
        """Drag on a strip of so many frames, from the middle of a position to that of another; 5.5: the change to 6."""
        strip = self.find(on)
        width = strip.size["width"] / frames
        actions = self.actions().move_to_element_with_offset(strip, round((start + 0.5 - frames / 2) * width), 0)
        actions.click_and_hold().move_by_offset(round((end - start) * width), 0).release().perform()
        self.settle()

    def targets(self, subject: str = "ann") -> str:
        """The scored labels, as :func:`letters`."""
        labels = self.session.manifest.read(self.session.path, Timeline(frames=FRAMES, times_ns=()))
        return letters(labels.confirmed(), subject)

    @contextmanager
    def second_tab(self) -> Iterator[None]:
        """The page in another tab, which is closed at the end."""
        first = self.browser.current_window_handle
        self.browser.switch_to.new_window("tab")
        second = self.browser.current_window_handle
        try:
            self.open()
            yield
        finally:
            self.browser.switch_to.window(second)
            self.browser.close()
            self.browser.switch_to.window(first)
