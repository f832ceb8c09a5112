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

from vfoa.types import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class GazeError:
    """Means (2, G, T) of the constant and the drift, and their covariances (G, T)."""

    constant: Float
    drift: Float
    cc: Float
    cd: Float
    dd: Float

    def kept(self, rows: np.ndarray) -> GazeError:
        """Return only these rows, the hypotheses to keep."""
        return GazeError(
            constant=self.constant[:, rows],
            drift=self.drift[:, rows],
            cc=self.cc[rows],
            cd=self.cd[rows],
            dd=self.dd[rows],
        )


def first_error(cell_variance: float, drift_variance: Float) -> GazeError:
    """Return the error before the first frame; ``drift_variance`` (G, T) includes the spread of looks at a target."""
    zeros = np.zeros((2, *drift_variance.shape))
    return GazeError(
        constant=zeros,
        drift=zeros,
        cc=np.full(drift_variance.shape, cell_variance),
        cd=zeros[0],
        dd=drift_variance,
    )


def next_error(
    before: GazeError, looked: Float, columns: np.ndarray, stay: Float, slow: Float, drift_variance: Float, keep: float
) -> GazeError:
    """Predict the error of the next frame: looks that go on keep it, new looks start from the mean over all targets.

    ``looked`` (G, T') are the probabilities of the targets before, ``columns`` (T,) the column that each target had
    before, ``stay`` (G, T) the part of each that goes on. ``slow`` (G, 1) is the variance of the drift that outlasts a
    look, and ``keep`` the factor of the drift over the frame. Mixtures are collapsed (Blom and Bar-Shalom 1988).
    """
    constant = (looked * before.constant).sum(axis=2)[..., None]
    around = ((before.constant - constant) ** 2).sum(axis=0) / 2
    variance = (looked * (before.cc + around)).sum(axis=1)[:, None]
    drift = slow / np.maximum(drift_variance, 1e-12) * (looked * before.drift).sum(axis=2)[..., None]
    leave = 1 - stay
    both = stay * leave / 2
    apart_c, apart_d = before.constant[..., columns] - constant, before.drift[..., columns] - drift
    cd = stay * before.cd[:, columns] + both * (apart_c * apart_d).sum(axis=0)
    dd = stay * before.dd[:, columns] + leave * drift_variance + both * (apart_d**2).sum(axis=0)
    return GazeError(
        constant=constant + stay * apart_c,
        drift=keep * (drift + stay * apart_d),
        cc=stay * before.cc[:, columns] + leave * variance + both * (apart_c**2).sum(axis=0),
        cd=keep * cd,
        dd=keep**2 * dd + (1 - keep**2) * drift_variance,
    )


def weigh_gaze(predicted: GazeError, offset: Float, noise: Float, tails: float) -> tuple[GazeError, Float, Float]:
    """Return the updated filter, the log likelihood (G, T) and the squared innovation (G, T) in standard deviations.

    ``offset`` (2, G, T) is measured gaze - target - bias, ``noise`` (G, 1) its variance. Student's distribution limits
    the weight of an outlier.
    """
    to_constant, to_drift = predicted.cc + predicted.cd, predicted.cd + predicted.dd
    known = to_constant + to_drift
    surprise = offset - predicted.constant - predicted.drift
    square = (surprise**2).sum(axis=0) / (known + noise)
    likelihood = -np.log(known + noise) - (tails + 2) / 2 * np.log1p(square / tails)
    spread = known + noise * (tails + square) / (tails + 2)
    gain_c, gain_d = to_constant / spread, to_drift / spread
    after = GazeError(
        constant=predicted.constant + gain_c * surprise,
        drift=predicted.drift + gain_d * surprise,
        cc=predicted.cc - gain_c * to_constant,
        cd=predicted.cd - gain_c * to_drift,
        dd=predicted.dd - gain_d * to_drift,
    )
    return after, likelihood, square
