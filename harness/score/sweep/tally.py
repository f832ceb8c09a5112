"""One clip under every configuration of a sweep: the number of labelled frames that each gets right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from harness.labels.labels import IGNORED, Labels
from harness.run.clip_job import ClipJob
from harness.run.executors.contract import Progress
from harness.run.frame_sink import FinishedFrame, SinkContext
from harness.run.loop import run_clip
from harness.score.verdicts import find_subject, right_answers
from harness.stages.configuration import Configuration
from vfoa.attention import AttentionSettings
from vfoa.cone_sweep import NOWHERE, UNKNOWN, ConeSweep
from vfoa.errors import VfoaError

Tallies = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """Counts of a clip: ``n`` labelled (frame, subject) pairs, and counts of these per configuration (S,).

    ``correct`` counts the right ones, ``predicted`` those with an answer. ``error`` says why the clip could not be
    finished, None if it was.
    """

    clip: str
    n: int
    correct: Tallies
    predicted: Tallies
    error: VfoaError | None = None

    @classmethod
    def empty(cls, job: ClipJob, error: VfoaError) -> Tally:
        """Counts of a clip that failed."""
        none = np.zeros(len(job.configurations), np.int64)
        return cls(clip=job.manifest.name, n=0, correct=none, predicted=none, error=error)


def sweep_clip(job: ClipJob, progress: Progress) -> Tally:
    """Run the loop over one labelled clip, once for all configurations that differ only in attention, and count."""
    try:
        groups = {group.configuration.name: group for group in _groups(job)}
    except VfoaError as wrong:
        return Tally.empty(job, wrong)
    counted = replace(
        job, configurations=tuple(group.configuration for group in groups.values()), sinks=(_Groups(groups),)
    )
    outcome = run_clip(counted, progress)
    for error in outcome.failures.values():
        return Tally.empty(job, error)
    correct, predicted = np.zeros((2, len(job.configurations)), dtype=np.int64)
    for group in groups.values():
        correct[group.numbers] += group.correct
        predicted[group.numbers] += group.predicted
    labelled = job.labels.labelled(job.frames) if job.labels else ()
    n = sum(label.target != IGNORED for _, _, label in labelled)
    return Tally(clip=job.manifest.name, n=n, correct=correct, predicted=predicted)


@dataclass(slots=True, kw_only=True)
class _Group:
    """The sink of configurations that differ only in attention: one pass over the clip for all of them.

    ``configuration`` is the first of them. Its tracks and names are valid for all, since cones carry nothing from frame
    to frame. ``numbers`` are their places in the sweep, ``correct`` and ``predicted`` their counts.
    """

    labels: Labels
    configuration: Configuration
    numbers: list[int]
    cones: ConeSweep
    correct: Tallies
    predicted: Tallies

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None: ...

    def write(self, frame: FinishedFrame) -> None:
        """Count one frame."""
        record, result = frame.record, frame.result
        subjects = {each.subject.track_id: each.subject for each in result.attentions}
        for _, name, label in self.labels.labelled([record.frame]):
            found = find_subject(record, name)
            if label.target == IGNORED or found is None:
                continue
            foci = self.cones.foci(subjects[found.track_id], result.scene.targets)
            right = [NOWHERE if answer is None else answer for answer in right_answers(record, label)]
            self.correct += np.isin(foci, right)
            self.predicted += (foci != UNKNOWN) & (foci != NOWHERE)  # nothing hit is no answer


@dataclass(frozen=True, slots=True)
class _Groups:
    """Gives the loop each group as the sink of its first configuration."""

    by_name: Mapping[str, _Group]

    def described(self) -> Mapping[str, Any]:
        """A sweep has a manifest of its own."""
        return {}

    def open(self, context: SinkContext) -> _Group:
        """Return the group of this configuration."""
        return self.by_name[context.configuration]


def _groups(job: ClipJob) -> list[_Group]:
    """Group the job's configurations by everything that comes before attention."""
    if job.labels is None:
        raise AssertionError("a sweep takes labelled clips")
    numbers: dict[object, list[int]] = {}
    for number, each in enumerate(job.configurations):
        before = (tuple(each.choices.items()), each.reconstruction, each.attend.tracking, each.attend.gaze_filter)
        numbers.setdefault(before, []).append(number)
    return [
        _Group(
            labels=job.labels,
            configuration=job.configurations[members[0]],
            numbers=members,
            cones=ConeSweep([_cones(job.configurations[number]) for number in members]),
            correct=np.zeros(len(members), np.int64),
            predicted=np.zeros(len(members), np.int64),
        )
        for members in numbers.values()
    ]


def _cones(configuration: Configuration) -> AttentionSettings:
    if not isinstance(configuration.attend.attention, AttentionSettings):
        raise VfoaError(f"configuration {configuration.name!r}: a sweep is over cones; found attention.method 'bayes'")
    return configuration.attend.attention
