"""What the logit (:mod:`vfoa.logit`) knows of a person's look: how far each target is from gaze and head.

For the cue c and the target j::

    f_cj = log(1 + (angle / scale_c)^2 / 4)

``angle`` is between the cue and the inner half of the target's angular radius: people look near the middle of things.
The cues are

gaze          the measured gaze
middle        the direction midway between gaze and head: their errors are independent
head          the measured head, lowered: eyes look below the axis of the head
head_swing    the head, extrapolated from its own running mean, which follows the body: heads go only part of the way,
              and how far differs most sideways, so that angles sideways count less
head_overlap  f is the negative logarithm of the probability that a direction with a normal error about the lowered head
              meets the target's outline: unlike an angle, it knows the outline's shape
posterior     f is the log odds of nowhere over the target by the posterior (:mod:`vfoa.bayes`), which learns how wrong
              a person's directions are: it carries what is fitted in one setting to another
"""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from vfoa.geometry import NEAREST_M, left_from_crop, length_of, lowered, outlines, stacked
from vfoa.instance_tracking import frames_missed
from vfoa.methods import boxes_of_others
from vfoa.times import Gap
from vfoa.types import Box3D, DirectionFit, Float, Subject, Target
from vfoa.visible import FACE_RADIUS_M

MEAN_S = np.array([0.3, 1.0, 1.0, 1.0, 1.0, 1.0])
"""Time constants of the running means of f, by cue, seconds: eyes move faster than heads."""
_BODY_S = 4.0
"""Time constant of the running mean of the head, seconds."""
_LOWERED_RAD = math.radians(9)
"""Angle of the gaze below the head's axis: 8 degrees on average (people who walk among objects)."""
_SWING = 1.8
"""Factor from the head's turn to the gaze's turn: heads make 0.5 to 0.6 of the way."""
_WIDEST_RAD = 0.9 * math.pi
"""Greatest extrapolated turn."""
_GAZE_RAD, _TARGET_RAD, _HEAD_RAD = np.radians([9.0, 5.0, 6.0]).tolist()
"""Error of a gaze that claims none; how far from its middle a target is looked at; scale of the angle of the head."""
_SIDEWAYS = 0.3
"""Factor of the part sideways of the angle of the extrapolated head."""
_OVERLAP_RAD, _LEAST_OVERLAP = math.radians(7), 1e-4
"""Standard deviation of the normal error of ``head_overlap``; what is added to the probability."""
_LEAST_CHANCE = 1e-3
"""What is added to the probabilities of ``posterior``."""
_LEAST_RAD = 1e-6
"""What an angle is divided by, at least."""
_INNER = 0.5
"""Part of a target's radius within which the angle counts as 0."""

