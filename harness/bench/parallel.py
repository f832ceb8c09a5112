"""What workers, a cluster, configurations and the cache cost or save: ``python -m harness.bench.parallel``.

Whole runs of one clip, one after the other, from the plan to the joined results, the start of workers included. The
ratios belong together; the seconds belong to the machine and to what else it did.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.table import Table

from harness.cache.store import Store
from harness.recording import Size
from harness.runs.conduct import conduct, prepare
from harness.runs.configuration import Configuration
from harness.runs.executors.cluster import local_cluster
from harness.runs.experiment import Experiment, load_experiment
from vfoa.attention import AttentionSettings

CONES_CM = ((10.0,), (10.0, 25.0), (5.0,), (20.0,))
PLENTY = 10**12


@dataclass(frozen=True, slots=True, kw_only=True)
class Timed:
    """One run: what it was, its seconds, what they are compared with, and its results."""

    what: str
    seconds: float
    compared_with: Timed | None
    results: bytes

    @property
    def ratio(self) -> float | None:
        """Seconds over those of the run it is compared with."""
        return self.seconds / self.compared_with.seconds if self.compared_with else None


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
        """Time a run: in a directory and a cache of its own, unless they are named."""
        plan = prepare(experiment, limit=self.limit, recording=recording)
        store = Store(self.folder / (cache or f"cache of {what}"), PLENTY)
        started = time.perf_counter()
        directory = conduct(
            plan,
            self.folder / (out or what),
            workers=workers,
            scheduler=scheduler,
            progress=lambda clip: None,
            cache=store,
        )
        seconds = time.perf_counter() - started
        return Timed(what=what, seconds=seconds, compared_with=compared_with, results=directory.results.read_bytes())


def measure(experiment: Experiment, limit: int) -> Iterator[Timed]:
    """Time the runs of an experiment's first configuration and clip, and of four that differ in their cones alone."""
    first = experiment.configurations[0]
    one = replace(experiment, clips=experiment.clips[:1], configurations=(first,))
    four = replace(one, configurations=tuple(_with_cones(first, cones) for cones in CONES_CM))
    with tempfile.TemporaryDirectory() as folder:
        yield from _workers(_Bench(folder=Path(folder), limit=limit), one)
        yield from _configurations(_Bench(folder=Path(folder), limit=limit), one, four)


def _workers(bench: _Bench, one: Experiment) -> Iterator[Timed]:
    bench.run("imports", one)
    alone = bench.run("one worker", one)
    yield alone
    pool = bench.run("two workers", one, alone, workers=2)
    yield pool
    with local_cluster(2) as scheduler:
        yield bench.run("Dask, two workers", one, pool, scheduler=scheduler)


def _configurations(bench: _Bench, one: Experiment, four: Experiment) -> Iterator[Timed]:
    alone = bench.run("one configuration, recorded", one, recording="light")
    yield alone
    several = bench.run("four configurations, recorded", four, alone, recording="light", out="four", cache="kept")
    yield several
    yield bench.run("the same again", four, several, recording="light", out="four", cache="kept")
    yield bench.run("again elsewhere, from the cache", four, several, recording="light", cache="kept")


def _with_cones(configuration: Configuration, cones_cm: tuple[float, ...]) -> Configuration:
    attend = configuration.attend.model_copy(update={"attention": AttentionSettings(cones_cm=cones_cm)})
    return replace(configuration, name=f"cones-{'-'.join(f'{cone:g}' for cone in cones_cm)}", attend=attend)


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("experiment", nargs="?", default="demo")
    parser.add_argument("--limit", type=int, default=50)
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    arguments = parser.parse_args()
    experiment = load_experiment(arguments.experiment, overrides=tuple(arguments.overrides))
    table = Table("Run", "s", "Ratio", "to", "Same results")
    for run in measure(experiment, arguments.limit):
        base, ratio = run.compared_with, run.ratio
        compared = (f"{ratio:.2f}", base.what, _same(run, base)) if base and ratio else ("", "", "")
        table.add_row(run.what, f"{run.seconds:.1f}", *compared)
    Console(width=120).print(table)


def _same(run: Timed, base: Timed) -> str:
    if run.results.count(b"\n") != base.results.count(b"\n"):
        return ""
    return "yes" if run.results == base.results else "NO"


if __name__ == "__main__":
    main()
