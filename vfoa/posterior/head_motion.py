"""The goal of a head and its motion there: a Kalman filter for each target and head hypothesis.

If a person looks at a target, the head moves from its position to a goal: a share of the way from where the
body faces to the target.

goal      = share of the way + rest + aside
head'     = head + (1 - exp(-dt / lag)) (goal - head)
measured  = head + noise

rest      offset of the head's rest, and a bias of its model, from the assumed ones; the same in all looks
aside     offset from the goal at which the head stops; new in each look

All are angles to the right and down in the tangent plane of the share of the way. A person who looks at nowhere has no
target: the goal is anywhere about where the body faces, as far as ``NOWHERE_DEG``. Arrays are (T, K): targets, the
last of which is nowhere, by hypotheses.
"""

from __future__ import annotations

import math

import numpy as np

from vfoa.posterior.looks import Transition
from vfoa.posterior.normal import Normal, mixed, pooled
from vfoa.types import Float

REST, ASIDE, HEAD = range(3)
MEASURED = slice(HEAD, None)
"""The parts of which a measured head is the sum."""
_JITTER_RAD_PER_ROOT_S = float(np.deg2rad(1.7))
"""Motion of a head that has reached its goal, radians per root second."""
_PACE_SPREAD = 0.5
"""Relative uncertainty of the way that a head makes in one time constant: heads start late and at different speeds."""
_ASIDE_S = 20.0
"""Time in which the head's ``aside`` changes although the look goes on, seconds."""


def first_motion(rest_variance: Float, aside_variance: Float) -> Normal:
    """Return the state before the first frame, the head at its goal; variances (K,) of rest and (T, K) of aside."""
    covariances = np.zeros((3, 3, *aside_variance.shape))
    covariances[[REST, REST, HEAD], [REST, HEAD, REST]] = rest_variance
    covariances[[ASIDE, ASIDE, HEAD], [ASIDE, HEAD, ASIDE]] = aside_variance
    covariances[HEAD, HEAD] = rest_variance + aside_variance
    return Normal(np.zeros((3, 2, *aside_variance.shape)), covariances)


def next_motion(
    before: Normal,
    transition: Transition,
    last_offset: Float,
    noise: float,
    aside_variance: Float,
    dt_s: float,
    lag_s: float,
) -> Normal:
    """Predict the next frame; ``last_offset`` (2, T, K) is the last measured head minus the share of the way.

    New looks start at the head's last position.
    """
    rest = pooled(Normal(before.means[:1], before.covariances[:1, :1]), transition.looked)
    new = Normal(np.zeros((3, *last_offset.shape)), np.zeros((3, 3, *aside_variance.shape)))
    new.means[REST], new.means[HEAD] = rest.means[0], last_offset
    new.covariances[REST, REST], new.covariances[ASIDE, ASIDE] = rest.covariances[0, 0], aside_variance
    new.covariances[HEAD, HEAD] = noise
    state = mixed(before, new, transition)

    settle, move = math.exp(-dt_s / _ASIDE_S), 1 - math.exp(-dt_s / lag_s)
    step = np.array([[1, 0, 0], [0, settle, 0], [move, move * settle, 1 - move]])
    of_pairs = np.einsum("ik,jl->ijkl", step, step).reshape(9, 9)
    means = (step @ state.means.reshape(3, -1)).reshape(state.means.shape)
    covariances = (of_pairs @ state.covariances.reshape(9, -1)).reshape(state.covariances.shape)
    covariances[ASIDE, ASIDE] += (1 - settle**2) * aside_variance
    # of the way in a time lag: over a time, it comes to about the same at every frame rate
    right, down = means[HEAD] - state.means[HEAD]
    covariances[HEAD, HEAD] += _JITTER_RAD_PER_ROOT_S**2 * dt_s + _PACE_SPREAD**2 / move * (right**2 + down**2)
    return Normal(means, covariances)
