"""Kalman filters of the gaze's error and of the head's motion, one for each target and hypothesis.

The state of a filter has P parts: offsets, each an angle to the right and one down in the tangent plane of a target (of
the head: of the share of the way to it). Covariances are the same in both directions. Arrays end in (T, H): targets,
the last of which is nowhere, by hypotheses; H is G for the gaze and K for the head.
"""

from __future__ import annotations

import math
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
    means = np.einsum("pdth,th->pdh", states.means, shares)[:, :, None]
    covariances = states.covariances + _products(states.means - means)
    return Normal(means, np.einsum("pqth,th->pqh", covariances, shares)[:, :, None])


def mixed(before: Normal, new: Normal, transition: Transition) -> Normal:
    """Collapse the state before, of looks that go on, and that of new looks (Blom and Bar-Shalom 1988)."""
    columns, stay = transition.columns, transition.stay
    apart = before.means[:, :, columns] - new.means
    spread = before.covariances[:, :, columns] - new.covariances + (1 - stay) * _products(apart)
    return Normal(new.means + stay * apart, new.covariances + stay * spread)


def _products(means: Float) -> Float:
    """The products (P, P, T, H) of the parts, a mean over the two directions."""
    return np.einsum("pdth,qdth->pqth", means, means) / 2


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


# The gaze: measured - target - bias of the hypothesis = constant + drift + noise
#
# constant  the rest of the bias, the same in all looks
# drift     the slow part of the error, and the point of the target where the eyes rest; the latter is new in each look
# noise     new in each frame, with the tails of Student's distribution

CONSTANT, DRIFT = range(2)
GAZE_PARTS = slice(None)
"""The parts of which a measured gaze is the sum."""


@dataclass(frozen=True, slots=True)
class GazeError:
    """Constant and drift, and the part (T, G) of the variance of the drift that is the error's and outlasts a look.

    The rest of the drift is the point of the target.
    """

    state: Normal
    lasting: Float

    def kept(self, rows: np.ndarray) -> GazeError:
        """Return only these hypotheses."""
        state = Normal(self.state.means[..., rows], self.state.covariances[..., rows])
        return GazeError(state, self.lasting[..., rows])


def first_error(cell_variance: float, slow: Float, on_target: Float) -> GazeError:
    """Return the error before the first frame.

    ``slow`` (G,) is the variance of the slow part of the error, ``on_target`` (T, 1) that of the point on each target.
    """
    drift = slow + on_target
    covariances = np.zeros((2, 2, *drift.shape))
    covariances[CONSTANT, CONSTANT], covariances[DRIFT, DRIFT] = cell_variance, drift
    return GazeError(Normal(np.zeros((2, 2, *drift.shape)), covariances), slow / drift)


def next_error(before: GazeError, transition: Transition, slow: Float, on_target: Float, keep: float) -> GazeError:
    """Predict the error of the next frame: looks that go on keep it, new looks start from the mean over all targets.

    ``keep`` is the factor of the drift over the frame; ``slow`` and ``on_target`` as in :func:`first_error`. Of the
    drift at the end of a look, the part ``lasting`` is the error's and goes over to the next look; the point on the
    next target is new.
    """
    outlasting = Normal(before.state.means.copy(), before.state.covariances.copy())
    _scale_drift(outlasting, before.lasting)
    outlasting.covariances[DRIFT, DRIFT] += slow * (1 - before.lasting)
    state = mixed(before.state, pooled(outlasting, transition.looked), transition)
    state.covariances[DRIFT, DRIFT] += (1 - transition.stay) * on_target
    _scale_drift(state, keep)
    drift = slow + on_target
    state.covariances[DRIFT, DRIFT] += (1 - keep**2) * drift
    return GazeError(state, slow / drift)


def _scale_drift(state: Normal, factor: float | Float) -> None:
    state.means[DRIFT] *= factor
    state.covariances[DRIFT] *= factor
    state.covariances[:, DRIFT] *= factor


# The head: while a person looks at a target, it moves from its position to a goal, a share of the way from where the
# body faces to the target. A person who looks at nowhere has no target: the goal is anywhere about where the body
# faces.
#
# goal = share of the way + rest + aside;  head' = head + (1 - exp(-dt / lag)) (goal - head);  measured = head + noise
#
# rest      offset of the head's rest, and a bias of its model, from the assumed ones; the same in all looks
# aside     offset from the goal at which the head stops; new in each look

REST, ASIDE, HEAD = range(3)
HEAD_PARTS = slice(HEAD, None)
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
