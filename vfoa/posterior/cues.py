"""What gaze and head of one frame say: where each hypothesis expects them, how likely they are, and what each tells.

The numbers were fitted together, so that none is a setting. Deviations are mean angles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from vfoa.geometry import lowered, on_the_way, sigma_rad, tangent_offset, unit
from vfoa.posterior.belief import Belief, MeasuredCues, Scenery
from vfoa.posterior.gaze_error import Evidence, GazeError, first_error, next_error, weigh_gaze
from vfoa.posterior.head_motion import HeadMotion, first_motion, next_motion, weigh_head
from vfoa.posterior.looks import Columns
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
_FACING_S = 3.0
"""Time constant of the head's running mean, which stands for where the body faces."""
_LAG_S = 0.35
"""Time constant of the head's movement."""
_HEAD_BIAS_DEG = 5.0
"""Mean angle of the constant error of head poses."""
_START_S = 1.0
"""Time for which the middle of the targets counts as where the body faces, beside the first head, seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Offsets:
    """Angles to the right and down from the expected directions to the measured ones; None where not measured.

    ``gaze`` (2, N, T) is from the gaze expected with each of N gains. ``head`` and ``last_head`` (K, T, 2) are from the
    share of the way to each target, for this frame's head and for the last one before it.
    """

    gaze: Float | None
    head: Float | None
    last_head: Float | None


def offsets_of(prior: Belief, scenery: Scenery, cues: MeasuredCues) -> Offsets:
    """Return the offsets of the measured directions of a frame, the last of which are those of nowhere.

    A gaze at nowhere is about the usual place below the head's axis, or about the middle of the targets if no head is
    known; a head that looks at nowhere is about where the body faces.
    """
    head = prior.last_head if cues.head is None else cues.head
    if head is None and cues.gaze is None:
        return Offsets(gaze=None, head=None, last_head=None)
    gains = prior.gaze.gains if cues.gaze is not None else ()
    share = prior.head.share if head is not None else np.zeros(0)
    facing = scenery.middle if prior.facing is None else prior.facing
    middle = scenery.middle if head is None else facing  # the last end, which is replaced where a head is known
    starts = np.repeat([scenery.to_camera, facing], (len(gains), len(share)), axis=0)[:, None]
    ends = np.concatenate([scenery.directions, middle[None]])
    expected = on_the_way(starts, ends, np.concatenate([gains, share])[:, None])
    if head is not None:
        expected[: len(gains), -1] = lowered(head, _BELOW_RAD)
        expected[len(gains) :, -1] = facing
    of_gaze, of_heads = expected[: len(gains)], expected[len(gains) :]
    # eyes at rest look below the head's axis, so that the head stays above the way to a target
    above = np.zeros((len(share), len(ends), 2))
    above[:, :-1, 1] = share[:, None] * _BELOW_RAD
    heads = [each for each in (prior.last_head, cues.head) if each is not None]
    measured = np.array([*[cues.gaze] * len(gains), *[each for each in heads for _ in share]])
    offsets = tangent_offset(np.concatenate([of_gaze, *[of_heads] * len(heads)]), measured[:, None])
    by_head = offsets[len(gains) :].reshape(len(heads), len(share), len(ends), 2) + above
    return Offsets(
        gaze=None if cues.gaze is None else offsets[: len(gains)].transpose(2, 0, 1),
        head=None if cues.head is None else by_head[-1],
        last_head=None if prior.last_head is None else by_head[0],
    )


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


_AVERAGES = {"gaze": ("gk,gkt->gt", 1), "head": ("gk,gkt->kt", 0)}
"""The average over the other cue's hypotheses, and their axis."""


@dataclass(frozen=True, slots=True)
class Transition:
    """The way of the probabilities from the previous targets to those of the frame, for every pair of hypotheses.

    ``weights`` (G, K) are those of the pairs, ``looked`` (G, K, T') the probabilities of the previous targets, and
    ``columns`` (T,) gives each target's index among the previous ones. ``predicted`` (G, K, T) are the probabilities
    before the frame is seen; ``stayed`` is the part of them that comes from looks that go on.
    """

    weights: Float
    looked: Float
    columns: Columns
    predicted: Float
    stayed: Float

    def of(self, cue: Literal["gaze", "head"]) -> tuple[Float, Float]:
        """The previous targets (H, T') and the part (H, T) that stays, for each hypothesis of one cue."""
        mean, other = _AVERAGES[cue]
        part = self.weights / np.maximum(self.weights.sum(axis=other, keepdims=True), 1e-300)
        stay = np.einsum(mean, part, self.stayed) / np.maximum(np.einsum(mean, part, self.predicted), 1e-300)
        return np.einsum(mean, part, self.looked), stay


def weighed_gaze(
    prior: Belief, scenery: Scenery, cues: MeasuredCues, offsets: Offsets, transition: Transition, dt_s: float
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
    on_target = np.append(scenery.variances, around**2)
    if prior.error is None:
        predicted = first_error(hypotheses.cell_rad**2, slow, on_target)
    else:
        looked, stay = transition.of("gaze")
        keep = float(np.exp(-dt_s / BIAS_S))
        predicted = next_error(prior.error, looked, transition.columns, stay, slow, on_target, keep)
    if offsets.gaze is None:
        return predicted, nothing
    offset = offsets.gaze.take(hypotheses.gain, axis=1) - hypotheses.bias_rad[..., None]
    return weigh_gaze(predicted, offset, variance - slow)


def weighed_head(
    prior: Belief, scenery: Scenery, cues: MeasuredCues, offsets: Offsets, transition: Transition, dt_s: float
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
        looked, stay = transition.of("head")
        predicted = next_motion(
            prior.motion, looked, transition.columns, stay, offsets.last_head, noise, aside, dt_s, _LAG_S
        )
    if offsets.head is None:
        return predicted, nothing
    return weigh_head(predicted, offsets.head, noise)


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
