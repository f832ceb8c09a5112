"""``vfoa answers``: the answers of a run, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Replace, Run, RunConfiguration, run_folder
from harness.cli.terminal import say

app = typer.Typer(help="Write a run's answers for another program, or another run.", no_args_is_help=True)


@app.callback()
def _answers() -> None:
    """Write a run's answers for another program, or another run."""


@app.command(name="export", short_help="Write who looks at what as a table for each clip.")
def export(
    run: Run,
    config: RunConfiguration = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Folder of the tables, CLIP.csv. Default: RUN/exported/CONFIGURATION."),
    ] = None,
    *,
    replace: Replace = False,
) -> None:
    """Write one configuration's answers as a table for each clip: frame, subject, target, and probabilities.

    attention.method = "answers" reads such tables, also those of other systems.
    """
    from harness.run.exported_answers import export_answers

    for path in export_answers(run_folder(run), config, folder=out, replace=replace):
        say(str(path))
