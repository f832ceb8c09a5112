"""The offset of the measured gaze from a target: a Kalman filter for each target and gaze hypothesis.

measured - target - bias of the hypothesis = constant + drift + noise

constant   the rest of the bias, the same in all looks
drift      the slow part of the error, and the point of the target where the eyes rest; the latter is new in each look
noise      new in each frame, with the tails of Student's distribution

All are angles to the right and down in the tangent plane of the target. Arrays are (T, G): targets, the last of which
is nowhere, by hypotheses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfoa.posterior.looks import Transition
from vfoa.posterior.normal import Normal, mixed, pooled
from vfoa.types import Float

CONSTANT, DRIFT = range(2)
BOTH = slice(None)
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
