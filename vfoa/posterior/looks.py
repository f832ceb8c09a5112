"""How long people look, and how often at no target: a hidden Markov model that learns both for each person.

Looks end at a rate. The next look is at nowhere with some probability, or else at any target, including the same one.
Rate and probability have a prior (Gamma and Beta) and are updated by the expected number of looks.

Looks in conversations with a robot and paintings have a mean of 3.33 s and a median of 1.68 s (Vernissage, 2,037
intervals); looks at things on a table are shorter. The prior is short: a missed change is worse than an expected one,
and long looks correct the prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vfoa.types import Float

P_NOWHERE = 0.35
"""Prior share of looks at no target: 5 to 20 % in conversations, 46 to 77 % of people who act."""
NOWHERE_LOOKS = 2.0
"""Weight of ``P_NOWHERE``, as a number of looks."""
DWELL_S = 1.0
"""Prior mean time of a look, seconds."""
DWELL_LOOKS = 3.0
"""Weight of ``DWELL_S``, as a number of looks."""

LEAST = 1e-300
"""What probabilities are divided by, at least."""

Keys = tuple[int | None, ...]
"""Ids of targets; the last key is None, which stands for nowhere."""
Columns = NDArray[np.intp] | slice
"""The column (T,) that each target had before; a slice if all are as they were."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LookCounts:
    """Expected values (...,) of the looks begun, and of those at nowhere; and the seconds watched."""

    begun: Float
    nowhere: Float
    watched_s: float

    def after(self, begun: Float, nowhere: Float, dt_s: float) -> LookCounts:
        """Return the counts after a frame: probabilities (...) that a look began in it, and that one at nowhere did."""
        return LookCounts(begun=self.begun + begun, nowhere=self.nowhere + nowhere, watched_s=self.watched_s + dt_s)


def no_looks() -> LookCounts:
    """Return the counts (1, 1) before the first frame."""
    return LookCounts(begun=np.zeros((1, 1)), nowhere=np.zeros((1, 1)), watched_s=0.0)


def new_look(looks: LookCounts, count: int) -> Float:
    """Probabilities (count + 1, ...) of the target of a new look: equal for all targets, and that of nowhere last."""
    new = np.ones((count + 1, *looks.begun.shape))
    if count:
        new[-1] = (P_NOWHERE * NOWHERE_LOOKS + looks.nowhere) / (NOWHERE_LOOKS + looks.begun)
        new[:-1] = (1 - new[-1]) / count
    return new


def leaving(looks: LookCounts, dt_s: float) -> Float:
    """Probability (...,) that a look ends within the time."""
    return np.asarray(-np.expm1(-dt_s * (DWELL_LOOKS + looks.begun) / (DWELL_LOOKS * DWELL_S + looks.watched_s)))


def columns_of(before: Keys, keys: Keys) -> tuple[Columns, NDArray[np.bool_] | None]:
    """The column that each key had before, and whether (T,) it existed then; None: all did."""
    if keys == before:
        return slice(None), None
    index = {key: column for column, key in enumerate(before)}
    known = np.array([key in index for key in keys])
    return np.array([index.get(key, 0) for key in keys]), None if known.all() else known


class Transition(NamedTuple):
    """The way from the targets before to those of the frame, for H hypotheses.

    ``looked`` (T', H) are the probabilities of the targets before under each hypothesis, and ``columns`` (T,) the place
    of each target of the frame among them. ``stay`` (T, H) is the part of each target's probability before the frame is
    seen that comes from looks that go on; ``predicted`` (T, H) are the joint probabilities of target and hypothesis.
    """

    columns: Columns
    looked: Float
    stay: Float
    predicted: Float


HEADS, GAZES = 1, 2
"""The axes of the hypotheses about the head and about the gaze."""


class Ways(NamedTuple):
    """The way from the targets before to those of the frame: joint probabilities of a target and both hypotheses.

    ``looked`` (T', K, G) are those of the targets before, ``predicted`` (T, K, G) those of the targets of the frame
    before it is seen, and ``stayed`` the part of these that comes from looks that go on; ``columns`` as in
    :class:`Transition`.
    """

    columns: Columns
    looked: Float
    stayed: Float
    predicted: Float

    def over(self, axis: int) -> Transition:
        """Return the transition under one cue's hypotheses: a mean over those of the other, on this axis."""
        looked, stayed, predicted = (each.sum(axis=axis) for each in self[1:])
        given = looked / np.maximum(looked.sum(axis=0), LEAST)
        return Transition(self.columns, given, stayed / np.maximum(predicted, LEAST), predicted)


def predicted_looks(
    looked: Float, columns: Columns, known: NDArray[np.bool_] | None, leave: Float, new: Float
) -> tuple[Float, Float]:
    """Probabilities (T, ...) before the next frame, and the part (T, ...) of them that stayed.

    The probability of targets that are gone is spread as for a new look.
    """
    stayed = (1 - leave) * looked[columns]
    if known is not None:
        stayed[~known] = 0
    return stayed + (1 - stayed.sum(axis=0)) * new, stayed
