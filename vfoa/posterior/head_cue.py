"""The likelihood of one frame's head for each hypothesis and target, and where the body faces."""

from __future__ import annotations

import numpy as np

from vfoa.geometry import sigma_rad, unit
from vfoa.posterior.aims import Offsets
from vfoa.posterior.assumptions import ASIDE_DEG, BIAS_SHARE, NOWHERE_DEG, REST_DEG
from vfoa.posterior.belief import Belief, MeasuredCues, Scenery
from vfoa.posterior.evidence import Evidence, Flow
from vfoa.posterior.head_motion import HeadMotion, first_motion, next_motion, weigh_head
from vfoa.types import Float

_FACING_S = 3.0
"""Time constant of the head's running mean, which stands for where the body faces."""
_LAG_S = 0.35
"""Time constant of the head's movement."""
_HEAD_BIAS_DEG = 5.0
"""Mean angle of the constant error of head poses."""
_START_S = 1.0
"""Time for which the middle of the targets counts as where the body faces, beside the first head, seconds."""


def facing_after(prior: Belief, scenery: Scenery, cues: MeasuredCues, dt_s: float) -> Float | None:
    """Where the body faces (3,): the running mean of the head, which starts at the middle of the targets.

    The head's own mean serves where targets are on all sides, so that their middle says nothing (Sheikhi and Odobez
    2015).
    """
    if cues.head is None:
        return prior.facing
    if prior.facing is None:
        keep = _START_S / (_START_S + _FACING_S)
        return unit(keep * scenery.middle + (1 - keep) * cues.head)
    keep = float(np.exp(-dt_s / _FACING_S))
    return unit(keep * prior.facing + (1 - keep) * cues.head)


def weighed_head(
    prior: Belief,
    scenery: Scenery,
    cues: MeasuredCues,
    offsets: Offsets,
    flow: Flow,
    dt_s: float,
) -> tuple[HeadMotion | None, Evidence]:
    """The filter of the head after the frame, None before the first head, and the evidence of the head."""
    share = prior.head.share
    nothing = Evidence.none(len(share), len(scenery.keys))
    if prior.motion is None and cues.head is None:
        return None, nothing
    noise = (1 - BIAS_SHARE) * cues.head_sigma_rad**2
    on_target = sigma_rad(ASIDE_DEG) ** 2 + share[:, None] ** 2 * scenery.variances
    nowhere = np.full((len(share), 1), sigma_rad(NOWHERE_DEG) ** 2)
    aside = np.concatenate([on_target, nowhere], axis=1)
    if prior.motion is None or offsets.last_head is None:
        rest = ((1 - share[:, None]) * sigma_rad(REST_DEG)) ** 2 + sigma_rad(_HEAD_BIAS_DEG) ** 2
        predicted = first_motion(rest, aside)
    else:
        looked, stay = flow.of("head")
        predicted = next_motion(prior.motion, looked, flow.columns, stay, offsets.last_head, noise, aside, dt_s, _LAG_S)
    if offsets.head is None:
        return predicted, nothing
    motion, likelihood, excess = weigh_head(predicted, offsets.head, noise)
    return motion, Evidence.of(likelihood, excess)
