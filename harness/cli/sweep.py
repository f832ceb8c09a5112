"""``vfoa run`` of a sweep."""

from __future__ import annotations

import hashlib
import itertools
import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.cli.terminal import say
from harness.files.io import atomic_write, read_text
from harness.run.experiment import Experiment
from harness.run.manifest import differences
from harness.run.plan import Plan, describe, prepare
from harness.stages.cache.store import Store
from vfoa.errors import VfoaError

_DESCRIBED = "sweep.json"


def run_sweep(
    experiment: Experiment,
    *,
    out: Path,
    beside: bool,
    workers: int,
    limit: int | None,
    oracle: bool,
    cache: Store | None,
) -> None:
    """Run a sweep, write its table and page, and print its best settings and the effect of each factor.

    ``beside``: as for :func:`harness.run.runner.run_plan`.
    """
    from harness.cli.terminal import frames_bar, print_report
    from harness.report.sweep import best_table, effects_table, write_sweep
    from harness.score.sweep.runner import sweep_plan

    if oracle:
        raise VfoaError(f"run {experiment.name}: found --oracle; expected none, since a sweep keeps only scores")
    plan = prepare(experiment, limit=limit)
    described = _described(plan)
    out = _free(out, described, beside)
    started = time.monotonic()
    with frames_bar(plan.frames, experiment.name) as progress:
        sweep = sweep_plan(plan, out, workers=workers, progress=progress, cache=cache)
    seconds = time.monotonic() - started
    view = {"per": sweep.view.per, "across": sweep.view.across}
    about = {**view, "clips": sweep.clips, "frames": sweep.frames, "notes": sweep.notes}
    atomic_write(out / _DESCRIBED, json.dumps({**described, "sweep": about}, indent=1, ensure_ascii=False) + "\n")
    write_sweep(out, sweep)
    for table in (best_table(sweep), effects_table(sweep)):
        print_report(table)
    say(
        f"{len(sweep.rows):,} configurations x {sweep.frames} frames in {seconds:.0f} s with {workers} "
        f"{'worker' if workers == 1 else 'workers'}\n"
        f"Page: {out / 'report.html'}\nTable: {out / 'sweep.csv'}\nFigure: {out / 'sweep.svg'}"
    )


def _described(plan: Plan) -> dict[str, Any]:
    """The description that identifies a sweep; of its configurations (the rows of ``sweep.csv``) it holds a digest."""
    described = describe(plan)
    configurations = json.dumps(described.pop("configurations"), sort_keys=True)
    return {**described, "configurations_sha256": hashlib.sha256(configurations.encode()).hexdigest()}


def _free(first: Path, described: Mapping[str, Any], beside: bool) -> Path:
    """The directory to write to: an empty one, or one that already has exactly this sweep."""
    wanted = json.loads(json.dumps(described))  # lists for tuples
    for number in itertools.count(1):
        out = first.with_name(f"{first.name}-{number}") if number > 1 else first
        if not out.exists() or not any(out.iterdir()):
            return out
        found = _found(out / _DESCRIBED)
        if found and not differences(found, wanted):
            return out
        if not beside:
            holds = f"another sweep (different: {differences(found, wanted)})" if found else "other files"
            raise VfoaError(
                f"{out}: holds {holds}; expected an empty directory, or the same sweep: choose another --out"
            )
    raise AssertionError("counting has no end")


def _found(path: Path) -> Mapping[str, Any]:
    """The description of a sweep; empty if there is none."""
    try:
        found = json.loads(read_text(path)) if path.is_file() else {}
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}
