"""``vfoa plan``."""

from __future__ import annotations

from typing import Annotated

import typer

from harness.cli.options import Json, Run, run_folder


def plan(
    run: Run,
    points: Annotated[float, typer.Option(min=0.1, max=100, help="Difference to detect, in points of FRR.")] = 5.0,
    power: Annotated[float, typer.Option(min=0.5, max=0.99, help="Probability of detecting it.")] = 0.8,
    as_json: Json = False,
) -> None:
    """Print how many clips and looks are needed to detect a difference, from the spread of this run."""
    from dataclasses import asdict

    from harness.cli.terminal import print_json, print_reports
    from harness.report.plan import plan_table, plans
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import read_scores

    found = plans(read_scores(RunDirectory(run_folder(run))), points, power)
    if as_json:
        print_json([asdict(each) for each in found])
    else:
        print_reports([plan_table(found, points, power)])
