"""``vfoa export-table``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Replace, Run, run_folder
from harness.cli.terminal import say


class TableFormat(StrEnum):
    """The formats of :data:`harness.report.export.FORMATS`."""

    csv = "csv"
    tex = "tex"
    md = "md"
    json = "json"


def export_table(
    run: Run,
    to: Annotated[TableFormat, typer.Option(help="JSON can be given to `vfoa compare` instead of the run.")],
    out: Annotated[Path | None, typer.Option(help="Write this file; print the table if not given.")] = None,
    replace: Replace = False,
) -> None:
    """Export a run's table with a data sheet: clips, n, units, seeds, versions, digest."""
    from harness.files.io import atomic_write, check_new
    from harness.report.export import FORMATS, exported_table
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import FinishedRun
    from harness.score.score import score

    directory = RunDirectory(run_folder(run))
    if out is not None:
        check_new(out, replace=replace, hint=", or another --out", inputs=directory.inputs)
    finished = FinishedRun.read(directory)
    scores = score(finished.records(), finished.reference())
    text = FORMATS[to.value](scores, exported_table(scores, finished.manifest))
    if out is None:
        say(text, nl=False)
    else:
        atomic_write(out, text)
