"""Answers in sets: the fewest objects, nowhere among them, that have 90 % of a subject's probability together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from harness.labels.files import IGNORED, Labels
from harness.run.records import FrameRecord, SubjectRecord
from harness.score.verdicts import find_subject, right_answers

LEVEL = 0.9
"""The probability that a set has at least."""

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class SetCoverage:
    """How often one configuration's sets hold the truth, and how many objects they hold, over ``n`` scored frames."""

    configuration: str
    n: int
    covered: int
    mean_size: float


def prediction_set(subject: SubjectRecord) -> tuple[int | None, ...] | None:
    """Instance ids of the smallest set, the likeliest first; None stands for nowhere. None: no probabilities.

    Of equally likely objects those with the lower id come first, and nowhere last.
    """
    if subject.fit is None or not subject.attention:
        return None
    probabilities: dict[int | None, float] = {value.instance_id: value.total for value in subject.attention}
    probabilities[None] = max(0.0, 1 - sum(probabilities.values()))
    ranked = sorted(probabilities, key=lambda key: (-probabilities[key], key is None, key or 0))
    reached = np.cumsum([probabilities[key] for key in ranked])
    return tuple(ranked[: 1 + int(np.argmax(reached >= LEVEL * reached[-1] - _ROUNDING))])


class SetLog:
    """Keeps the sets of the scored frames while records pass by."""

    def __init__(self, labels_by_clip: Mapping[str, Labels]) -> None:
        self._labels = labels_by_clip
        self._found: dict[str, list[tuple[bool, int]]] = {}

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Hand the records on."""
        for record in records:
            labels = self._labels.get(record.clip)
            for _, name, label in labels.labelled([record.frame]) if labels is not None else ():
                subject = find_subject(record, name)
                held = None if subject is None or label.target == IGNORED else prediction_set(subject)
                if held is not None:
                    covered = not set(held).isdisjoint(right_answers(record, label))
                    self._found.setdefault(record.configuration, []).append((covered, len(held)))
            yield record

    def part(self, configuration: str) -> list[tuple[bool, int]]:
        """What was found so far of a configuration: covered or not, and the size, for another log."""
        return self._found.get(configuration, [])

    def add(self, configuration: str, found: list[tuple[bool, int]]) -> None:
        """Take over a part of another log."""
        if found:
            self._found.setdefault(configuration, []).extend(found)

    def coverages(self) -> list[SetCoverage]:
        """One for each configuration that gives probabilities."""
        return [
            SetCoverage(
                configuration=name,
                n=len(found),
                covered=sum(covered for covered, _ in found),
                mean_size=float(np.mean([size for _, size in found])),
            )
            for name, found in self._found.items()
        ]
