"""``vfoa demo``."""

from __future__ import annotations

from harness.cli.options import Out, Workers
from harness.cli.run import run


def demo(
    out: Out = None,
    workers: Workers = 0,
) -> None:
    """Run the paper's table on rendered clips: {BM, SGBM} x {one cone, two}. Downloads nothing."""
    run(["demo"], out=out, workers=workers)
