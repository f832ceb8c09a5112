"""Cost and savings of workers, a cluster, several configurations and the cache.

Whole runs of one clip, one after the other, from the plan to the joined results, including the start of workers; a
cluster is started before. Compare ratios, not seconds: seconds depend on the machine and its load. CPU seconds belong
to the run: their ratio is what an idle machine would show.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from harness.record import Size
from harness.report.formats import UNKNOWN, Table
from harness.report.sinks import recordings
from harness.run.executors.cluster import cpu_seconds, local_cluster
from harness.run.experiment import Experiment
from harness.run.runner import prepare, run_plan
from harness.stages.cache.store import Store
from harness.stages.configuration import Configuration
from harness.stages.slots import SLOTS
from vfoa.attention import AttentionSettings

CONES_CM = ((10.0,), (10.0, 25.0), (5.0,), (20.0,))
PLENTY = 10**12


@dataclass(frozen=True, slots=True, kw_only=True)
class Timed:
    """One run: its name, seconds, CPU seconds of all its processes, and the run that it is compared with."""

    what: str
    seconds: float
    cpu_seconds: float
    compared_with: Timed | None
    results: bytes

    @property
    def same(self) -> bool | None:
        """Whether the results equal those of the run it is compared with; None if the configurations differ."""
        base = self.compared_with
        if base is None or base.results.count(b"\n") != self.results.count(b"\n"):
            return None
        return base.results == self.results


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bench:
    folder: Path
    limit: int

    def run(
        self,
        what: str,
        experiment: Experiment,
        compared_with: Timed | None = None,
        *,
        cache: str | None = None,
        out: str | None = None,
        recording: Size | None = None,
        workers: int = 1,
        scheduler: str | None = None,
    ) -> Timed:
        """Time a run, in a directory and a cache of its own, unless they are given."""
        plan = prepare(experiment, limit=self.limit, sinks=recordings(experiment.configurations, recording))
        store = Store(self.folder / (cache or f"cache of {what}"), PLENTY)
        cpu_before, started = used_cpu_seconds(scheduler), time.perf_counter()
        directory = run_plan(
            plan,
            self.folder / (out or what),
            workers=workers,
            scheduler=scheduler,
            progress=lambda clip: None,
            cache=store,
        )
        seconds = time.perf_counter() - started
        return Timed(
            what=what,
            seconds=seconds,
            cpu_seconds=used_cpu_seconds(scheduler) - cpu_before,
            compared_with=compared_with,
            results=directory.results.read_bytes(),
        )


def used_cpu_seconds(scheduler: str | None) -> float:
    """CPU seconds of this process, of its children that have ended, and of a cluster's workers."""
    uses = (resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(use.ru_utime + use.ru_stime for use in uses) + (cpu_seconds(scheduler) if scheduler else 0.0)


def by_matcher(experiment: Experiment) -> dict[str, Configuration]:
    """The first configuration of each matcher that computes something."""
    found: dict[str, Configuration] = {}
    for each in experiment.configurations:
        choice = each.choices["stereo"]
        if choice and choice.name not in SLOTS["stereo"].of_clip:
            found.setdefault(choice.name, each)
    return found


def measure_parallel(experiment: Experiment, configuration: Configuration, limit: int) -> list[Timed]:
    """Time runs of an experiment's first clip under one configuration, and under four that differ in their cones."""
    one = replace(experiment, clips=experiment.clips[:1], configurations=(configuration,))
    four = replace(one, configurations=tuple(with_cones(configuration, cones) for cones in CONES_CM))
    with tempfile.TemporaryDirectory() as folder:
        bench = _Bench(folder=Path(folder), limit=limit)
        replace(bench, limit=1).run("imports", four, recording="light")
        return [*_workers(bench, one), *_configurations(bench, one, four)]


def _workers(bench: _Bench, one: Experiment) -> Iterator[Timed]:
    alone = bench.run("1 worker", one)
    yield alone
    pool = bench.run("2 workers", one, alone, workers=2)
    yield pool
    if find_spec("distributed"):
        with local_cluster(2) as scheduler:
            yield bench.run("2 Dask workers", one, pool, scheduler=scheduler)


def _configurations(bench: _Bench, one: Experiment, four: Experiment) -> Iterator[Timed]:
    alone = bench.run("1 configuration", one, recording="light")
    yield alone
    several = bench.run("4 configurations", four, alone, recording="light", out="four", cache="kept")
    yield several
    yield bench.run("4 again", four, several, recording="light", out="four", cache="kept")
    yield bench.run("4 from the cache", four, several, recording="light", cache="kept")


def with_cones(configuration: Configuration, cones_cm: tuple[float, ...]) -> Configuration:
    """The configuration with other cones, and a name that says so."""
    attend = configuration.attend.model_copy(update={"attention": AttentionSettings(cones_cm=cones_cm)})
    return replace(configuration, name=f"cones-{'-'.join(f'{cone:g}' for cone in cones_cm)}", attend=attend)


def parallel_table(clip: str, matcher: str, frames: int, runs: Sequence[Timed]) -> Table:
    """One row per run, each with its ratio to another."""
    return Table(
        title=f"Whole runs of {frames} frames of {clip} with {matcher}",
        columns=("run", "to", "s", "ratio", "CPU s", "CPU ratio", "same results"),
        rows=tuple(_row(run) for run in runs),
        words=2,
        notes=(
            "CPU: of all processes. At best, two workers take half of theirs. A cluster's start is not counted.",
            "Configurations differ in their cones, and are recorded.",
        ),
    )


def _row(run: Timed) -> tuple[str, ...]:
    base, seconds, cpu = run.compared_with, f"{run.seconds:.1f}", f"{run.cpu_seconds:.1f}"
    if base is None:
        return run.what, UNKNOWN, seconds, UNKNOWN, cpu, UNKNOWN, UNKNOWN
    ratio, cpu_ratio = run.seconds / base.seconds, run.cpu_seconds / base.cpu_seconds
    same = {True: "yes", False: "NO", None: UNKNOWN}[run.same]
    return run.what, base.what, seconds, f"{ratio:.2f}", cpu, f"{cpu_ratio:.2f}", same
