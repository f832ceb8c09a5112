"""``vfoa demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.cli.run import OUT_HELP, WORKERS_HELP, run


def demo(
    out: Annotated[Path | None, typer.Option(help=OUT_HELP)] = None,
    workers: Annotated[int, typer.Option(min=0, help=WORKERS_HELP)] = 0,
) -> None:
    """Run the paper's table on rendered clips: {BM, SGBM} x {one cone, two}. Downloads nothing."""
    run(["demo"], out=out, workers=workers)
