"""``vfoa score``."""

from __future__ import annotations

import gc
from typing import Annotated

import typer

from harness.cli.options import Run, Verbose, run_folder


def score(
    run: Run,
    annotator: Annotated[
        str | None,
        typer.Option(
            metavar="ANNOTATOR", help="Score against CLIP@ANNOTATOR.csv. Default: the labels that the run names."
        ),
    ] = None,
    verbose: Verbose = False,
) -> None:
    """Score a run again from its results and the present labels; needs no images and no models."""
    from harness.cli.terminal import print_scores, say_unknown_names
    from harness.report.write import rescore
    from harness.run.directory import RunDirectory

    folder = run_folder(run)
    scores = rescore(RunDirectory(folder), annotator)
    gc.freeze()  # the verdicts of all frames live to the end: without this, the collector visits them once more at exit
    print_scores(scores, folder, verbose=verbose)
    say_unknown_names(scores)
