"""What gaze and head of one frame say: where each hypothesis expects them, how likely they are, and what each tells.

The numbers were fitted together, so that none is a setting. Deviations are mean angles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vfoa.geometry import lowered, on_the_way, sigma_rad, tangent_offsets
from vfoa.posterior.belief import Belief, MeasuredCues, Scenery
from vfoa.posterior.kalman import (
    GAZE_PARTS,
    HEAD_PARTS,
    NO_EVIDENCE,
    Evidence,
    GazeError,
    Normal,
    first_error,
    first_motion,
    next_error,
    next_motion,
    weighed,
)
from vfoa.posterior.looks import GAZES, HEADS, Ways
from vfoa.types import CUES, Float

BIAS_SHARE = 0.35
"""Share of the variance of the error that drifts; the rest is new in each frame."""
BIAS_S = 0.8
"""Time within which the drifting part of the gaze's error is forgotten, seconds."""
_ABOUT_HEAD_DEG = 14.0
"""Angle between the gaze and the usual place below the head's axis while the gaze is on no target."""
_BELOW_RAD = float(np.deg2rad(8.0))
"""Angle of the gaze below the head's axis: 8 degrees on average, 0.5 to 14 between people (vr_objects)."""
ASIDE_DEG = 5.0
"""Offset from its share of the way at which the head stops; new in each look."""
REST_DEG = 20.0
"""Constant offset of a person's head from where the body faces."""
NOWHERE_DEG = 35.0
"""Angle between where the body faces and a head that looks at no target."""
ELSEWHERE_DEG = 20.0
"""The same for a gaze, where no head is known: a compromise. Of 15 to 50, people have the least log loss with 15, drawn
scenes with 15 to 20, rendered clips and a film with 25 to 35."""
FACING_S = 3.0
"""Time constant of the running mean of the head (of the gaze, if no head is known), which stands for where the body
faces. A head that was measured longer ago is not known."""
_LAG_S = 0.35
"""Time constant of the head's movement."""
_HEAD_BIAS_DEG = 5.0
"""Mean angle of the constant error of head poses."""
START_S = 1.0
"""Time for which the middle of the targets counts as where the body faces, beside the first head or gaze, seconds."""


@dataclass(frozen=True, slots=True)
class Offsets:
    """Angles to the right and down from the expected directions to the measured ones; None where not measured.

    ``gaze`` (2, T, N) is from the gaze expected with each of N gains. ``head`` and ``last_head`` (2, T, K) are from the
    share of the way to each target, for this frame's head and for the last one before it.
    """

    gaze: Float | None = None
    head: Float | None = None
    last_head: Float | None = None


def offsets_of(prior: Belief, scenery: Scenery, cues: MeasuredCues) -> Offsets:
    """Return the offsets of the measured directions of a frame, the last of which are those of nowhere.

    A gaze at nowhere is about the usual place below the head's axis, or about where the body faces if no head is known;
    a head that looks at nowhere is about where the body faces.
    """
    heads = [each for each in (prior.last_head, cues.head) if each is not None]
    if not heads and cues.gaze is None:
        return Offsets()
    facing = scenery.middle if prior.facing is None else prior.facing
    share, gains = prior.head.share, () if cues.gaze is None else prior.gaze.gains
    of_gaze = len(gains)
    counts = [of_gaze] * (of_gaze > 0) + [len(share)] * len(heads)
    measured = np.array([cues.gaze, *heads] if of_gaze else heads).T.repeat(counts, axis=1)[:, None]
    starts = np.array([scenery.to_camera, facing]).T.repeat((of_gaze, sum(counts) - of_gaze), axis=1)[:, None]
    ends = np.concatenate([scenery.directions, facing[None]]).T.copy()[..., None]
    expected = on_the_way(starts, ends, np.concatenate([gains, *[share] * len(heads)]))
    if heads:
        expected[:, -1, :of_gaze] = lowered(heads[-1], _BELOW_RAD)[:, None]
        expected[:, -1, of_gaze:] = facing[:, None]
    offsets = tangent_offsets(expected, measured)
    by_head = offsets[..., of_gaze:].reshape(2, len(scenery.keys), len(heads), len(share))
    # eyes at rest look below the head's axis, so that the head stays above the way to a target
    by_head[1, :-1] += share * _BELOW_RAD
    return Offsets(
        gaze=None if cues.gaze is None else offsets[..., :of_gaze],
        head=None if cues.head is None else by_head[:, :, -1],
        last_head=None if prior.last_head is None else by_head[:, :, 0],
    )


