"""The offset of the measured gaze from a target: a Kalman filter for each gaze hypothesis and target.

measured - target - bias of the hypothesis = constant + drift + noise

constant   the rest of the bias, the same in all looks
drift      the slow part of the error, and the point of the target where the eyes rest; the latter is new in each look
noise      new in each frame, with the tails of Student's distribution

All are angles to the right and down in the tangent plane of the target. Covariances are the same in both directions.
Arrays are (G, T): hypotheses by targets, the last of which is nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfoa.posterior.looks import Columns
from vfoa.types import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class GazeError:
    """Means (2, 2, G, T) of the constant and of the drift, right and down, and their covariances (3, G, T).

    The covariances are the variance of the constant, that of both, and the variance of the drift. ``lasting`` (G, T) is
    the part of the variance of the drift that is the error's and outlasts a look; the rest is the point of the target.
    """

    means: Float
    covariances: Float
    lasting: Float

    def kept(self, rows: np.ndarray) -> GazeError:
        """Return only these rows, the hypotheses to keep."""
        return GazeError(
            means=self.means[:, :, rows], covariances=self.covariances[:, rows], lasting=self.lasting[rows]
        )


def first_error(cell_variance: float, slow: Float, on_target: Float) -> GazeError:
    """Return the error before the first frame.

    ``slow`` (G, 1) is the variance of the slow part of the error, ``on_target`` (T,) that of the point on each target.
    """
    drift = slow + on_target
    covariances = np.zeros((3, *drift.shape))
    covariances[0], covariances[2] = cell_variance, drift
    return GazeError(means=np.zeros((2, 2, *drift.shape)), covariances=covariances, lasting=_lasting(slow, drift))


def _lasting(slow: Float, drift: Float) -> Float:
    return np.divide(slow, drift, out=np.ones(drift.shape), where=drift > 0)


def next_error(
    before: GazeError, looked: Float, columns: Columns, stay: Float, slow: Float, on_target: Float, keep: float
) -> GazeError:
    """Predict the error of the next frame: looks that go on keep it, new looks start from the mean over all targets.

    ``looked`` (G, T') are the probabilities of the targets before, ``columns`` (T,) the column that each target had
    before, ``stay`` (G, T) the part of each that goes on, and ``keep`` the factor of the drift over the frame; ``slow``
    and ``on_target`` as in :func:`first_error`. Of the drift at the end of a look, the part ``lasting`` is the error's
    and goes over to the next look; the point on the next target is new. Mixtures are collapsed (Blom and Bar-Shalom
    1988).
    """
    drift = slow + on_target
    constant, lasting = before.means[0], before.lasting * before.means[1]
    new = np.stack([np.einsum("gt,xgt->xg", looked, each) for each in (constant, lasting)])[..., None]
    of_constant = before.covariances[0] + ((constant - new[0]) ** 2).sum(axis=0) / 2
    of_slow = before.lasting**2 * before.covariances[2] + slow * (1 - before.lasting)
    of_slow += ((lasting - new[1]) ** 2).sum(axis=0) / 2
    of_both = before.lasting * before.covariances[1] + ((constant - new[0]) * (lasting - new[1])).sum(axis=0) / 2
    variance, both_variance, slow_variance = (
        np.einsum("gt,gt->g", looked, each)[:, None] for each in (of_constant, of_both, of_slow)
    )
    leave = 1 - stay
    apart = before.means[..., columns] - new
    means = new + stay * apart
    means[1] *= keep
    covariances = stay * before.covariances[..., columns]
    covariances[0] += leave * variance
    covariances[1] += leave * both_variance
    covariances[2] += leave * (slow_variance + on_target)
    both = stay * leave / 2
    covariances[:2] += both * (apart[0] * apart).sum(axis=1)
    covariances[2] += both * (apart[1] ** 2).sum(axis=0)
    covariances[1] *= keep
    covariances[2] *= keep**2
    covariances[2] += (1 - keep**2) * drift
    return GazeError(means=means, covariances=covariances, lasting=_lasting(slow, drift))


@dataclass(frozen=True, slots=True)
class Evidence:
    """Log likelihood (H, T), and the probability (H, T) of a worse fit; zeros and ones where nothing was measured."""

    likelihood: Float
    tail: Float

    @classmethod
    def none(cls, hypotheses: int, targets: int) -> Evidence:
        """The evidence of a cue that was not measured."""
        return cls(np.zeros((hypotheses, targets)), np.ones((hypotheses, targets)))


TAILS = 4.0
"""Degrees of freedom of the Student distribution of the errors of gaze and head."""


def student(surprise_square: Float, known: Float, noise: float | Float) -> tuple[Evidence, Float]:
    """Evidence of an innovation with the squared length (H, T), and its variance (H, T) as the filter's gain takes it.

    ``known`` (H, T) is the variance of what was predicted, ``noise`` that of the measurement. Student's distribution
    limits the weight of an outlier.
    """
    square = surprise_square / (known + noise)
    excess = np.log1p(square / TAILS)
    likelihood = -np.log(known + noise) - (TAILS + 2) / 2 * excess
    weighed = known + noise * (TAILS + square) / (TAILS + 2)
    return Evidence(likelihood, np.exp(-TAILS / 2 * excess)), weighed


_FIRST, _SECOND = [0, 0, 1], [0, 1, 1]
"""The two parts of the error whose covariance each of the covariances of :class:`GazeError` is."""


def weigh_gaze(predicted: GazeError, offset: Float, noise: Float) -> tuple[GazeError, Evidence]:
    """Return the updated filter and the evidence (G, T) of a frame's gaze.

    ``offset`` (2, G, T) is measured gaze - target - bias, ``noise`` (G, 1) its variance.
    """
    to_parts = predicted.covariances[:2] + predicted.covariances[1:]
    surprise = offset - predicted.means[0] - predicted.means[1]
    evidence, weighed = student((surprise**2).sum(axis=0), to_parts[0] + to_parts[1], noise)
    gain = to_parts / weighed
    after = GazeError(
        means=predicted.means + gain[:, None] * surprise,
        covariances=predicted.covariances - gain.take(_FIRST, axis=0) * to_parts.take(_SECOND, axis=0),
        lasting=predicted.lasting,
    )
    return after, evidence
