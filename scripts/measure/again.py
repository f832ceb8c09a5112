"""What a run again under other cones saves, since its scenes are kept: ``python -m scripts.measure again``.

Each row is a fresh process, which first runs one frame of each clip without a cache: imports, the renderer and the
first calls of the networks are in its start. All rows have one process, one thread and one stage cache, empty before
the first row; no recordings and no thumbnails are written.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.pipeline.cache_store import open_store
from harness.processes import spawning
from harness.report.formats import Table
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.plan import prepare
from harness.run.runner import run_plan
from scripts.measure.printing import print_tables

ROWS = {
    "as it is": (),
    "other cones": ("attention.cones_cm=[14.0]",),
    "another matcher": ("stereo.uniqueness_percent=12",),
}
"""The settings that each run changes, by the title of its row; the first one fills the cache."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seconds:
    """CPU seconds of one process: its start, opening the clips, the run, and its scores with tables and page."""

    start: float
    plan: float
    run: float
    score: float


def measure_again(experiment: str, limit: int | None) -> dict[str, Seconds]:
    """Run an experiment under the changes of every row, one after the other, each in a fresh process."""
    with tempfile.TemporaryDirectory() as folder:
        measured = {}
        for title, changes in ROWS.items():
            with spawning().Pool(1) as pool:
                measured[title] = pool.apply(_seconds, (experiment, changes, limit, Path(folder), title))
    return measured


def _seconds(experiment: str, changes: tuple[str, ...], limit: int | None, folder: Path, title: str) -> Seconds:
    _run(experiment, (), 1, folder / f"start {title}", None)
    started = time.process_time()
    planned, done = _run(experiment, changes, limit, folder / title, folder / "cache")
    rescore(RunDirectory(folder / title))
    return Seconds(
        start=started,
        plan=planned - started,
        run=done - planned,
        score=time.process_time() - done,
    )


def _run(
    experiment: str, changes: tuple[str, ...], limit: int | None, out: Path, cache: Path | None
) -> tuple[float, float]:
    """Run an experiment; the process's CPU seconds once it was planned, and once it was done."""
    plan = prepare(load_experiment(experiment, overrides=changes), limit=limit)
    planned = time.process_time()
    run_plan(plan, out, workers=1, progress=lambda clip: None, cache=None if cache is None else open_store(str(cache)))
    return planned, time.process_time()


def again_table(experiment: str, measured: dict[str, Seconds]) -> Table:
    """A row for each run, with the time of the first one over its own."""
    first = next(iter(measured.values()))
    return Table(
        title=f"The experiment {experiment} again, CPU seconds",
        columns=("changed", "run", "times faster", "opening the clips", "scores, tables and page", "start"),
        rows=tuple(
            (title, f"{each.run:.2f}", f"{first.run / each.run:.1f}", *_plain(each.plan, each.score, each.start))
            for title, each in measured.items()
        ),
        words=1,
        notes=("Start: imports, and one frame of each clip without a cache.",),
    )


def _plain(*seconds: float) -> Sequence[str]:
    return [f"{each:.2f}" for each in seconds]


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description="Measure what a run again under other settings saves.")
    parser.add_argument("experiment", nargs="?", default="demo")
    parser.add_argument("--limit", type=int, help="Number of frames of each clip; default: the experiment's.")
    given = parser.parse_args()
    print_tables(again_table(given.experiment, measure_again(given.experiment, given.limit)))


if __name__ == "__main__":
    main()