def facing_after(prior: Belief, scenery: Scenery, cues: MeasuredCues, dt_s: float) -> Float | None:
    """Where the body faces (3,): the running mean of the head, which starts at the middle of the targets.

    The head's own mean serves where targets are on all sides, so that their middle says nothing (Sheikhi and Odobez
    2015). As long as no head is known, it is the running mean of the gaze.
    """
    seen = cues.gaze if cues.head is None and prior.last_head is None else cues.head
    if seen is None:
        return prior.facing
    if prior.facing is None:
        keep, before = START_S / (START_S + FACING_S), scenery.middle
    else:
        keep, before = math.exp(-dt_s / FACING_S), prior.facing
    mean = keep * before + (1 - keep) * seen
    return mean / math.hypot(*mean.tolist())


def weighed_gaze(
    prior: Belief, scenery: Scenery, cues: MeasuredCues, offset: Float | None, ways: Ways, dt_s: float
) -> tuple[GazeError | None, Evidence]:
    """The filter of the gaze error after the frame, None before the first gaze, and the evidence of the gaze."""
    hypotheses = prior.gaze
    if prior.error is None and cues.gaze is None:
        return None, NO_EVIDENCE
    transition = ways.over(HEADS)
    variance = (hypotheses.scale * cues.gaze_sigma_rad) ** 2
    slow = BIAS_SHARE * variance
    no_head = prior.last_head is None and cues.head is None
    around = sigma_rad(ELSEWHERE_DEG if no_head else _ABOUT_HEAD_DEG)
    on_target = np.array([*scenery.variances.tolist(), around**2])[:, None]
    if prior.error is None:
        predicted = first_error(hypotheses.cell_rad**2, slow, on_target)
    else:
        predicted = next_error(prior.error, transition, slow, on_target, math.exp(-dt_s / BIAS_S))
    if offset is None:
        return predicted, NO_EVIDENCE
    without_bias = offset.take(hypotheses.gain, axis=-1) - hypotheses.bias_rad[:, None]
    state, evidence = weighed(predicted.state, transition.predicted, GAZE_PARTS, without_bias, variance - slow)
    return GazeError(state, predicted.lasting), evidence


def weighed_head(
    prior: Belief, scenery: Scenery, cues: MeasuredCues, offsets: Offsets, ways: Ways, dt_s: float
) -> tuple[Normal | None, Evidence]:
    """The filter of the head after the frame, None before the first head, and the evidence of the head."""
    share = prior.head.share
    if prior.motion is None and cues.head is None:
        return None, NO_EVIDENCE
    transition = ways.over(GAZES)
    noise = (1 - BIAS_SHARE) * cues.head_sigma_rad**2
    aside = np.empty((len(scenery.keys), len(share)))
    aside[:-1] = sigma_rad(ASIDE_DEG) ** 2 + share**2 * scenery.variances[:, None]
    aside[-1] = sigma_rad(NOWHERE_DEG) ** 2
    if prior.motion is None or offsets.last_head is None:
        rest = ((1 - share) * sigma_rad(REST_DEG)) ** 2 + sigma_rad(_HEAD_BIAS_DEG) ** 2
        predicted = first_motion(rest, aside)
    else:
        predicted = next_motion(prior.motion, transition, offsets.last_head, noise, aside, dt_s, _LAG_S)
    if offsets.head is None:
        return predicted, NO_EVIDENCE
    return weighed(predicted, transition.predicted, HEAD_PARTS, offsets.head, noise)


def cue_shares(cues: MeasuredCues, belief: Belief) -> tuple[float, float]:
    """Shares of the gaze and of the head in the evidence, by precision; NaN for a cue that was not measured.

    The precision of a gaze follows from its estimated error. The precision of a head follows from its own error, its
    rest and its offset (``ASIDE_DEG``), divided by its share of the way to the target.
    """
    precision = {}
    if cues.gaze is not None:
        scale = float(belief.gaze_weights @ belief.gaze.scale)
        precision["gaze"] = 1 / (scale * cues.gaze_sigma_rad) ** 2
    if cues.head is not None:
        share = belief.implied_share
        around = sigma_rad(ASIDE_DEG) ** 2 + ((1 - share) * sigma_rad(REST_DEG)) ** 2
        precision["head"] = share**2 / (cues.head_sigma_rad**2 + around)
    total = sum(precision.values())
    gaze, head = (precision[cue] / total if cue in precision else float("nan") for cue in CUES)
    return gaze, head
