"""``vfoa run`` of a sweep."""

from __future__ import annotations

import json
import time
from pathlib import Path

import typer

from harness.files import atomic_write
from harness.run.experiment import Experiment
from harness.run.plan import describe, prepare
from harness.stages.cache.store import Store
from vfoa.errors import VfoaError


def run_sweep(
    experiment: Experiment,
    *,
    out: Path,
    workers: int,
    limit: int | None,
    oracle: bool,
    save_outputs: bool,
    cache: Store | None,
) -> None:
    """Sweep, write the table and its answers, and print these."""
    from harness.cli.printing import print_report
    from harness.cli.progress import frames_bar
    from harness.report.sweep import best_table, effects_table, write_sweep
    from harness.score.sweep.runner import sweep_plan

    if unfit := [name for name, given in (("--oracle", oracle), ("--save-outputs", save_outputs)) if given]:
        raise VfoaError(f"run {experiment.name}: found {unfit[0]}; expected none, since a sweep keeps only scores")
    plan = prepare(experiment, limit=limit)
    started = time.monotonic()
    with frames_bar(plan.frames, experiment.name) as progress:
        sweep = sweep_plan(plan, out, workers=workers, progress=progress, cache=cache)
    seconds = time.monotonic() - started
    write_sweep(out, sweep)
    described = describe(plan)
    del described["configurations"]  # they are the rows of sweep.csv
    view = {"per": sweep.view.per, "across": sweep.view.across}
    described["sweep"] = {**view, "clips": sweep.clips, "frames": sweep.frames, "notes": sweep.notes}
    atomic_write(out / "sweep.json", json.dumps(described, indent=1, ensure_ascii=False) + "\n")
    for table in (best_table(sweep), effects_table(sweep)):
        print_report(table)
    typer.echo(
        f"{len(sweep.rows):,} configurations x {sweep.frames} frames in {seconds:.0f} s with {workers} "
        f"{'worker' if workers == 1 else 'workers'}\n"
        f"Page: {out / 'report.html'}\nTable: {out / 'sweep.csv'}\nFigure: {out / 'sweep.svg'}"
    )
