"""Every verb of the command line: an example of one that writes, or why it is not in the fault plan."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import typer

from harness.cli import app
from tests.faults import project


@dataclass(frozen=True, slots=True)
class Writes:
    """A verb that writes: the words of an example in the project of :mod:`tests.faults.project`, or a call.

    ``varies`` are endings of files that differ from run to run, ``grows`` those that are written again and again: of
    them, only that they can be read is asked, of the second until the verb has ended by itself.
    """

    words: tuple[str, ...] = ()
    call: Callable[[], None] | None = None
    varies: tuple[str, ...] = ()
    grows: tuple[str, ...] = ()
    only_removes: bool = False


@dataclass(frozen=True, slots=True)
class Left:
    """A verb that is not in the plan, and why."""

    reason: str


READS = dict.fromkeys(
    (
        *("compare", "plan", "doctor", "settings", "labels check"),
        *("cache info", "clips list", "clips check", "models list", "models check"),
    ),
    Left("writes nothing"),
)
_RUN_VARIES = ("manifest.json", "timings.csv", "report.html", ".rrd", ".noted")
_BOARD = ("--columns", "9", "--rows", "6", "--square-mm", "25")

VERBS: dict[str, Writes | Left] = {
    **READS,
    "demo": Left("the same as run, with an experiment that is there"),
    "run": Writes(("run", "talk.toml", "--out", "new", "--workers", "1", "--recording", "none"), varies=_RUN_VARIES),
    "score": Writes(("score", "run"), varies=_RUN_VARIES),
    "report": Writes(("report", "run"), varies=_RUN_VARIES),
    "view": Left("opens a viewer; with --screenshot one file, by the writer that fit has"),
    "catalog": Left("serves; writes nothing but a folder of its own"),
    "export-failure": Writes(
        ("export-failure", "run", "--frame", "20", "--config", "cones", "--out", "small.rrd", "--replace"),
        varies=(".rrd",),
    ),
    "figures": Writes(("figures", "run", "--out", "figures", "--replace")),
    "fit": Writes(("fit", "run", "--out", "fitted.toml", "--even-if-worse")),
    "bench": Left("measures times; one file, by the writer that fit has"),
    "annotate": Writes(call=project.label, varies=(".talk.jsonl",), grows=("annotations/talk.csv",)),
    "calibrate": Writes(
        ("calibrate", "board", *_BOARD, "--left", "left*.png", "--right", "right*.png", "--out", "rig.yml", "--replace")
    ),
    "init": Writes(("init", "other")),
    "labels import": Writes(
        ("labels", "import", "theirs.eaf", "--format", "elan", "--clip", "talk", "--annotator", "eve", "--replace"),
        varies=(".jsonl",),
    ),
    "labels undo": Writes(call=project.take_back, varies=(".jsonl",)),
    "labels export": Writes(("labels", "export", "talk", "mine.eaf", "--format", "elan", "--replace")),
    "labels agreement": Writes(("labels", "agreement", "talk", "--out", "agreement")),
    "answers export": Writes(("answers", "export", "run", "--config", "cones", "--replace")),
    "cache clear": Writes(("cache", "clear"), only_removes=True),
    "clips add": Writes(("clips", "add", "data/walk", "--name", "walk")),
    "clips fetch": Left("downloads from fixed addresses, by the download that models fetch has"),
    "models fetch": Writes(("models", "fetch", "mine")),
    "models export": Left("needs PyTorch; one file, by the writer that fit has"),
}
"""By the words of a verb. A new verb has a line here, or a test of the suite fails."""


def verbs() -> Iterator[tuple[str, Any]]:
    """Every verb that ``vfoa --help`` and its groups show, with click's command."""
    for name, command in _below(typer.main.get_command(app)):
        below = list(_below(command))
        yield from ((f"{name} {each}", deeper) for each, deeper in below) if below else ((name, command),)


def _below(command: Any) -> Iterator[tuple[str, Any]]:
    return ((name, each) for name, each in getattr(command, "commands", {}).items() if not each.hidden)
