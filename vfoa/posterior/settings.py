"""Settings of the posterior: assumptions about errors, heads and looks."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.settings import Settings

MEAN_ANGLE_PER_SIGMA = float(np.sqrt(np.pi / 2))
"""Mean angle of an error over its standard deviation in each tangent direction (Rayleigh)."""


def sigma_rad(error_deg: float) -> float:
    """Standard deviation per tangent direction, radians, of an error with this mean angle in degrees."""
    return float(np.deg2rad(error_deg)) / MEAN_ANGLE_PER_SIGMA


class GazeErrorSettings(Settings):
    """Prior of the gaze error. Angles are mean angles in degrees."""

    error: Literal["unknown", "told"] = "unknown"
    """``unknown``: the claimed error is a prior; scale, bias and gain are learned. ``told``: it is true."""
    spread: Literal["model", "published"] = "model"
    """Claimed error. ``model``: the model's value for a direction if it gives one; ``published``: the published one."""
    gaze_error_deg: float = Field(default=11.1, gt=0, le=60)
    """Published mean angle of the gaze error."""
    head_error_deg: float = Field(default=5.0, gt=0, le=60)
    """Published mean angle of the head-pose error."""
    bias_share: float = Field(default=0.35, ge=0, lt=1)
    """Share of the variance of the error that drifts; the rest is new in each frame."""
    bias_s: float = Field(default=0.8, gt=0)
    """Time within which the drifting part is forgotten."""
    tails: float = Field(default=4.0, gt=2)
    """Degrees of freedom of the Student distribution of the errors."""
    evidence: float = Field(default=0.7, gt=0, le=1)
    """Power of the likelihood of the error (not of the target) in every frame but the first: consecutive frames carry
    less information about the error than independent ones, because errors last."""


class HeadSettings(Settings):
    """How heads follow the target of a look. Angles are mean angles in degrees."""

    head_share: float = Field(default=0.65, gt=0, le=1)
    """Share of the way from where the body faces to the target that the head turns; the middle of three if the error
    is unknown. People: 0.35 to 0.75 in held gazes (16 people of vr_objects)."""
    aside_deg: float = Field(default=5.0, gt=0, le=90)
    """Offset from that share at which the head stops; new in each look."""
    rest_deg: float = Field(default=20.0, gt=0, le=90)
    """Constant offset of a person's head from where the body faces."""
    nowhere_deg: float = Field(default=35.0, gt=0, le=90)
    """Angle between where the body faces and a head that looks at no target."""


class LookSettings(Settings):
    """How long people look, and how often at nothing: priors, which every person's own looks update.

    Looks in conversations with a robot and paintings have a mean of 3.33 s and a median of 1.68 s (Vernissage, 2,037
    intervals); looks at things on a table are shorter. The prior is short: a missed change is worse than an expected
    one, and long looks correct the prior.
    """

    p_nowhere: float = Field(default=0.35, gt=0, lt=1)
    """Prior share of looks at no target: 5 to 20 % in conversations, 46 to 77 % of people who act."""
    nowhere_looks: float = Field(default=2.0, gt=0)
    """Weight of ``p_nowhere``, as a number of looks."""
    dwell_s: float = Field(default=1.0, gt=0)
    """Prior mean time of a look."""
    dwell_looks: float = Field(default=3.0, gt=0)
    """Weight of ``dwell_s``, as a number of looks."""


class PosteriorSettings(GazeErrorSettings, HeadSettings, LookSettings):
    """All assumptions of the filter."""