Case = Literal["both", "gaze", "head"]
LOGIT_CUES = ("gaze", "middle", "head", "head_swing", "head_overlap", "posterior")
ROWS: Mapping[Case, tuple[int, ...]] = {"both": (0, 1, 2, 3, 4, 5), "gaze": (0, 5), "head": (2, 3, 4, 5)}
"""The cues of a frame with both measured directions, or one of them, as positions in :data:`LOGIT_CUES`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Means:
    """The running means of one track: a sum of the heads (3,), and sums and weights (2, C, T) of f.

    ``missed`` is how long each target was not seen, by instance id, in the order of the columns.
    """

    time_ns: int | None = None
    missed: Mapping[int, Gap] = field(default_factory=dict)
    head: Float = field(default_factory=lambda: np.zeros(3))
    sums: Float = field(default_factory=lambda: np.zeros((2, len(LOGIT_CUES), 0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFeatures:
    """One subject's features in one frame: of T targets ``ids``, for the case of its measured directions.

    ``now`` (C, T) is f of each cue; NaN for cues that were not measured. ``before`` (C, T) are its means up to this
    frame; ``log_size`` (T,) is the logarithm of the angular radius. ``shares`` and ``fit`` are those of the
    posterior's answer.
    """

    case: Case
    ids: tuple[int, ...]
    now: Float
    before: Float
    log_size: Float
    shares: tuple[float, float]
    fit: DirectionFit


class PosteriorAnswer(NamedTuple):
    """Probabilities by target, none of one that is not seen, the shares of gaze and head in them, and their fit."""

    chances: Mapping[int | None, float]
    shares: tuple[float, float]
    fit: DirectionFit


def observe(
    subject: Subject,
    targets: tuple[Target, ...],
    eyes: Mapping[int, Float],
    means: Means,
    dt_s: float,
    posterior: PosteriorAnswer,
    time_ns: int | None = None,
) -> tuple[FrameFeatures, Means]:
    """Compute a subject's features in a frame, and the running means after it.

    The subject has an eye origin and a measured direction. ``eyes`` are the eye origins of people by instance id, the
    last known ones of heads that are missed: people are looked at in the face. ``dt_s`` is the time since the frame of
    ``means``, seconds; ``time_ns`` is that of this frame. ``posterior`` is the posterior's answer in it.
    """
    origin, gaze, head = (
        np.asarray(subject.person.eye_origin_left),
        subject.direction("gaze"),
        subject.direction("head"),
    )
    case: Case = "head" if gaze is None else "gaze" if head is None else "both"
    head_sum = math.exp(-dt_s / _BODY_S) * means.head
    cues = np.full((4, 3), np.nan)
    if head is not None:
        head_sum += head
        cues[2] = lowered(head, _LOWERED_RAD)
        cues[3] = lowered(_swung(_direction(head_sum, head), head), _LOWERED_RAD)
    if gaze is not None:
        cues[0] = gaze
        cues[1] = _direction(gaze + cues[2], gaze)
    claimed = _GAZE_RAD if subject.gaze is None or subject.gaze.sigma_rad is None else subject.gaze.sigma_rad
    shapes = _shapes(boxes_of_others(subject, targets), eyes, origin)
    angles = _angles(cues, shapes, math.hypot(claimed, _TARGET_RAD))
    ids = shapes.ids
    chance = np.array([posterior.chances.get(number, 0.0) for number in ids])
    now = np.concatenate([angles, [_overlap(cues[2], shapes), _odds_of_nowhere(chance)]])
    missed, sums = _continued(means.missed, means.sums, ids, now, dt_s)
    size = np.log(shapes.radius_rad)
    seen = FrameFeatures(
        case=case,
        ids=ids,
        now=now,
        before=_mean(sums)[:, : len(ids)],
        log_size=size,
        shares=posterior.shares,
        fit=posterior.fit,
    )
    return seen, Means(time_ns=time_ns, missed=missed, head=head_sum, sums=sums)


@dataclass(frozen=True, slots=True)
class _Shapes:
    """T targets as seen from the eyes: their extent about their middles, radians.

    ``radius_rad`` (T,) is the angular radius, and ``inner_rad`` (T,) that of the inner part. ``left_from_target`` (T,
    3, 3) has the axes right, down and ahead in its columns, ``least_rad`` and ``most_rad`` (2, T) are the ends of the
    outline to the right and down.
    """

    ids: tuple[int, ...]
    radius_rad: Float
    inner_rad: Float
    left_from_target: Float
    least_rad: Float
    most_rad: Float

    @property
    def directions(self) -> Float:
        """Unit vectors (T, 3) to the middles."""
        return self.left_from_target[..., 2]


def _shapes(boxes: Mapping[int, Box3D], eyes: Mapping[int, Float], origin: Float) -> _Shapes:
    """The targets as seen from ``origin`` (3,): people by their faces, other things by their boxes."""
    of_boxes = tuple(boxes.values())
    distance, frames, corners = outlines(origin, of_boxes)
    half = stacked(of_boxes).half_size.sum(axis=1) / 3
    faces = [row for row, number in enumerate(boxes) if number in eyes]
    if faces:
        towards = np.array([eyes[number] for number in boxes if number in eyes]) - origin
        frames, distance = frames.copy(), distance.copy()
        distance[faces], half[faces] = length_of(towards), FACE_RADIUS_M
        towards[distance[faces] < NEAREST_M] = 0, 0, 1
        frames[faces] = left_from_crop(towards)
    right, down, ahead = corners.T
    outline = np.arctan2([right, down], ahead)
    radius, inner = np.arctan2([half, _INNER * half], distance)
    least, most = outline.min(axis=1), outline.max(axis=1)
    least[:, faces], most[:, faces] = -radius[faces], radius[faces]
    return _Shapes(tuple(boxes), radius, inner, frames, least, most)


def _swung(body: Float, head: Float) -> Float:
    """The head's direction (3,) turned on from that of the body, by a factor of its turn."""
    start, end = body.tolist(), head.tolist()
    angle = max(2 * math.atan2(math.dist(start, end), math.hypot(*map(operator.add, start, end))), 1e-6)
    turn = min(_SWING * angle, _WIDEST_RAD)
    swung = math.sin(angle - turn) * body + math.sin(turn) * head
    return _direction(swung, head)


