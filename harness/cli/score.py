"""``vfoa score``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def score(
    run: Annotated[Path, typer.Argument(help="A run's directory.")],
) -> None:
    """Score a run again, from its results and the present annotations alone: no images, no models."""
    from harness.report import print_scores, write_reports
    from harness.run_directory import RunDirectory

    print_scores(write_reports(RunDirectory(run)))
