"""The likelihood of one frame's head: the direction that each hypothesis expects for each target, and its fit."""

from __future__ import annotations

import numpy as np

from vfoa.geometry import on_the_way, tangent_offset
from vfoa.posterior.belief import Belief, Measured, Scenery
from vfoa.posterior.evidence import Evidence, Flow
from vfoa.posterior.head_motion import HeadMotion, first_motion, next_motion, weigh_head
from vfoa.posterior.settings import PosteriorSettings, sigma_rad

_HEAD_BIAS_DEG = 5.0
"""Mean angle of the constant error of head poses."""


def weighed_head(
    prior: Belief, scenery: Scenery, measured: Measured, flow: Flow, dt_s: float, settings: PosteriorSettings
) -> tuple[HeadMotion | None, Evidence]:
    """The filter of the head after the frame, None before the first head, and the evidence of the head."""
    share = prior.head.share
    nothing = Evidence.none(len(share), len(scenery.keys))
    if prior.motion is None and measured.head is None:
        return None, nothing
    noise = (1 - settings.bias_share) * measured.head_sigma_rad**2
    on_target = sigma_rad(settings.aside_deg) ** 2 + share[:, None] ** 2 * scenery.variances
    nowhere = np.full((len(share), 1), sigma_rad(settings.nowhere_deg) ** 2)
    aside = np.concatenate([on_target, nowhere], axis=1)
    middle = scenery.middle
    goals = np.stack([np.vstack([on_the_way(middle, scenery.directions, each), middle]) for each in share])
    if prior.motion is None or prior.last_head is None:
        rest = ((1 - share[:, None]) * sigma_rad(settings.rest_deg)) ** 2 + sigma_rad(_HEAD_BIAS_DEG) ** 2
        predicted = first_motion(rest, aside)
    else:
        looked, stay = flow.of("head")
        last = tangent_offset(goals, prior.last_head)
        predicted = next_motion(prior.motion, looked, flow.columns, stay, last, noise, aside, dt_s, settings.head_lag_s)
    if measured.head is None:
        return predicted, nothing
    motion, likelihood, square = weigh_head(predicted, tangent_offset(goals, measured.head), noise, settings.tails)
    return motion, Evidence.of(likelihood, square, settings.tails)
