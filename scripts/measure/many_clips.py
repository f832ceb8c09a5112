"""Many small clips: a Dask cluster against a pool of processes, and a model of a run on more cores.

``python -m scripts.measure many_clips 200 3`` runs 200 clips of five frames three times on two workers of each,
alternately, and prints the least seconds and CPU seconds. The clips are copies of a rendered one; the cluster is
started before. ``--model 32`` runs 32 clips with one and with two workers instead, and extrapolates.
"""

from __future__ import annotations

import argparse
import math
import resource
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from harness.files.folders import find
from harness.files.io import atomic_write, read_text
from harness.report.formats import UNKNOWN, Table
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.executors.cluster import connect
from harness.run.experiment import Experiment, load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.timings import read_timings
from scripts.measure.printing import print_tables
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


@contextmanager
def local_cluster(workers: int) -> Iterator[str]:
    """Yield the address of a new scheduler on this machine with this many single-threaded worker processes."""
    from distributed import LocalCluster

    # any free port: the default is 8787 on all networks, which another cluster may use
    dashboard = {"dashboard_address": "127.0.0.1:0"}
    options = {"n_workers": workers, "threads_per_worker": 1, "host": "127.0.0.1", **dashboard}
    with LocalCluster(**options, silence_logs=50) as cluster:
        yield cluster.scheduler_address


def cpu_seconds(address: str) -> float:
    """CPU seconds that the workers of the scheduler at ``address`` have used so far."""
    with connect(address) as client:
        return float(sum(client.run(time.process_time).values()))


def measure_many_clips(clips: int, times: int, folder: Path) -> Mapping[str, list[Cost]]:
    """Run clips on a pool and on a cluster, alternately; the first run of each is not counted."""
    experiment = _experiment(clips, folder)
    by_executor: dict[str, list[Cost]] = {"pool": [], "cluster": []}
    with local_cluster(WORKERS) as scheduler:
        for number in range(times + 1):
            for name, address in (("pool", None), ("cluster", scheduler)):
                by_executor[name].append(_run(experiment, folder / f"{name} {number}", address))
    return {name: costs[1:] for name, costs in by_executor.items()}


