"""The probabilities of a subject's answers in a frame: what they are worth against a label, and the smallest sets.

Brier's score (1950) is the squared distance of all probabilities from the truth, from 0 to 2. A *set* holds the fewest
answers, nowhere among them, that have :data:`SET_LEVEL` of the probability together.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from harness.labels.labels import Label
from harness.run.records import FrameRecord, SubjectRecord
from harness.score.verdicts import right_answers

SET_LEVEL = 0.9
"""The least probability of a set."""

_ROUNDING = 1e-9


class Worth(NamedTuple):
    """The probability of a subject's answer and of the true one, Brier's score, and the set; NaN where there is none.

    ``set_size`` is the number of answers in the set, ``is_covered`` says whether the true one is among them.
    """

    confidence: float = math.nan
    on_truth: float = math.nan
    brier: float = math.nan
    set_size: float = math.nan
    is_covered: bool = False


UNKNOWN_WORTH = Worth()
NO_PROBABILITIES = Worth(on_truth=0.0, brier=1.0)
"""A frame without an answer of a method that gives probabilities: it has none anywhere."""


def worth_of(record: FrameRecord, subject: SubjectRecord | None, label: Label, *, has_probabilities: bool) -> Worth:
    """What a subject's probabilities are worth. A true target that the frame does not have has probability 0."""
    worth = NO_PROBABILITIES if has_probabilities else UNKNOWN_WORTH
    if subject is None:
        return worth
    right = right_answers(record, label)
    if has_probabilities and subject.missing is None:
        chances = probabilities(subject)
        on_truth = sum(chances.get(key, 0.0) for key in right)
        brier = (1 - on_truth) ** 2 + sum(p**2 for key, p in chances.items() if key not in right)
        worth = Worth(min(chances[subject.focus], 1.0), on_truth, brier)
    if (held := prediction_set(subject)) is not None:
        worth = worth._replace(set_size=len(held), is_covered=not set(held).isdisjoint(right))
    return worth


def probabilities(subject: SubjectRecord) -> dict[int | None, float]:
    """The probability of each target by instance id. None stands for nowhere, which has the rest up to 1."""
    chances: dict[int | None, float] = {value.instance_id: value.total for value in subject.attention}
    chances[None] = max(0.0, 1 - sum(chances.values()))
    return chances


def prediction_set(subject: SubjectRecord) -> tuple[int | None, ...] | None:
    """Instance ids of the smallest set, the likeliest first; None stands for nowhere. None: no probabilities.

    Of equally likely objects those with the lower id come first, and nowhere last.
    """
    if subject.fit is None or not subject.attention:
        return None
    chances = probabilities(subject)
    ranked = sorted(chances, key=lambda key: (-chances[key], key is None, key or 0))
    reached = np.cumsum([chances[key] for key in ranked])
    return tuple(ranked[: 1 + int(np.argmax(reached >= SET_LEVEL * reached[-1] - _ROUNDING))])
