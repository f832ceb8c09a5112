"""``vfoa answers``: the answers of a run, for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Replace, Run, RunConfiguration, run_folder
from harness.cli.terminal import say
from vfoa.errors import VfoaError

app = typer.Typer(help="Write a run's answers for another program, or another run.", no_args_is_help=True)


@app.callback()
def _answers() -> None:
    """Write a run's answers for another program, or another run."""


class Format(StrEnum):
    """What ``export`` writes."""

    answers = "answers"
    frames = "frames"


@app.command(name="export", short_help="Write who looks at what as tables.")
def export(
    run: Run,
    config: RunConfiguration = None,
    format: Annotated[
        Format,
        typer.Option(
            help="answers: one configuration's, CLIP.csv for each clip. frames: frames.csv with every attention value "
            "and verdict of all clips and configurations.",
        ),
    ] = Format.answers,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIRECTORY",
            help="Directory of the tables. Default: RUN/exported/CONFIGURATION, for frames RUN/exported.",
        ),
    ] = None,
    *,
    replace: Replace = False,
) -> None:
    """Write one configuration's answers as a table for each clip: frame, subject, target, and probabilities.

    attention.method = "answers" reads such tables, also those of other systems. With --format frames, write every
    attention value and verdict of the run as one table.
    """
    from harness.report.frames_csv import export_frames
    from harness.run.exported_answers import export_answers

    if out is not None and out.suffix.lower() in (".csv", ".parquet") and not out.is_dir():
        names = "frames.csv" if format is Format.frames else "CLIP.csv"
        raise VfoaError(f"answers export: --out {out}: found the name of a file; expected a folder, for {names}")
    if format is Format.frames:
        if config is not None:
            raise VfoaError("answers export: --config does not go with --format frames, which has all of them")
        say(str(export_frames(run_folder(run), out, replace=replace)))
        return
    for path in export_answers(run_folder(run), config, folder=out, replace=replace):
        say(str(path))
