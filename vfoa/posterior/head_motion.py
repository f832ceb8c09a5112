"""The goal of a head and its motion there: a Kalman filter for each head hypothesis and target.

If a person looks at a target, the head moves from its position to a goal: a share of the way from where the
body faces to the target.

goal      = share of the way + rest + aside
head'     = head + (1 - exp(-dt / lag)) (goal - head)
measured  = head + noise

rest      offset of the head's rest, and a bias of its model, from the assumed ones; the same in all looks
aside     offset from the goal at which the head stops; new in each look

All are angles to the right and down in the tangent plane of the share of the way. A person who looks at nowhere has no
target: the goal is anywhere about where the body faces, as far as ``NOWHERE_DEG``. Arrays are (K, T): hypotheses
by targets, the last of which is nowhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vfoa.posterior.gaze_error import Evidence, student
from vfoa.posterior.looks import Columns
from vfoa.types import Float

REST, ASIDE, HEAD = range(3)
_JITTER_RAD_PER_ROOT_S = float(np.deg2rad(1.7))
"""Motion of a head that has reached its goal, radians per root second."""
_PACE_SPREAD = 0.5
"""Relative uncertainty of the way that a head makes in one time constant: heads start late and at different speeds."""
_ASIDE_S = 20.0
"""Time in which the head's ``aside`` changes although the look goes on, seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadMotion:
    """Means (K, T, 3, 2) and covariances (K, T, 3, 3) of rest, aside and head."""

    means: Float
    covariances: Float


def first_motion(rest_variance: Float, aside_variance: Float) -> HeadMotion:
    """Return the state before the first frame, the head at its goal; variances (K, 1) of rest and (K, T) of aside."""
    covariances = np.zeros((*aside_variance.shape, 3, 3))
    covariances[..., [REST, REST, HEAD], [REST, HEAD, REST]] = rest_variance[..., None]
    covariances[..., [ASIDE, ASIDE, HEAD], [ASIDE, HEAD, ASIDE]] = aside_variance[..., None]
    covariances[..., HEAD, HEAD] = rest_variance + aside_variance
    return HeadMotion(means=np.zeros((*aside_variance.shape, 3, 2)), covariances=covariances)


def next_motion(
    before: HeadMotion,
    looked: Float,
    columns: Columns,
    stay: Float,
    last_offset: Float,
    noise: float,
    aside_variance: Float,
    dt_s: float,
    lag_s: float,
) -> HeadMotion:
    """Predict the next frame; ``last_offset`` (K, T, 2) is the last measured head minus the share of the way.

    ``looked`` (K, T') are the probabilities of the targets before, ``columns`` (T,) the column that each target had
    before, ``stay`` (K, T) the part of each that goes on; the remainder starts a new look at the head's last position.
    """
    rest = looked[:, None] @ before.means[:, :, REST]
    apart = before.means[:, :, REST] - rest
    new_means = np.zeros((*stay.shape, 3, 2))
    new_means[:, :, REST], new_means[:, :, HEAD] = rest, last_offset
    new_variances = np.full((*stay.shape, 3), noise)
    of_rest = looked * (before.covariances[..., REST, REST] + (apart**2).sum(axis=-1) / 2)
    new_variances[..., REST], new_variances[..., ASIDE] = of_rest.sum(axis=1, keepdims=True), aside_variance

    part = stay[..., None, None]
    difference = before.means[:, columns] - new_means
    covariances = part * before.covariances[:, columns]
    covariances += part * (1 - part) / 2 * (difference @ difference.swapaxes(-1, -2))
    covariances.reshape(*stay.shape, 9)[..., ::4] += (1 - part[..., 0]) * new_variances
    means = new_means + part * difference

    settle, move, step = _transition(dt_s, lag_s)
    moved = step @ means
    covariances = step @ covariances @ step.T
    covariances[..., ASIDE, ASIDE] += (1 - settle**2) * aside_variance
    # of the way in a time lag: over a time, it comes to about the same at every frame rate
    unsure = _PACE_SPREAD**2 / move * ((moved - means)[:, :, HEAD] ** 2).sum(axis=-1)
    covariances[..., HEAD, HEAD] += _JITTER_RAD_PER_ROOT_S**2 * dt_s + unsure
    return HeadMotion(means=moved, covariances=covariances)


@lru_cache(maxsize=64)
def _transition(dt_s: float, lag_s: float) -> tuple[float, float, Float]:
    """What is left of ``aside``, the part of the way to the goal that the head makes, and the step (3, 3) of a time."""
    settle, move = math.exp(-dt_s / _ASIDE_S), 1 - math.exp(-dt_s / lag_s)
    return settle, move, np.array([[1, 0, 0], [0, settle, 0], [move, move * settle, 1 - move]])


def weigh_head(predicted: HeadMotion, offset: Float, noise: float) -> tuple[HeadMotion, Evidence]:
    """Return the updated filter and the evidence (K, T) of a frame's head.

    ``offset`` (K, T, 2) is the measured head minus the share of the way to each target, ``noise`` its variance.
    """
    to_all = predicted.covariances[..., HEAD]
    surprise = offset - predicted.means[:, :, HEAD]
    evidence, weighed = student((surprise**2).sum(axis=-1), to_all[..., HEAD], noise)
    gain = to_all / weighed[..., None]
    after = HeadMotion(
        means=predicted.means + gain[..., None] * surprise[:, :, None],
        covariances=predicted.covariances - gain[..., None] * to_all[..., None, :],
    )
    return after, evidence
