"""Settings of the posterior: assumptions about errors, heads and looks."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.settings import Settings

MEAN_ANGLE_PER_SIGMA = float(np.sqrt(np.pi / 2))
"""Mean angle of an error over its standard deviation in each tangent direction (Rayleigh)."""


def sigma_rad(error_deg: float) -> float:
    """The standard deviation per tangent direction of an error with this mean angle."""
    return float(np.deg2rad(error_deg)) / MEAN_ANGLE_PER_SIGMA


class GazeErrorSettings(Settings):
    """Prior of the gaze error. Angles are mean angles in degrees."""

    error: Literal["unknown", "told"] = "unknown"
    """``unknown`` takes the claimed error as a prior and learns its scale, a bias and a gain; ``told`` as true."""
    spread: Literal["model", "published"] = "model"
    """The claimed error: what the ``model`` states for each direction, where it does, or always the published one."""
    gaze_error_deg: float = Field(default=11.1, gt=0, le=60)
    """Published mean angle of the gaze error."""
    head_error_deg: float = Field(default=5.0, gt=0, le=60)
    """Published mean angle of the head-pose error."""
    scale_spread: float = Field(default=0.7, gt=0, le=3)
    """Standard deviation of the natural logarithm of the true gaze error over the claimed one."""
    unbiased: float = Field(default=0.3, ge=0, lt=1)
    """Prior probability that the gaze of a person has no constant bias."""
    bias_deg: float = Field(default=18.0, gt=0, le=60)
    """Mean angle of the constant bias where there is one."""
    bias_share: float = Field(default=0.35, ge=0, lt=1)
    """Share of the variance of the error that drifts; the rest is new in each frame."""
    bias_s: float = Field(default=0.8, gt=0)
    """Time within which the drifting part is forgotten."""
    tails: float = Field(default=5.0, gt=2)
    """Degrees of freedom of the Student distribution of the errors."""
    temperature: float = Field(default=1.4, ge=1, le=10)
    """Where a gaze of ``unknown`` error was measured, probabilities are raised to the power 1 / temperature: the model
    is also wrong in ways that it has no hypothesis for (temperature scaling, Guo et al. 2017)."""
    smoothed_temperature: float = Field(default=2.0, ge=1, le=10)
    """The same where later frames are known: they are wrong in the same ways once more."""
    evidence: float = Field(default=0.7, gt=0, le=1)
    """Power of what every frame but the first says of the error (not of the target): errors last in more ways than
    the model has, so that frames in a row say less of them than as many apart."""


class HeadSettings(Settings):
    """How heads follow what is looked at. Angles are mean angles in degrees."""

    head_share: float = Field(default=0.65, gt=0, le=1)
    """Share of the way from rest to the target that the head turns; the middle of three if the error is unknown."""
    head_lag_s: float = Field(default=0.35, gt=0)
    """Time constant with which the head gets there."""
    aside_deg: float = Field(default=9.0, gt=0, le=90)
    """How far from there the head stops, new in each look."""
    rest_deg: float = Field(default=30.0, gt=0, le=90)
    """How far the head's rest is from the middle of all targets."""
    head_evidence: float = Field(default=0.5, gt=0, le=1)
    """Power of the likelihood of the head in every frame but the first: how a head moves is known only roughly, and it
    is as wrong in the next frame."""
    nowhere_deg: float = Field(default=35.0, gt=0, le=90)
    """How far from the middle of all targets heads point that look at none of them."""
    about_head_deg: float = Field(default=20.0, gt=0, le=90)
    """How far the gaze is from the head where it is on no target."""


class LookSettings(Settings):
    """How long people look, and how often at nothing: priors, which every person's own looks correct.

    Conversations with a robot and paintings have a mean of 3.33 s and a median of 1.68 s (Vernissage, 2,037 intervals);
    looks at things on a table are shorter. The prior is short: it is worse to miss a change than to expect one more,
    and long looks correct it.
    """

    p_nowhere: float = Field(default=0.2, gt=0, lt=1)
    """Prior share of looks at no target."""
    nowhere_looks: float = Field(default=6.0, gt=0)
    """Number of looks that ``p_nowhere`` is worth."""
    dwell_s: float = Field(default=1.0, gt=0)
    """Prior mean time of a look."""
    dwell_looks: float = Field(default=3.0, gt=0)
    """Number of looks that ``dwell_s`` is worth."""


class PosteriorSettings(GazeErrorSettings, HeadSettings, LookSettings):
    """All that the filter assumes."""

    cues: Literal["both", "gaze", "head"] = "both"
    """Which of the measured directions are used."""
