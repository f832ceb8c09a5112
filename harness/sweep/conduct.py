"""A whole sweep: every clip opened first, then the tallies, then the table, its answers and their figure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.annotations.files import Labels
from harness.cache.stage import open_cache
from harness.cache.store import Store
from harness.runs.configuration import Configuration
from harness.runs.executors import Progress, work_through
from harness.runs.experiment import Experiment, SweepView
from harness.runs.plan import Plan, PreparedClip
from harness.scores.statistics import Interval, wilson_interval
from harness.sweep.tally import SweepJob, Tally, sweep_clip
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRow:
    """One configuration on all clips together, of ``n`` labelled (frame, subject) pairs."""

    configuration: Configuration
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
    """What a sweep found: a row a configuration, in the order of the grid."""

    name: str
    clips: tuple[str, ...]
    frames: int
    notes: tuple[str, ...]
    view: SweepView
    rows: tuple[SweepRow, ...]


def conduct_sweep(plan: Plan, *, workers: int, progress: Progress, cache: Store | None = None) -> Sweep:
    """Sweep over the plan's clips. Clips without labels take no part, and the notes say so.

    ``cache`` is where results of perception are kept, None for nowhere.

    Raises
    ------
    VfoaError
        If no clip has labels, or one could not be finished.
    """
    if plan.experiment.sweep is None:
        raise AssertionError("not a sweep")
    jobs = [_job(one, one.labels, plan.experiment, cache) for one in plan.clips if one.labels is not None]
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


def _job(one: PreparedClip, labels: Labels, experiment: Experiment, store: Store | None) -> SweepJob:
    name = one.manifest.name
    configurations = tuple(each.for_clip(name) for each in experiment.configurations)
    cache = open_cache(store, name, one.clip, configurations) if store else None
    return SweepJob(manifest=one.manifest, frames=one.frames, labels=labels, configurations=configurations, cache=cache)


def _rows(configurations: tuple[Configuration, ...], tallies: list[Tally]) -> tuple[SweepRow, ...]:
    n = sum(tally.n for tally in tallies)
    if n == 0:
        raise VfoaError("sweep: expected at least one labelled frame, found none in any clip")
    correct = np.sum([tally.correct for tally in tallies], axis=0)
    predicted = np.sum([tally.predicted for tally in tallies], axis=0)
    return tuple(
        SweepRow(configuration=each, n=n, correct=int(right), predicted=int(made))
        for each, right, made in zip(configurations, correct, predicted, strict=True)
    )
