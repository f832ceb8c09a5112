"""``vfoa demo``."""

from __future__ import annotations

from typing import Annotated

import typer

from harness.cli.options import Out, Verbose, Workers
from harness.cli.run import run


def demo(
    out: Out = None,
    workers: Workers = 0,
    limit: Annotated[int | None, typer.Option(min=1, help="Run only the first N frames of each clip.")] = None,
    verbose: Verbose = False,
) -> None:
    """Run the paper's table on rendered clips: {BM, SGBM} x {one cone, two}. Downloads nothing."""
    run(["demo"], out=out, workers=workers, limit=limit, verbose=verbose)
