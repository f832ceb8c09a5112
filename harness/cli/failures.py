"""The terminal's side of ``vfoa view --failures``: one key a step, one line a failure."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.record.composed import RecordedClip
    from harness.score.verdicts import Verdict


def step_through(run: Path, clip: str | None, configuration: str | None) -> None:
    """Open the viewer at a run's first wrong frame, and go from one to the next as the keys say."""
    from harness.record import viewer
    from harness.score.failures import KEYS, describe, walk

    if not sys.stdin.isatty():
        raise VfoaError(
            "view --failures: expected a terminal to read keys from, found none; --failures --web has links instead"
        )
    wrong, recordings = _wrong_frames(run, clip, configuration)
    if not wrong:
        typer.echo("No wrong frame.")
        return
    shown = {clip: recording.compose() for clip, recording in recordings.items()}
    with viewer.opened(instead="--failures --web has a link to each wrong frame, for any browser") as go_to:
        typer.echo(KEYS)
        for place in walk(len(wrong), _keys()):
            at = wrong[place]
            go_to(shown[at.clip], at.frame, (at.configuration, at.subject))
            typer.echo(describe(wrong, place))


def browse_failures(run: Path, clip: str | None, configuration: str | None) -> None:
    """Serve the recordings of a run, and print a link to each wrong frame."""
    from harness.cli.browse import browse
    from harness.record.web_app import open_path
    from harness.score.failures import describe

    wrong, recordings = _wrong_frames(run, clip, configuration)
    if not wrong:
        typer.echo("No wrong frame.")
        return
    shown = {
        (each.clip, each.configuration): recordings[each.clip].under(each.configuration).compose() for each in wrong
    }
    for place in range(len(wrong)):
        typer.echo(describe(wrong, place))
    paths = [open_path(shown[each.clip, each.configuration].name, each.frame) for each in wrong]
    browse(shown.values(), paths)


def _wrong_frames(
    run: Path, clip: str | None, configuration: str | None
) -> tuple[list[Verdict], dict[str, RecordedClip]]:
    """The wrong frames, and what was recorded of each clip."""
    from harness.record.composed import find_clips
    from harness.run.directory import RunDirectory
    from harness.score.failures import failures
    from harness.score.finished_run import read_scores

    recordings = {each.files.clip: each for each in find_clips(run, clip, configuration)}
    return failures(read_scores(RunDirectory(run)), clip, configuration), recordings


def _keys() -> Iterator[str]:
    """What is pressed, a key at a time; Ctrl-C and Ctrl-D end it."""
    while True:
        try:
            key = typer.prompt("", default="n", show_default=False, prompt_suffix="> ")
        except typer.Abort:
            return
        yield key
