"""``vfoa score``."""

from __future__ import annotations

from typing import Annotated

import typer

from harness.cli.options import Run


def score(
    run: Run,
    annotator: Annotated[
        str | None,
        typer.Option(metavar="ANNOTATOR", help="Score against CLIP@ANNOTATOR.csv; the run's own labels if not given."),
    ] = None,
) -> None:
    """Score a run again, from its results and the present annotations alone: no images, no models."""
    from harness.cli.scores import print_scores
    from harness.report.rescore import rescore
    from harness.runs.directory import RunDirectory

    print_scores(rescore(RunDirectory(run), annotator))
