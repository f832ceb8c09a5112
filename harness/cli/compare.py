"""``vfoa compare``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Json
from harness.cli.printing import print_json, print_reports


class FailOn(StrEnum):
    """What makes the command exit with 1."""

    significant_drop = "significant-drop"


def compare(
    runs: Annotated[list[Path], typer.Argument(help="Directories of finished runs.", metavar="RUN")],
    baseline: Annotated[
        Path | None, typer.Option(metavar="RUN", help="Compare each configuration with this run's of the same name.")
    ] = None,
    fail_on: Annotated[FailOn | None, typer.Option(help="Exit with 1 if this happened; needs --baseline.")] = None,
    as_json: Json = False,
) -> None:
    """Compare configurations on the same frames, by exact McNemar tests with Holm's correction."""
    from dataclasses import asdict

    from harness.report.compared import terminal_comparisons
    from harness.scores.run_comparison import compare_runs, compare_with_baseline
    from vfoa.errors import VfoaError

    if fail_on is not None and baseline is None:
        raise VfoaError("compare: --fail-on needs --baseline RUN, found none")
    found = compare_runs(runs) if baseline is None else compare_with_baseline(runs, baseline)
    if as_json:
        print_json([{**asdict(each), "sentence": each.sentence} for each in found])
    else:
        print_reports([terminal_comparisons(found)])
    if fail_on is FailOn.significant_drop and any(each.is_significant_drop for each in found):
        raise typer.Exit(1)
