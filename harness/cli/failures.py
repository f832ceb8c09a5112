"""The terminal part of ``vfoa view --failures``: one key per step, one line per failure."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from harness.cli.terminal import say
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.record.composed import RecordedClip
    from harness.score.verdicts import Verdict


def step_through(run: Path, clip: str | None, configuration: str | None) -> None:
    """Open the viewer at a run's first wrong frame, and step to others by keys."""
    from harness.score.failures import KEYS

    if not sys.stdin.isatty():
        raise VfoaError(
            "view --failures: expected a terminal to read keys from, found none; --failures --web has links"
        )
    say(KEYS)
    place: int | None = 0
    while place is not None:
        place = _steps(run, clip, configuration, place)


def _steps(run: Path, clip: str | None, configuration: str | None, start: int) -> int | None:
    """Step through the wrong frames; return the position at which a label was corrected, None at the end.

    The viewer is reopened after a correction: it would keep the old content of the recording.
    """
    from harness.record import viewer
    from harness.score.failures import describe, walk

    wrong, recordings = _wrong_frames(run, clip, configuration)
    if not wrong:
        say("No wrong frame.")
        return None
    shown = {clip: recording.compose() for clip, recording in recordings.items()}
    place, corrected = start, False

    def keys() -> Iterator[str]:
        nonlocal corrected
        for key in _keys():
            if key.strip().lower() == "w":
                corrected = _correct(run, wrong[place])
                if corrected:
                    return
            yield key

    with viewer.opened(instead="--failures --web has a link to each wrong frame, for any browser") as go_to:
        for place in walk(len(wrong), keys(), start):
            at = wrong[place]
            go_to(shown[at.clip], at.frame, (at.configuration, at.subject))
            say(describe(wrong, place))
    return place if corrected else None


def _correct(run: Path, wrong: Verdict) -> bool:
    """Ask for the right target of a frame, and write it; return False if nothing was written."""
    from harness.annotate.correction import Correction, choices, correct
    from harness.run.directory import RunDirectory

    directory = RunDirectory(run)
    try:
        say(f"{', '.join(choices(directory, wrong.clip, wrong.subject))}; FIRST-LAST for more than this frame")
        said = typer.prompt("right target [FIRST-LAST], or nothing", default="", show_default=False).strip()
        if not said:
            return False
        target, first, last = _told(said, wrong.frame)
        correction = Correction(clip=wrong.clip, subject=wrong.subject, target=target, first=first, last=last)
        say(f"{correct(directory, correction)}: {correction}. Tables, page and recordings are updated.")
    except (VfoaError, typer.Abort) as error:
        say(f"vfoa: {error or 'nothing was changed'}", err=True)
        return False
    return True


def _told(said: str, frame: int) -> tuple[str, int, int]:
    """Parse a target and the frames: ``red cup`` for the frame alone, ``red cup 12-20`` for several."""
    if found := re.fullmatch(r"(.+)\s+(\d+)-(\d+)", said):
        return found[1], int(found[2]), int(found[3])
    return said, frame, frame


def browse_failures(run: Path, clip: str | None, configuration: str | None) -> None:
    """Serve the recordings of a run, and a page that steps through its wrong frames beside the web viewer."""
    from harness.cli.browse import browse
    from harness.record.web_app import failures_routes

    wrong, recordings = _wrong_frames(run, clip, configuration)
    if not wrong:
        say("No wrong frame.")
        return
    shown = {
        (each.clip, each.configuration): recordings[each.clip].under(each.configuration).compose() for each in wrong
    }
    say(f"{len(wrong)} wrong frames")
    browse(shown.values(), ["/"], more=failures_routes(wrong, shown))


def _wrong_frames(
    run: Path, clip: str | None, configuration: str | None
) -> tuple[list[Verdict], dict[str, RecordedClip]]:
    """The wrong frames, and the recordings of each clip."""
    from harness.record.composed import find_clips
    from harness.run.directory import RunDirectory
    from harness.score.failures import failures
    from harness.score.finished_run import read_scores

    recordings = {each.files.clip: each for each in find_clips(run, clip, configuration)}
    return failures(read_scores(RunDirectory(run)), clip, configuration), recordings


def _keys() -> Iterator[str]:
    """Yield pressed keys one at a time; Ctrl-C and Ctrl-D end it."""
    while True:
        try:
            key = typer.prompt("", default="n", show_default=False, prompt_suffix="> ")
        except typer.Abort:
            return
        yield key
