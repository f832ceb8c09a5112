"""Many small clips: a Dask cluster of two workers against a pool of two processes.

``python -m harness.bench.many_clips 200 3`` runs 200 clips of five frames three times on each, alternately, and prints
the least seconds and CPU seconds. The clips are copies of a rendered one. The cluster is started before.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from harness.bench.parallel import used_cpu_seconds
from harness.data_folders import find
from harness.files import atomic_write, read_text
from harness.report.formats import Table, to_markdown
from harness.run.executors.cluster import local_cluster
from harness.run.experiment import Experiment, load_experiment
from harness.run.runner import prepare, run_plan
from vfoa.errors import VfoaError

CLIP = "studio_table"
FRAMES = 5
WORKERS = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Seconds and CPU seconds of a run, and its results."""

    seconds: float
    cpu_seconds: float
    results: bytes


def measure_many_clips(clips: int, times: int, folder: Path) -> Mapping[str, list[Cost]]:
    """Run clips on a pool and on a cluster, alternately; the first run of each is not counted."""
    experiment = _experiment(clips, folder)
    found: dict[str, list[Cost]] = {"pool": [], "cluster": []}
    with local_cluster(WORKERS) as scheduler:
        for number in range(times + 1):
            for name, address in (("pool", None), ("cluster", scheduler)):
                found[name].append(_run(experiment, folder / f"{name} {number}", address))
    return {name: costs[1:] for name, costs in found.items()}


def _experiment(clips: int, folder: Path) -> Experiment:
    manifest = find("datasets", CLIP)
    if manifest is None:
        raise VfoaError(f"{CLIP}: no such clip; expected it among the program's own")
    text = read_text(manifest)
    paths = [folder / "datasets" / f"{CLIP}_{number}.toml" for number in range(clips)]
    for path in paths:
        atomic_write(path, text.replace(f'name = "{CLIP}"', f'name = "{path.stem}"'))
    demo = load_experiment("demo")
    return replace(demo, clips=tuple(map(str, paths)), configurations=demo.configurations[:1])


def _run(experiment: Experiment, out: Path, scheduler: str | None) -> Cost:
    plan = prepare(experiment, limit=FRAMES)
    cpu_before, started = used_cpu_seconds(scheduler), time.perf_counter()
    directory = run_plan(plan, out, workers=WORKERS, scheduler=scheduler, progress=lambda clip: None)
    return Cost(
        seconds=time.perf_counter() - started,
        cpu_seconds=used_cpu_seconds(scheduler) - cpu_before,
        results=directory.results.read_bytes(),
    )


def many_clips_table(clips: int, costs: Mapping[str, Sequence[Cost]]) -> Table:
    """One row for each executor: the least of its runs, and the ratio to the pool."""
    base = costs["pool"]
    return Table(
        title=f"{clips} clips of {FRAMES} frames on {WORKERS} workers",
        columns=("workers", "s", "ratio", "CPU s", "CPU ratio", "same results"),
        rows=tuple(
            (
                name,
                f"{_seconds(each):.1f}",
                f"{_seconds(each) / _seconds(base):.2f}",
                f"{_cpu_seconds(each):.1f}",
                f"{_cpu_seconds(each) / _cpu_seconds(base):.2f}",
                "yes" if {cost.results for cost in each} == {base[0].results} else "no",
            )
            for name, each in costs.items()
        ),
        words=1,
        notes=(f"The least of {len(base)} runs of each, alternately. Only the start of the pool counts.",),
    )


def _seconds(costs: Sequence[Cost]) -> float:
    return min(cost.seconds for cost in costs)


def _cpu_seconds(costs: Sequence[Cost]) -> float:
    return min(cost.cpu_seconds for cost in costs)


def main() -> None:
    """Measure the given number of clips, as often as given."""
    clips, times = map(int, sys.argv[1:])
    with tempfile.TemporaryDirectory() as folder:
        costs = measure_many_clips(clips, times, Path(folder))
    Console().print(to_markdown(many_clips_table(clips, costs)), soft_wrap=True)


if __name__ == "__main__":
    main()
