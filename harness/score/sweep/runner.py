"""A whole sweep: every clip is opened first, then counted, then the table and its figure are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.files.digests import KNOWN
from harness.labels.labels import Labels
from harness.run.clip_job import ClipJob
from harness.run.directory import RunDirectory
from harness.run.executors import work_through
from harness.run.executors.contract import Progress
from harness.run.experiment import Experiment, SweepView
from harness.run.plan import Plan, PreparedClip
from harness.score.statistics import Interval, wilson_interval
from harness.score.sweep.tally import Tally, sweep_clip
from harness.sources import MeasuredClip
from harness.stages.cache.stage import open_cache
from harness.stages.cache.store import Store
from harness.stages.configuration import Configuration
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRow:
    """One configuration on all clips together, of ``n`` labelled (frame, subject) pairs.

    ``factors`` are its place in the grid: a label by key.
    """

    factors: Mapping[str, str]
    n: int
    correct: int
    predicted: int

    @property
    def frr(self) -> float:
        """Share of the pairs that are right."""
        return self.correct / self.n

    @property
    def wilson(self) -> Interval:
        """Wilson's 95 % interval of :attr:`frr`."""
        return wilson_interval(self.correct, self.n)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """Results of a sweep: one row per configuration, in the order of the grid."""

    name: str
    clips: tuple[str, ...]
    frames: int
    notes: tuple[str, ...]
    view: SweepView
    rows: tuple[SweepRow, ...]


def sweep_plan(plan: Plan, out: Path, *, workers: int, progress: Progress, cache: Store | None = None) -> Sweep:
    """Sweep over the plan's clips. Clips without labels are left out; a note says so.

    ``out`` is the directory that the caller writes the sweep to. ``cache`` is the store of stage outputs; None for
    none.

    Raises
    ------
    VfoaError
        If no clip has labels, or one could not be finished.
    """
    if plan.experiment.sweep is None:
        raise AssertionError("not a sweep")
    jobs = [
        _job(one, one.labels, plan.experiment, RunDirectory(out), cache) for one in plan.clips if one.labels is not None
    ]
    tallies = list(work_through(sweep_clip, jobs, workers, progress))
    for tally in tallies:
        if tally.error:
            raise tally.error
    labelled = [job.manifest.name for job in jobs]
    left_out = [one.manifest.name for one in plan.clips if one.manifest.name not in labelled]
    return Sweep(
        name=plan.experiment.name,
        clips=tuple(labelled),
        frames=sum(len(job.frames) for job in jobs),
        notes=(*plan.experiment.notes, *(f"{name}: no annotations, not part of the sweep." for name in left_out)),
        view=plan.experiment.sweep,
        rows=_rows(plan.experiment.configurations, tallies),
    )


def _job(
    one: PreparedClip, labels: Labels, experiment: Experiment, directory: RunDirectory, store: Store | None
) -> ClipJob:
    name, clip = one.manifest.name, one.clip
    configurations = tuple(each.for_clip(name) for each in experiment.configurations)
    cache = None  # nothing is perceived in a clip of measurements
    if store and not isinstance(clip, MeasuredClip):
        cache = open_cache(store, name, clip, configurations, one.digest)
    return ClipJob(
        manifest=one.manifest,
        frames=one.frames,
        labels=labels,
        configurations=configurations,
        cache=cache,
        digest=one.digest if cache else None,
        known=KNOWN.known,
        directory=directory,
        measured=False,
    )


def _rows(configurations: tuple[Configuration, ...], tallies: list[Tally]) -> tuple[SweepRow, ...]:
    n = sum(tally.n for tally in tallies)
    if n == 0:
        raise VfoaError("sweep: expected at least one labelled frame, found none in any clip")
    correct = np.sum([tally.correct for tally in tallies], axis=0)
    predicted = np.sum([tally.predicted for tally in tallies], axis=0)
    return tuple(
        SweepRow(factors=each.factors, n=n, correct=int(right), predicted=int(made))
        for each, right, made in zip(configurations, correct, predicted, strict=True)
    )
