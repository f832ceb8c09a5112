"""The overhead of a run: records, thumbnails, recordings and scores, per frame and configuration.

The same frames are run with one sink after the other added, with all stage outputs from the cache; the cost of a sink
is the time that it adds, including its threads. Times are CPU seconds in one process.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from harness.pipeline.cache import ClipCache, open_cache
from harness.pipeline.cache_store import Store
from harness.pipeline.configuration import Configuration, clouds_of
from harness.report.formats import Table
from harness.report.sinks import ThumbnailSinks, recordings
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import Experiment, load_experiment
from harness.run.frame_sink import SinkFactory
from harness.run.loop import ClipJob, run_clip
from harness.run.plan import Plan, prepare
from harness.run.runner import run_plan
from scripts.measure.printing import print_tables
from vfoa.cones import ConesSettings

CONES_CM = ((10.0,), (10.0, 25.0), (5.0,), (20.0,))
_PLENTY = 10**12


@dataclass(frozen=True, slots=True, kw_only=True)
class Overhead:
    """CPU milliseconds per frame and configuration, by purpose."""

    clip: str
    frames: int
    configurations: int
    ms: dict[str, float]


def measure_overhead(experiment: Experiment, limit: int, rounds: int = 3) -> Overhead:
    """Run the first frames of an experiment's first clip under four configurations that differ in their cones.

    The fastest of the rounds counts.
    """
    first = experiment.configurations[0]
    configurations = tuple(_with_cones(first, cones) for cones in CONES_CM)
    four = replace(experiment, clips=experiment.clips[:1], configurations=configurations)
    plan = prepare(four, limit=limit)
    (clip,) = plan.clips
    per = len(clip.frames) * len(configurations)
    recorded = recordings(configurations)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        store = Store(root / "cache", _PLENTY)
        cache = open_cache(store, clip.manifest.name, clip.manifest.open_images(), configurations)
        steps: dict[str, tuple[SinkFactory, ...]] = {
            "reading, cached stages, attention, tables": (),
            "thumbnails": (ThumbnailSinks(),),
            "recordings": (recorded, ThumbnailSinks()),
        }
        _run(plan, (), cache, root / "warm")
        seconds = [
            min(_run(plan, sinks, cache, root / f"{name} {number}") for number in range(rounds))
            for name, sinks in steps.items()
        ]
        directory = run_plan(plan, root / "scored", workers=1, progress=lambda clip: None, cache=store)
        short = run_plan(prepare(four, limit=2), root / "short", workers=1, progress=lambda clip: None, cache=store)
        rescore(short)  # imports, which no frame adds to
        started = time.process_time()
        rescore(directory)
        seconds.append(time.process_time() - started)
    added = [seconds[0], *(after - before for before, after in pairwise(seconds[:3])), seconds[3]]
    names = [*steps, "scores, first time"]
    return Overhead(
        clip=clip.manifest.name,
        frames=len(clip.frames),
        configurations=len(configurations),
        ms={name: 1e3 * seconds_added / per for name, seconds_added in zip(names, added, strict=True)},
    )


def _run(plan: Plan, sinks: tuple[SinkFactory, ...], cache: ClipCache, out: Path) -> float:
    """CPU seconds of a run with these sinks."""
    (clip,) = plan.clips
    job = ClipJob(
        manifest=clip.manifest,
        frames=clip.frames,
        configurations=plan.experiment.configurations,
        directory=RunDirectory(out),
        clouds=clouds_of(plan.experiment.configurations),
        sinks=sinks,
        cache=cache,
        drawn=clip.drawn,
    )
    started = time.process_time()
    for error in run_clip(job, lambda clip: None).failures.values():
        raise error
    return time.process_time() - started


def overhead_table(overhead: Overhead) -> Table:
    """One row per purpose, and their sum without the first."""
    total = sum(list(overhead.ms.values())[1:])
    return Table(
        title=f"CPU ms a frame of {overhead.clip} and configuration, {overhead.configurations} of them",
        columns=("what", "ms"),
        rows=(*((name, f"{ms:.1f}") for name, ms in overhead.ms.items()), ("overhead in all", f"{total:.1f}")),
        words=1,
        notes=("Overhead: all but the first row. What configurations share (images, masks) is divided by them.",),
    )


def _with_cones(configuration: Configuration, cones_cm: tuple[float, ...]) -> Configuration:
    """The configuration with other cones, and a name that says so."""
    attend = configuration.attend.model_copy(update={"attention": ConesSettings(cones_cm=cones_cm)})
    return replace(configuration, name=f"cones-{'-'.join(f'{cone:g}' for cone in cones_cm)}", attend=attend)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description="Measure what a run adds to the time of a frame.")
    parser.add_argument("experiment", nargs="?", default="demo", help="Experiment whose first clip is run.")
    parser.add_argument("--limit", type=int, default=20, help="Number of frames.")
    given = parser.parse_args()
    print_tables(overhead_table(measure_overhead(load_experiment(given.experiment), given.limit)))