def _angles(cues: Float, shapes: _Shapes, gaze_scale: float) -> Float:
    """Return f (4, T) of the angles between the cues (4, 3) and the targets."""
    scales = np.array([[gaze_scale], [0.8 * gaze_scale], [_HEAD_RAD], [_HEAD_RAD]])
    cosines = cues @ shapes.directions.T
    beyond = np.maximum(np.arccos(np.minimum(np.maximum(cosines, -1), 1)) - shapes.inner_rad, 0)
    right, down = left_from_crop(cues[3])[:, :2].T @ shapes.directions.T
    beyond[3] *= np.hypot(_SIDEWAYS * right, down) / np.maximum(np.hypot(right, down), _LEAST_RAD)
    return np.log1p((beyond / scales) ** 2 / 4)


def _overlap(head: Float, shapes: _Shapes) -> Float:
    """-log of the probability (T,) that a direction with a normal error about ``head`` (3,) meets each outline."""
    from scipy.special import ndtr

    right, down, ahead = (head @ shapes.left_from_target).T
    axis = np.arctan2([right, down], [ahead, np.hypot(right, ahead)])
    below = ndtr(np.array([shapes.most_rad - axis, shapes.least_rad - axis]) / _OVERLAP_RAD)
    within = below[0] - below[1]
    return np.asarray(-np.log(within[0] * within[1] + _LEAST_OVERLAP))


def _odds_of_nowhere(chance: Float) -> Float:
    """Log odds (T,) of nowhere over each target, by the probabilities (T,) of the targets."""
    nowhere = max(1 - float(chance.sum()), 0.0)
    return np.asarray(np.log((nowhere + _LEAST_CHANCE) / (chance + _LEAST_CHANCE)))


def _decay(gap_s: float) -> Float:
    """Factors (C, 1) of the running means over a time, by cue."""
    return np.exp(-gap_s / MEAN_S)[:, None]


def _continued(
    missed: Mapping[int, Gap], sums: Float, ids: tuple[int, ...], now: Float, dt_s: float
) -> tuple[Mapping[int, Gap], Float]:
    """The sums and weights (2, C, T') with the values (C, T) of the next frame's targets; unknown ones do not count.

    ``missed`` is how long the target of each column was not seen, ``dt_s`` is the time to the next frame. The
    frame's targets come first in the result.
    """
    after = frames_missed(missed, ids, dt_s)
    continued = _of((*after,), (*missed,), _decay(dt_s) * sums)
    known = np.isfinite(now)
    added = np.array([np.where(known, now, 0.0), known])
    continued[..., : len(ids)] += added
    return after, continued


def _mean(sums: Float) -> Float:
    """The means (C, T) of sums and weights; NaN without any value."""
    return np.asarray(np.divide(sums[0], sums[1], out=np.full_like(sums[0], np.nan), where=sums[1] > 0))


def _direction(mean: Float, otherwise: Float) -> Float:
    """The direction (3,) of a sum of directions; ``otherwise`` where it is unknown or they cancel."""
    length = math.hypot(*mean.tolist())
    return mean / length if length > 1e-6 else otherwise


def _of(ids: tuple[int, ...], known: tuple[int, ...], values: Float) -> Float:
    """Reorder values (..., T) from the targets ``known`` to the targets ``ids``; 0 for a target that is not known."""
    if ids == known:
        return values
    column = {number: k for k, number in enumerate(known)}
    padded = np.concatenate([values, np.zeros((*values.shape[:-1], 1))], axis=-1)
    return padded[..., [column.get(number, -1) for number in ids]]


def later_means(seen: Sequence[FrameFeatures], gaps_s: Sequence[float]) -> list[Float]:
    """Means (C, T) of f from each frame on; ``gaps_s`` are the times from each frame to the next."""
    means: list[Float] = []
    missed, sums = Means().missed, Means().sums
    for frame, gap_s in zip(reversed(seen), reversed([*gaps_s, 0.0]), strict=True):
        missed, sums = _continued(missed, sums, frame.ids, frame.now, gap_s)
        means.append(_mean(sums)[:, : len(frame.ids)])
    return means[::-1]


def features(seen: FrameFeatures, case: Case, after: Float | None) -> Float:
    """The features (T, F) of a frame for a case; ``after`` (C, T) are the means of later frames, where known."""
    scales = [seen.now, seen.before] if after is None else [seen.now, seen.before, after]
    rows = ROWS[case]
    by_cue = np.array(scales).transpose(1, 0, 2)[list(rows)].reshape(len(rows) * len(scales), -1)
    return np.concatenate([np.ones_like(seen.log_size)[None], seen.log_size[None], -by_cue]).T
