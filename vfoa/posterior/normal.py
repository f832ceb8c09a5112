"""Normal distributions for each target and hypothesis, and the steps of a switching Kalman filter over them.

The state has P parts: offsets, each an angle to the right and one down in the tangent plane of a target. Covariances
are the same in both directions. Arrays end in (T, H): targets, the last of which is nowhere, by hypotheses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfoa.posterior.looks import Transition
from vfoa.types import Float


@dataclass(frozen=True, slots=True)
class Normal:
    """Means (P, 2, T, H) of the parts, right and down, and their covariances (P, P, T, H)."""

    means: Float
    covariances: Float


def pooled(states: Normal, shares: Float) -> Normal:
    """Collapse the targets with their shares (T, H) into one (T = 1)."""
    means = (states.means * shares).sum(axis=2, keepdims=True)
    covariances = states.covariances + _products(states.means - means)
    return Normal(means, (covariances * shares).sum(axis=2, keepdims=True))


def mixed(before: Normal, new: Normal, transition: Transition) -> Normal:
    """Collapse the state before, of looks that go on, and that of new looks (Blom and Bar-Shalom 1988)."""
    columns, stay = transition.columns, transition.stay
    apart = before.means[:, :, columns] - new.means
    spread = before.covariances[:, :, columns] - new.covariances + (1 - stay) * _products(apart)
    return Normal(new.means + stay * apart, new.covariances + stay * spread)


def _products(means: Float) -> Float:
    """The products (P, P, T, H) of the parts, a mean over the two directions."""
    right, down = means[:, 0], means[:, 1]
    return (right[:, None] * right + down[:, None] * down) / 2


@dataclass(frozen=True, slots=True)
class Evidence:
    """Likelihood (T, H), up to a factor, and the probability of a worse fit before the frame is seen."""

    likelihood: Float
    tail: float


NO_EVIDENCE = Evidence(np.ones((1, 1)), 1.0)
"""The evidence of a cue that was not measured."""
TAILS = 4.0
"""Degrees of freedom of the Student distribution of the errors of gaze and head."""


def weighed(
    predicted: Normal, chance: Float, seen: slice, offset: Float, noise: float | Float
) -> tuple[Normal, Evidence]:
    """Update with a measured ``offset`` (2, T, H): the sum of the parts ``seen`` and a noise of this variance (H,).

    ``chance`` (T, H) are the joint probabilities of target and hypothesis before. Student's distribution limits the
    weight of an outlier.
    """
    to_parts = predicted.covariances[:, seen].sum(axis=1)
    surprise = offset - predicted.means[seen].sum(axis=0)
    known = to_parts[seen].sum(axis=0)
    total = TAILS * (known + noise)
    heavy = total + surprise[0] ** 2 + surprise[1] ** 2
    excess = heavy / total
    tail = (1 / excess) ** (TAILS / 2)
    gain = to_parts / (known + noise * TAILS / (TAILS + 2) * excess)
    after = Normal(
        predicted.means + gain[:, None] * surprise,
        predicted.covariances - gain[:, None] * to_parts,
    )
    return after, Evidence(tail / heavy, float(np.vdot(chance, tail)))
