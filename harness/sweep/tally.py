"""One clip under every configuration of a sweep: how many labelled frames each gets right."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.annotations.files import IGNORED, Labels
from harness.cache.stage import ClipCache
from harness.clips.manifest import ClipManifest
from harness.clips.naming import SubjectNames, name_frame
from harness.runs.configuration import Configuration
from harness.runs.executors import Progress
from harness.runs.records import to_record
from harness.runs.sharing import SharedPipeline
from harness.scores.verdicts import find_subject, right_answers
from vfoa.attention import AttentionSettings
from vfoa.cone_sweep import NOWHERE, UNKNOWN, ConeSweep
from vfoa.errors import VfoaError
from vfoa.pipeline import Memory, attend
from vfoa.types import Scene

Tallies = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepJob:
    """All that a process needs to sweep over one clip."""

    manifest: ClipManifest
    frames: tuple[int, ...]
    labels: Labels
    configurations: tuple[Configuration, ...]
    cache: ClipCache | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """What a clip came to: ``n`` labelled (frame, subject) pairs, and of those, per configuration (S,), how many.

    ``correct`` counts the right ones, ``predicted`` those with any prediction. ``error`` says why the clip could
    not be finished, None if it was.
    """

    clip: str
    n: int
    correct: Tallies
    predicted: Tallies
    error: VfoaError | None = None


def sweep_clip(job: SweepJob, progress: Progress) -> Tally:
    """Sweep over one clip; ``progress`` is told the clip's name after each frame."""
    correct, predicted = np.zeros((2, len(job.configurations)), dtype=np.int64)
    n = 0
    error: VfoaError | None = None
    try:
        groups = _groups(job)
        pipeline = SharedPipeline([group.configuration for group in groups], job.manifest.open(), job.cache)
        for shared in pipeline.frames(job.frames):
            for group in groups:
                found = shared.by_configuration[group.configuration.name]
                if isinstance(found, VfoaError):
                    raise found
                _, scene, _ = found
                group.count(scene, correct, predicted)
            n += sum(label.target != IGNORED for _, _, label in job.labels.labelled([shared.frame.index]))
            progress(job.manifest.name)
    except VfoaError as wrong:
        error = wrong
    return Tally(clip=job.manifest.name, n=n, correct=correct, predicted=predicted, error=error)


@dataclass(slots=True, kw_only=True)
class _Group:
    """Configurations that differ in attention alone: one way through the clip for all of them.

    ``configuration`` is the first of them; its memory and names serve all, since attention carries nothing on.
    ``numbers`` are their places among the tallies.
    """

    job: SweepJob
    configuration: Configuration
    numbers: list[int]
    cones: ConeSweep
    memory: Memory = field(default_factory=Memory)
    names: SubjectNames = field(default_factory=SubjectNames)

    def count(self, scene: Scene, correct: Tallies, predicted: Tallies) -> None:
        """Add one frame to the tallies."""
        result, self.memory = attend(scene, self.memory, self.configuration.attend)
        manifest = self.job.manifest
        names, self.names = name_frame(result, manifest.subjects, manifest.targets, self.names)
        record = to_record(manifest.name, self.configuration.name, result, names)
        subjects = {each.subject.track_id: each.subject for each in result.attentions}
        for _, name, label in self.job.labels.labelled([scene.index]):
            found = find_subject(record, name)
            if label.target == IGNORED or found is None:
                continue
            foci = self.cones.foci(subjects[found.track_id], scene.targets)
            right = [NOWHERE if answer is None else answer for answer in right_answers(record, label)]
            correct[self.numbers] += np.isin(foci, right)
            predicted[self.numbers] += foci != UNKNOWN


def _groups(job: SweepJob) -> list[_Group]:
    """The job's configurations by all that comes before attention."""
    numbers: dict[object, list[int]] = {}
    for number, each in enumerate(job.configurations):
        before = (tuple(each.choices.items()), each.reconstruction, each.attend.tracking, each.attend.gaze_filter)
        numbers.setdefault(before, []).append(number)
    return [
        _Group(
            job=job,
            configuration=job.configurations[members[0]],
            numbers=members,
            cones=ConeSweep([_cones(job.configurations[number]) for number in members]),
        )
        for members in numbers.values()
    ]


def _cones(configuration: Configuration) -> AttentionSettings:
    if not isinstance(configuration.attend.attention, AttentionSettings):
        raise VfoaError(f"configuration {configuration.name!r}: a sweep is over cones; found attention.method 'bayes'")
    return configuration.attend.attention
