"""Fit of the measured directions to the belief: the error that they imply beside the claimed one."""

from __future__ import annotations

import numpy as np

from vfoa.geometry import MEAN_ANGLE_PER_SIGMA
from vfoa.posterior.belief import Belief, MeasuredCues
from vfoa.types import DirectionFit


def fit_of(belief: Belief, cues: MeasuredCues) -> DirectionFit:
    """Return the fit of one subject in one frame. Angles are those of the gaze; None if no gaze was measured.

    The implied error is the mean over the hypotheses of the root of the squares of noise and bias, as a mean angle.
    """
    share = None if belief.motion is None else belief.implied_share
    if cues.gaze is None or belief.error is None:
        return DirectionFit(tail=belief.tail, implied_share=share)
    noise = (belief.gaze.scale * cues.gaze_sigma_rad) ** 2
    constant = belief.gaze.bias_rad + np.einsum("gt,xgt->xg", belief.looked.mean(axis=1), belief.error.means[0])
    mean_square = noise + (constant**2).sum(axis=0) / 2
    implied = float(belief.gaze_weights @ np.sqrt(mean_square))
    return DirectionFit(
        tail=belief.tail,
        claimed_error_rad=MEAN_ANGLE_PER_SIGMA * cues.gaze_sigma_rad,
        implied_error_rad=MEAN_ANGLE_PER_SIGMA * implied,
        implied_share=share,
    )
