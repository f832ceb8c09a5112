"""The likelihood of one frame's gaze for each hypothesis and target."""

from __future__ import annotations

import numpy as np

from vfoa.geometry import sigma_rad
from vfoa.posterior.aims import Offsets
from vfoa.posterior.assumptions import BIAS_SHARE, NOWHERE_DEG
from vfoa.posterior.belief import Belief, MeasuredCues, Scenery
from vfoa.posterior.evidence import Evidence, Flow
from vfoa.posterior.gaze_error import GazeError, first_error, next_error, weigh_gaze

BIAS_S = 0.8
"""Time within which the drifting part of the error is forgotten."""
_ABOUT_HEAD_DEG = 14.0
"""Angle between the gaze and the usual place below the head's axis while the gaze is on no target."""


def weighed_gaze(
    prior: Belief,
    scenery: Scenery,
    cues: MeasuredCues,
    offsets: Offsets,
    flow: Flow,
    dt_s: float,
) -> tuple[GazeError | None, Evidence]:
    """The filter of the gaze error after the frame, None before the first gaze, and the evidence of the gaze."""
    hypotheses = prior.gaze
    nothing = Evidence.none(len(hypotheses.scale), len(scenery.keys))
    if prior.error is None and cues.gaze is None:
        return None, nothing
    variance = ((hypotheses.scale * cues.gaze_sigma_rad) ** 2)[:, None]
    slow = BIAS_SHARE * variance
    head = prior.last_head if cues.head is None else cues.head
    around = sigma_rad(NOWHERE_DEG if head is None else _ABOUT_HEAD_DEG)
    drift = slow + np.append(scenery.variances, around**2)
    if prior.error is None:
        predicted = first_error(hypotheses.cell_rad**2, drift)
    else:
        looked, stay = flow.of("gaze")
        keep = float(np.exp(-dt_s / BIAS_S))
        predicted = next_error(prior.error, looked, flow.columns, stay, slow, drift, keep)
    if offsets.gaze is None:
        return predicted, nothing
    offset = offsets.gaze.take(hypotheses.gain, axis=1) - hypotheses.bias_rad[..., None]
    error, likelihood, excess = weigh_gaze(predicted, offset, variance - slow)
    return error, Evidence.of(likelihood, excess)
