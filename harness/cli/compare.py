"""``vfoa compare``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import Json, run_folder
from harness.cli.terminal import print_json, print_reports, say


class FailOn(StrEnum):
    """Events for which the command exits with 1."""

    significant_drop = "significant-drop"


def compare(
    runs: Annotated[
        list[str],
        typer.Argument(
            help="Directories of finished runs or their addresses, or tables exported from them as JSON.", metavar="RUN"
        ),
    ],
    baseline: Annotated[
        str | None, typer.Option(metavar="RUN", help="Compare each configuration with this run's of the same name.")
    ] = None,
    fail_on: Annotated[FailOn | None, typer.Option(help="Exit with 1 if this happens; needs --baseline.")] = None,
    tolerance: Annotated[
        float,
        typer.Option(min=0, metavar="POINTS", help="Accept a significant drop of at most this many points of FRR."),
    ] = 0.0,
    model: Annotated[
        bool, typer.Option("--model", help="Also fit a mixed-effects logistic regression (extra: model).")
    ] = False,
    page: Annotated[
        Path | None, typer.Option("--page", metavar="HTML", help="Write a page with the table, sorted by any column.")
    ] = None,
    replace: Annotated[bool, typer.Option("--replace", help="Overwrite the file of --page.")] = False,
    as_json: Json = False,
) -> None:
    """Compare configurations on the same frames: difference, interval, exact permutation test, Holm's correction."""
    from dataclasses import asdict

    from harness.files import atomic_write, check_new
    from harness.report.comparisons import model_table, terminal_comparisons
    from harness.report.page.render_sweep import render_comparison
    from harness.score.run_comparison import compare_runs, compare_with_baseline, model_runs
    from vfoa.errors import VfoaError

    if fail_on is not None and baseline is None:
        raise VfoaError("compare: --fail-on needs --baseline RUN, found none")
    if page is not None and as_json:
        raise VfoaError("compare: --page does not go with --json")
    if model and (baseline is not None or as_json):
        raise VfoaError("compare: --model does not go with --baseline or --json")
    if page is not None:
        check_new(page, replace=replace, hint=", or another --page")
    folders = [run_folder(run) for run in runs]
    found = compare_runs(folders) if baseline is None else compare_with_baseline(folders, run_folder(baseline))
    if as_json:
        print_json([{**asdict(each), "verdict": each.verdict, "sentence": each.sentence} for each in found])
    else:
        models = [model_table(model_runs(folders))] if model else []
        print_reports([terminal_comparisons(found), *models])
        if page is not None:
            atomic_write(page, render_comparison(found, models))
            say(f"Page: {page}")
    if fail_on is FailOn.significant_drop and any(each.is_drop(tolerance / 100) for each in found):
        raise typer.Exit(1)