PARTS = {
    "read": ("decode",),
    "match": ("stereo",),
    "other stages": ("segmentation", "heads", "head_pose", "gaze", "reconstruction", "attention", "measures"),
    "write": ("recording", "answers"),
}
"""Stages of a run by the part of the model that they belong to."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunModel:
    """A model of a run of equal clips, from CPU seconds with one worker and with two.

    ``serial_s`` is planned and scored by one process, ``start_s`` what a second worker adds: its imports and its share
    of the cost of a pool. ``work_s`` is the rest, by part. ``measured`` are seconds and CPU seconds by workers.
    """

    clips: int
    serial_s: float
    start_s: float
    work_s: Mapping[str, float]
    measured: Mapping[int, tuple[float, float]]

    def seconds(self, workers: int) -> float:
        """Seconds on as many idle cores: workers start at once, and then each runs one clip after the other."""
        rounds = math.ceil(self.clips / workers)
        return self.serial_s + self.start_s * (workers > 1) + rounds * sum(self.work_s.values()) / self.clips


def measure_model(clips: int, folder: Path) -> RunModel:
    """Run clips with one worker and with two, with light recordings, tables and page."""
    experiment = _experiment(clips, folder)
    _model_run(replace(experiment, clips=experiment.clips[:1]), folder / "warm", 1)
    serial_s, one, directory = _model_run(experiment, folder / "one", 1)
    _, two, _ = _model_run(experiment, folder / "two", 2)
    shares = _stage_shares(directory)
    return RunModel(
        clips=clips,
        serial_s=serial_s,
        start_s=max((two[1] - one[1]) / 2, 0.0),
        work_s={part: share * (one[1] - serial_s) for part, share in shares.items()},
        measured={1: one, 2: two},
    )


def used_cpu_seconds(scheduler: str | None) -> float:
    """CPU seconds of this process, of its children that have ended, and of a cluster's workers."""
    uses = (resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(use.ru_utime + use.ru_stime for use in uses) + (cpu_seconds(scheduler) if scheduler else 0.0)


def _model_run(experiment: Experiment, out: Path, workers: int) -> tuple[float, tuple[float, float], RunDirectory]:
    """CPU seconds of plan and scores, seconds and CPU seconds of all, and the directory of a run."""
    cpu_before, started = used_cpu_seconds(None), time.perf_counter()
    plan = prepare(experiment, limit=FRAMES, sinks=composed_sinks(experiment.configurations))
    planned = used_cpu_seconds(None)
    directory = run_plan(plan, out, workers=workers, progress=lambda clip: None)
    ran = used_cpu_seconds(None)
    rescore(directory)
    scored = used_cpu_seconds(None)
    return planned - cpu_before + scored - ran, (time.perf_counter() - started, scored - cpu_before), directory


def _stage_shares(directory: RunDirectory) -> dict[str, float]:
    """The share of each part in the time of the stages."""
    ms = read_timings(directory).to_pandas().groupby("stage")["ms"].sum()
    return {part: sum(ms.get(stage, 0.0) for stage in stages) / sum(ms.values()) for part, stages in PARTS.items()}


def model_tables(model: RunModel, workers: Sequence[int] = (1, 2, 4, 8, 16, 32)) -> list[Table]:
    """Where the time goes, and what the model says for more workers beside what was measured."""
    parts = {"plan, tables and page": model.serial_s, "start of a worker": model.start_s, **model.work_s}
    where = Table(
        title=f"CPU seconds of a run of {model.clips} clips of {FRAMES} frames",
        columns=("part", "CPU s", "of one worker's"),
        rows=tuple(
            (part, f"{seconds:.1f}", f"{100 * seconds / model.measured[1][1]:.0f}%") for part, seconds in parts.items()
        ),
        words=1,
    )
    one_worker_s = model.seconds(1)
    return [
        where,
        Table(
            title="The model: as many idle cores as workers",
            columns=("workers", "s", "times faster", "per worker", "measured s", "measured CPU s"),
            rows=tuple(
                (
                    str(number),
                    f"{model.seconds(number):.1f}",
                    f"{one_worker_s / model.seconds(number):.1f}",
                    f"{100 * one_worker_s / model.seconds(number) / number:.0f}%",
                    *(f"{seconds:.1f}" for seconds in model.measured.get(number, ())),
                    *([] if number in model.measured else [UNKNOWN, UNKNOWN]),
                )
                for number in workers
            ),
            words=0,
        ),
    ]


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
        results=b"".join(path.read_bytes() for path in sorted(directory.path.glob("*/**/*.parquet"))),
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
                f"{_seconds(of_executor):.1f}",
                f"{_seconds(of_executor) / _seconds(base):.2f}",
                f"{_cpu_seconds(of_executor):.1f}",
                f"{_cpu_seconds(of_executor) / _cpu_seconds(base):.2f}",
                "yes" if {cost.results for cost in of_executor} == {base[0].results} else "no",
            )
            for name, of_executor in costs.items()
        ),
        words=1,
        notes=(f"The least of {len(base)} runs of each, alternately. Only the start of the pool counts.",),
    )


def _seconds(costs: Sequence[Cost]) -> float:
    return min(cost.seconds for cost in costs)


def _cpu_seconds(costs: Sequence[Cost]) -> float:
    return min(cost.cpu_seconds for cost in costs)


def main() -> None:
    """Measure the given number of clips, as often as given, or the model's parts."""
    parser = argparse.ArgumentParser(description="Run many small clips.")
    parser.add_argument("clips", type=int, help="number of clips")
    parser.add_argument("times", type=int, nargs="?", default=1, help="number of runs on pool and cluster")
    parser.add_argument("--model", action="store_true", help="one and two workers of a pool, and a model of more")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if given.model:
            tables = model_tables(measure_model(given.clips, Path(folder)))
        else:
            tables = [many_clips_table(given.clips, measure_many_clips(given.clips, given.times, Path(folder)))]
    print_tables(*tables)
