"""``vfoa score``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def score(
    run: Annotated[Path, typer.Argument(help="A run's directory.")],
    annotator: Annotated[
        str | None, typer.Option(help="Score against CLIP@ANNOTATOR.csv; the run's own labels if not given.")
    ] = None,
) -> None:
    """Score a run again, from its results and the present annotations alone: no images, no models."""
    from harness.cli.scores import print_scores
    from harness.report.rescore import rescore
    from harness.runs.directory import RunDirectory

    print_scores(rescore(RunDirectory(run), annotator))
