"""A run's predictions for a clip under one configuration, with their confidence, and the frames worth a label."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, sqrt
from pathlib import Path
from statistics import median

from harness.clips.manifest import ClipManifest
from harness.labels.labels import NOWHERE
from harness.run.results import read_clip_records
from harness.score.verdicts import name_probabilities


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """A run's prediction for a subject: a name, and the attention to it in [0, 1].

    With probabilities, it is that of all objects of the name, or of ``none``; otherwise, ``none`` has 0. ``margin`` is
    the difference to the next answer's: small if the run was uncertain.
    """

    target: str
    attention: float
    margin: float


WANTED_S, SHORTEST_S, LONGEST_S = 20.0, 2.0, 4.0
"""Seconds to label in all, and of a block."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelBlock:
    """A subject's frames from position ``first`` to ``last`` of the clip, both included."""

    subject: str
    first: int
    last: int


def label_first(answers: Mapping[str, Sequence[Sequence[str]]], times_s: Sequence[float]) -> list[LabelBlock]:
    """Choose about :data:`WANTED_S` to label, or the whole clip if it is shorter: by subject, then by position.

    ``answers`` has for each subject and frame the name that each configuration predicts (``none``: nowhere); no
    names where nothing is predicted. ``times_s`` are the frames' times, in order. Blocks last 2 to 4 s (less in a
    clip of a few seconds) and do not overlap. Every subject with an answer has one, even if the sum is then more than
    :data:`WANTED_S`. The block with the greatest gain is taken next, of equal ones the earlier: the share of
    configurations that disagree with the commonest answer, plus what it adds to the sum over names of the square root
    of the blocks in which a name is predicted, so that targets and nowhere are covered.
    """
    step_s = median(after - before for before, after in pairwise(times_s)) if len(times_s) > 1 else WANTED_S
    whole_s = times_s[-1] - times_s[0] + step_s
    subjects = [name for name, predicted in answers.items() if any(predicted)]
    length_s = min(max(WANTED_S / max(len(subjects), 1), SHORTEST_S), LONGEST_S)
    parts = max(ceil(whole_s / max(length_s, step_s)), 1)
    starts_s = [times_s[0] + whole_s * part / parts - step_s / 2 for part in range(parts + 1)]
    edges = [bisect_left(times_s, start_s) for start_s in starts_s]
    most = max(b - a for a, b in pairwise(edges))
    left = [LabelBlock(subject=name, first=a, last=b - 1) for name in subjects for a, b in pairwise(edges)]
    content = {block: _BlockAnswers.of(answers[block.subject][block.first : block.last + 1], most) for block in left}
    left = [block for block in left if content[block].share]
    chosen, seen = list[LabelBlock](), dict[str, float]()
    while left:
        missing = set(subjects) - {block.subject for block in chosen}
        best = max(
            (block for block in left if not missing or block.subject in missing),
            key=lambda block: content[block].gain(seen),
        )
        if not missing and (len(chosen) + 0.5) * whole_s / parts > WANTED_S:
            break
        left.remove(best)
        chosen.append(best)
        seen |= {name: seen.get(name, 0.0) + share for name, share in content[best].share.items()}
    return sorted(chosen, key=lambda block: (subjects.index(block.subject), block.first))


def advice(blocks: Sequence[LabelBlock], frames: Sequence[int], times_s: Sequence[float]) -> str | None:
    """A line with the frames and times of the blocks to label first; None without any."""
    listed = [
        f"{block.subject} {frames[a]}-{frames[b]} ({times_s[a]:.1f}-{times_s[b]:.1f} s)"
        for block in blocks
        for a, b in [(block.first, block.last)]
    ]
    return f"Label first, where configurations differ (key q), frames: {', '.join(listed)}" if listed else None


@dataclass(frozen=True, slots=True, kw_only=True)
class _BlockAnswers:
    """The disagreement of configurations in a block, in [0, 1), and the share of frames in which a name is predicted.

    Both are shares of the ``most`` frames of a block: a block of few frames counts less.
    """

    disagreement: float
    share: Mapping[str, float]

    @classmethod
    def of(cls, answers: Sequence[Sequence[str]], most: int) -> _BlockAnswers:
        share, against = defaultdict[str, float](float), 0.0
        for counted in (Counter(answer) for answer in answers if answer):
            against += 1 - max(counted.values()) / counted.total()
            for name, count in counted.items():
                share[name] += count / counted.total() / most
        return cls(disagreement=against / most, share=share)

    def gain(self, seen: Mapping[str, float]) -> float:
        new = sum(sqrt(seen.get(name, 0.0) + share) - sqrt(seen.get(name, 0.0)) for name, share in self.share.items())
        return self.disagreement + new


class Predictions:
    """A run's records of one clip under one configuration, as suggestions for labelling.

    Raises the errors of :func:`~harness.run.results.read_clip_records`.
    """

    def __init__(self, run: Path, clip: ClipManifest, configuration: str | None) -> None:
        records = read_clip_records(run, clip, configuration)
        self.configuration, self.records = records.configuration, records.by_frame
        self._says_nowhere, self._has_probabilities = records.says_nowhere, records.has_probabilities
        known = {*clip.targets, *clip.subjects, NOWHERE}
        self._answers = defaultdict[tuple[str, int], list[str]](list)
        """By subject and frame: the answers of all configurations; all names that the clip does not know are one.

        Nothing hit counts as nowhere: where labels say most, there are some of nowhere.
        """
        for record in records.all:
            for subject in record.subjects:
                if subject.name is not None and not subject.missing:
                    name = NOWHERE if subject.focus is None else record.target(subject.focus).name
                    self._answers[subject.name, record.frame].append(name if name in known else "")

    def label_first(self, subjects: Sequence[str], frames: Sequence[int], times_s: Sequence[float]) -> list[LabelBlock]:
        """The blocks of these frames that are worth a label most: :func:`label_first`."""
        answers = {name: [self._answers.get((name, frame), ()) for frame in frames] for name in subjects}
        return label_first(answers, times_s)

    def predict(self, frame: int, subject: str) -> Prediction | None:
        """The prediction; None if the run has no such frame or subject, could compute nothing, or hit nothing."""
        if (record := self.records.get(frame)) is None:
            return None
        person = next((person for person in record.subjects if person.name == subject), None)
        if person is None or person.missing or (person.focus is None and not self._says_nowhere):
            return None
        target = NOWHERE if person.focus is None else record.target(person.focus).name
        if self._has_probabilities:
            chances = name_probabilities(record, person)
            attention = chances.pop(target, 0.0)
            return Prediction(target=target, attention=attention, margin=attention - max(chances.values(), default=0.0))
        if person.focus is None:
            return Prediction(target=NOWHERE, attention=0.0, margin=0.0)
        totals = sorted((attention.total for attention in person.attention), reverse=True)
        first, second = (*totals, 0.0, 0.0)[:2]
        return Prediction(target=target, attention=first, margin=first - second)

    def order(self, frames: Sequence[int], subject: str) -> list[int]:
        """Positions of the frames, the most uncertain first; frames without a prediction come before all others."""
        margins = [prediction.margin if (prediction := self.predict(n, subject)) else -1.0 for n in frames]
        return sorted(range(len(frames)), key=lambda position: (margins[position], position))
