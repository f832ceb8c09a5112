"""The terminal's side of ``vfoa view --failures``: one key a step, one line a failure."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import typer

from vfoa.errors import VfoaError


def step_through(run: Path, clip: str | None, configuration: str | None) -> None:
    """Open the viewer at a run's first wrong frame, and go from one to the next as the keys say."""
    from harness.recording import find_recordings, viewer
    from harness.runs.directory import RunDirectory
    from harness.scores.failures import KEYS, describe, failures, walk
    from harness.scores.finished_run import read_scores

    if not sys.stdin.isatty():
        raise VfoaError("view --failures: expected a terminal to read keys from, found none; see frames.csv instead")
    find_recordings(run, clip, configuration)  # a wrong name is found before anything is scored
    directory = RunDirectory(run)
    wrong = failures(read_scores(directory), clip, configuration)
    if not wrong:
        typer.echo("No wrong frame.")
        return
    with viewer.opened() as go_to:
        typer.echo(KEYS)
        for place in walk(len(wrong), _keys()):
            at = wrong[place]
            go_to(directory.recording((at.clip, at.configuration)), at.frame)
            typer.echo(describe(wrong, place))


def _keys() -> Iterator[str]:
    """What is pressed, a key at a time; Ctrl-C and Ctrl-D end it."""
    while True:
        try:
            key = typer.prompt("", default="n", show_default=False, prompt_suffix="> ")
        except typer.Abort:
            return
        yield key
