"""The hypotheses about the error of a gaze model and the share of the head, each kind with its prior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfoa.geometry import sigma_rad
from vfoa.types import Float

Error = Literal["unknown", "told"]
"""``unknown``: the claimed error is a prior; scale, bias and gain are learned. ``told``: it is true."""

_SCALE_SPREAD = 0.7
"""Standard deviation of the natural logarithm of the true gaze error over the claimed one."""
_SCALE_STEPS = (-1.15, -0.3, 0.45, 1.1, 1.75)
"""Nodes of the logarithm of the error's scale, in standard deviations. They reach farther up than down, since models
seldom do better than they claim on new material."""
_GAINS = ((1.0, 0.5), (0.8, 0.3), (0.6, 0.2))
"""Factor that remains of the angle between a direction and the direction to the camera, and its prior: models
underestimate that angle."""
_UNBIASED = 0.3
"""Prior probability that the gaze of a person has no constant bias."""
_BIAS_DEG = 18.0
"""Mean angle of the constant bias where there is one."""
_BIAS_SPACING_DEG = 12.0
_BIAS_RINGS = 2
_SHARE = 0.65
"""Share of the way from where the body faces to the target that the head turns if the error is told."""
_SHARE_STEPS = ((-0.3, 0.3), (0.0, 0.4), (0.3, 0.3))
"""Steps of the share about it, and their prior. People: 0.35 to 0.75 in held gazes (16 people of vr_objects). Nobody
has the largest share: see PLAUSIBLE_SHARE."""
PLAUSIBLE_SHARE = 0.8
"""Heads turn 0.35 to 0.75 of the way in held gazes (vr_objects). A larger implied share means that the targets do not
explain the head: it moves from near one target to near another while the eyes look elsewhere."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GazeHypotheses:
    """G hypotheses about the errors of a gaze model.

    ``scale`` (G,) of the claimed error, ``bias_rad`` (2, G) right and down, ``gain`` (G,) as a row of ``gains``, and
    ``log_prior`` (G,). ``cell_rad`` is the spread of the bias about each hypothesis, per direction. ``number`` (G,)
    increases, and stays with a hypothesis when others are dropped.
    """

    number: NDArray[np.intp]
    scale: Float
    bias_rad: Float
    gain: NDArray[np.intp]
    gains: tuple[float, ...]
    cell_rad: float
    log_prior: Float

    def kept(self, rows: NDArray[np.bool_]) -> GazeHypotheses:
        """Return only the hypotheses where ``rows`` (G,) is true."""
        return GazeHypotheses(
            number=self.number[rows],
            scale=self.scale[rows],
            bias_rad=self.bias_rad[:, rows],
            gain=self.gain[rows],
            gains=self.gains,
            cell_rad=self.cell_rad,
            log_prior=self.log_prior[rows],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadHypotheses:
    """K hypotheses of the share (K,) of the way to a target that a head turns, with ``log_prior`` (K,)."""

    share: Float
    log_prior: Float


@lru_cache(maxsize=2)
def gaze_hypotheses(error: Error) -> GazeHypotheses:
    """Return every combination of scale, bias and gain; a single hypothesis if the error is known (``told``)."""
    if error == "told":
        return GazeHypotheses(
            number=np.zeros(1, dtype=np.intp),
            scale=np.ones(1),
            bias_rad=np.zeros((2, 1)),
            gain=np.zeros(1, dtype=np.intp),
            gains=(1.0,),
            cell_rad=0.0,
            log_prior=np.zeros(1),
        )
    steps = np.array(_SCALE_STEPS)
    scale, scale_prior = np.exp(_SCALE_SPREAD * steps), _normalised(np.exp(-(steps**2) / 2))
    bias = np.deg2rad(_hexagons(_BIAS_SPACING_DEG, _BIAS_RINGS))
    gains, gain_prior = np.array(_GAINS).T
    rows = np.indices((len(scale), bias.shape[1], len(gains))).reshape(3, -1)
    prior = scale_prior[rows[0]] * _bias_prior(bias)[rows[1]] * gain_prior[rows[2]]
    return GazeHypotheses(
        number=np.arange(len(prior)),
        scale=scale[rows[0]],
        bias_rad=bias[:, rows[1]],
        gain=rows[2],
        gains=tuple(gains.tolist()),
        cell_rad=float(np.deg2rad(_BIAS_SPACING_DEG) / np.sqrt(12)),
        log_prior=np.log(_normalised(prior)),
    )


@lru_cache(maxsize=2)
def head_hypotheses(error: Error) -> HeadHypotheses:
    """Return every share; the middle one alone if the error is known (``told``)."""
    if error == "told":
        return HeadHypotheses(share=np.array([_SHARE]), log_prior=np.zeros(1))
    steps, prior = np.array(_SHARE_STEPS).T
    return HeadHypotheses(share=_SHARE + steps, log_prior=np.log(prior))


def _hexagons(spacing_deg: float, rings: int) -> Float:
    """Nodes (2, B) of a hexagonal lattice about 0."""
    whole = range(-rings, rings + 1)
    nodes = [(i + j / 2, j * np.sqrt(3) / 2) for i in whole for j in whole if abs(i + j) <= rings]
    return spacing_deg * np.array(nodes).T


def _bias_prior(bias: Float) -> Float:
    """Prior (B,) of the nodes: a mass at no bias, and a Student distribution with three degrees of freedom."""
    square = (bias**2).sum(axis=0)
    biased = _normalised((1 + square / (3 * sigma_rad(_BIAS_DEG) ** 2)) ** -2.5)
    return _UNBIASED * (square == square.min()) + (1 - _UNBIASED) * biased


def _normalised(weights: Float) -> Float:
    return np.asarray(weights / weights.sum())
