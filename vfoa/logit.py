"""Attention as a conditional logit: what a few labelled seconds say about how gaze and head show a look.

McFadden's model (1974): the probability of target j is exp(u_j) / (1 + sum of exp(u)). "Nowhere" is the outside option,
with the utility 0. With the weights w, over the cues c::

    u_j = constant + size log(radius_j) - sum of w[c, now] f_cj + w[c, before] mean(f_cj) (+ w[c, after] mean(f_cj))
    f_cj = log(1 + (angle / scale_c)^2 / 4)

The means are running means over earlier and later frames. ``radius`` is the angular radius of the target. ``angle`` is
between the cue and the inner half of that radius: people look near the middle of things. The cues are

gaze          the measured gaze
middle        the direction midway between gaze and head: their errors are independent
head          the measured head, lowered: eyes look below the axis of the head
head_swing    the head, extrapolated from its own running mean, which follows the body: heads go only part of the way,
              and how far differs most sideways, so that angles sideways count less
head_overlap  f is the negative logarithm of the probability that a direction with a normal error about the lowered head
              meets the target's outline: unlike an angle, it knows the outline's shape

Frames with both measured directions, with the gaze alone, and with the head alone have weights of their own.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from vfoa.attention import boxes_of_others
from vfoa.errors import VfoaError
from vfoa.geometry import box_corners, left_from_crop, on_the_way, perturb
from vfoa.settings import Settings
from vfoa.types import Attention, Box3D, Float, FrameResult, NoAttention, Subject, Target, TargetAttention
from vfoa.visible import FACE_RADIUS_M

MEAN_S = np.array([0.3, 1.0, 1.0, 1.0, 1.0])
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
_NEAREST_M = 1e-6
"""A target whose middle is nearer to the eyes counts as ahead of them."""
_INNER = 0.5
"""Part of a target's radius within which the angle counts as 0."""

Case = Literal["both", "gaze", "head"]
CUES = ("gaze", "middle", "head", "head_swing", "head_overlap")
ROWS: Mapping[Case, tuple[int, ...]] = {"both": (0, 1, 2, 3, 4), "gaze": (0,), "head": (2, 3, 4)}
"""The cues of a frame with both measured directions, or one of them, as positions in :data:`CUES`."""


class Weights(Settings):
    """Weights of one case, by cue: of f in the frame itself, of its mean before and, if later frames are known, after.

    Where they are positive, a target near the cue is more likely.
    """

    constant: float
    """Utility of a target over nowhere."""
    size: float
    """Weight of the logarithm of the angular radius."""
    gaze: tuple[float, ...] = ()
    """Weights of the gaze."""
    middle: tuple[float, ...] = ()
    """Weights of the direction midway between gaze and head."""
    head: tuple[float, ...] = ()
    """Weights of the head."""
    head_swing: tuple[float, ...] = ()
    """Weights of the extrapolated head."""
    head_overlap: tuple[float, ...] = ()
    """Weights of the overlap of head and outline."""

    @property
    def vector(self) -> Float:
        """The weights (F,) in the order of :func:`features`."""
        rows = [getattr(self, name) for name in CUES if getattr(self, name)]
        return np.array([self.constant, self.size, *(weight for row in rows for weight in row)])

    @classmethod
    def of(cls, case: Case, vector: Sequence[float]) -> Weights:
        """Return the weights of a case from their vector (F,)."""
        rows = np.reshape(vector[2:], (len(ROWS[case]), -1)).tolist()
        named = {CUES[cue]: tuple(row) for cue, row in zip(ROWS[case], rows, strict=True)}
        return cls(constant=float(vector[0]), size=float(vector[1]), **named)


class Cases(Settings):
    """The weights of frames with both directions, with the gaze alone and with the head alone."""

    both: Weights
    gaze: Weights
    head: Weights


class LogitWeights(Settings):
    """All weights: with earlier frames alone (``forward``), and with later ones, too (``both``)."""

    forward: Cases
    both: Cases

    @model_validator(mode="after")
    def _check_shapes(self) -> LogitWeights:
        for smoothing, scales in (("forward", 2), ("both", 3)):
            for case, rows in ROWS.items():
                weights = getattr(getattr(self, smoothing), case)
                found = [len(getattr(weights, cue)) for cue in CUES]
                if found != [scales * (row in rows) for row in range(len(CUES))]:
                    cues = ", ".join(CUES[row] for row in rows)
                    raise ValueError(f"{smoothing}.{case}: expected {scales} weights of {cues} and of no other cue")
        return self


@lru_cache(maxsize=1)
def shipped_weights() -> LogitWeights:
    """The weights for people whom nobody labelled. Their file, ``logit.toml``, says what they were fitted to."""
    return LogitWeights.model_validate(_shipped()["attention"]["weights"])


def shipped_fit() -> dict[str, Any]:
    """What the shipped weights were fitted to, and their scores: the table ``fit`` of their file."""
    found: dict[str, Any] = _shipped()["fit"]
    return found


def _shipped() -> dict[str, Any]:
    return tomllib.loads(files("vfoa").joinpath("logit.toml").read_text(encoding="utf-8"))


class LogitSettings(Settings):
    """Settings of :func:`weigh_attentions`."""

    method: Literal["logit"]
    """``logit``: a conditional logit over the targets and nowhere, fitted to labels."""
    smoothing: Literal["forward", "both"] = "forward"
    """``forward``: also earlier frames; ``both``: also later ones."""
    look_ahead_s: float = Field(default=2.0, gt=0, le=120)
    """How far ahead of a frame ``both`` looks, seconds."""
    frame_rate_hz: float = Field(default=25.0, gt=0)
    """Frame rate where frames have no times, or times that do not increase."""
    weights: LogitWeights | Literal["left-out"] = Field(default_factory=lambda: shipped_weights())
    """The weights, as ``vfoa fit`` writes them; default: those that ship with vfoa. ``left-out``, in an experiment:
    ``vfoa run`` fits the weights for each clip to the labels of the experiment's other clips."""
    by_clip: dict[str, LogitWeights] = Field(default_factory=dict)
    """Weights of single clips, which ``left-out`` writes."""

    @property
    def frames_awaited(self) -> int:
        """Number of later frames that a frame's answer needs, at ``frame_rate_hz``."""
        return math.ceil(self.look_ahead_s * self.frame_rate_hz) if self.smoothing == "both" else 0

    def for_clip(self, clip: str) -> LogitSettings:
        """Return the settings with the weights of this clip, if it has its own."""
        if clip not in self.by_clip:
            return self
        return self.model_copy(update={"weights": self.by_clip[clip], "by_clip": {}})

    def of_case(self, case: Case, *, later: bool) -> Weights:
        """Return the weights of a case, for answers with or without later frames."""
        if not isinstance(self.weights, LogitWeights):
            raise VfoaError(
                'attention.weights: "left-out" is filled in by `vfoa run EXPERIMENT`; expected weights here'
            )
        weights: Weights = getattr(self.weights.both if later else self.weights.forward, case)
        return weights


@dataclass(frozen=True, slots=True, kw_only=True)
class Means:
    """The running means of one track, sums and weights: of the head (4,), and of f (2, C, T) of the targets ``ids``."""

    time_ns: int | None = None
    ids: tuple[int, ...] = ()
    head: Float = field(default_factory=lambda: np.zeros(4))
    sums: Float = field(default_factory=lambda: np.zeros((2, len(CUES), 0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Traces:
    """The running means of each track."""

    by_track: Mapping[int, Means] = field(default_factory=dict)

    def of(self, tracks: Collection[int]) -> Traces:
        """Return those of these tracks only: a track that has ended never comes back."""
        return Traces(by_track={track: each for track, each in self.by_track.items() if track in tracks})


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """One subject's features in one frame: of T targets ``ids``, for the case of its measured directions.

    ``now`` (C, T) is f of each cue; NaN for cues that were not measured. ``before`` (C, T) are its means up to this
    frame; ``log_size`` (T,) is the logarithm of the angular radius.
    """

    case: Case
    ids: tuple[int, ...]
    now: Float
    before: Float
    log_size: Float


def observe(
    subject: Subject, targets: tuple[Target, ...], eyes: Mapping[int, Float], means: Means, dt_s: float
) -> tuple[Seen, Means] | NoAttention:
    """Compute a subject's features in a frame, and the running means after it; or say why there are none.

    ``eyes`` are the eye origins of people by instance id: people are looked at in the face. ``dt_s`` is the time since
    the frame of ``means``, seconds.
    """
    origin = subject.person.eye_origin_left
    if origin is None:
        return NoAttention.NO_EYES_3D
    gaze, head = subject.direction("gaze"), subject.direction("head")
    if gaze is None and head is None:
        return NoAttention.NO_DIRECTION
    case: Case = "head" if gaze is None else "gaze" if head is None else "both"
    head_sum = math.exp(-dt_s / _BODY_S) * means.head
    cues = np.full((4, 3), np.nan)
    claimed = _GAZE_RAD
    if head is not None:
        head_sum = head_sum + np.append(head, 1.0)
        body = _direction(head_sum, head)
        turn = math.acos(min(1.0, max(-1.0, float(body @ head))))
        swung = on_the_way(body, head, min(_SWING, _WIDEST_RAD / max(turn, 1e-6)))
        cues[2:] = perturb(np.stack([head, swung]), 0.0, _LOWERED_RAD)
    if subject.gaze is not None:
        cues[0] = gaze
        cues[1] = _direction(cues[0] + cues[2], cues[0])
        claimed = _GAZE_RAD if subject.gaze.sigma_rad is None else subject.gaze.sigma_rad
    shapes = _shapes(boxes_of_others(subject, targets), eyes, origin)
    now = np.vstack([_angles(cues, shapes, math.hypot(claimed, _TARGET_RAD)), _overlap(cues[2], shapes)])

    ids = shapes.ids
    sums = _added(_decay(dt_s) * _of(ids, means.ids, means.sums), now)
    seen = Seen(case=case, ids=ids, now=now, before=_mean(sums), log_size=np.log(shapes.radius_rad))
    return seen, Means(ids=ids, head=head_sum, sums=sums)


@dataclass(frozen=True, slots=True)
class _Shapes:
    """T targets as seen from the eyes: unit vectors to their middles (T, 3), and their extent about these, radians.

    ``radius_rad`` (T,) is the angular radius. ``left_from_target`` (T, 3, 3) has the axes right, down and ahead in its
    columns, ``least_rad`` and ``most_rad`` (T, 2) are the ends of the outline to the right and down.
    """

    ids: tuple[int, ...]
    directions: Float
    radius_rad: Float
    left_from_target: Float
    least_rad: Float
    most_rad: Float


def _shapes(boxes: Mapping[int, Box3D], eyes: Mapping[int, Float], origin: Float) -> _Shapes:
    """The targets as seen from ``origin`` (3,): people by their faces, other things by their boxes."""
    faces = [number in eyes for number in boxes]
    middles = np.array([eyes.get(number, box.center_m) for number, box in boxes.items()]).reshape(-1, 3) - origin
    distance = np.linalg.norm(middles, axis=1)
    middles[distance < _NEAREST_M] = (0, 0, _NEAREST_M)
    frames = left_from_crop(middles)
    right, down, ahead = np.moveaxis((box_corners(list(boxes.values())) - origin) @ frames, -1, 0)
    outline = np.arctan2([right, down], ahead)
    half = np.where(faces, FACE_RADIUS_M, [box.half_size_m.mean() for box in boxes.values()])
    radius = np.arctan2(half, distance)
    least, most = outline.min(axis=-1).T, outline.max(axis=-1).T
    least[faces], most[faces] = -radius[faces, None], radius[faces, None]
    return _Shapes(tuple(boxes), frames[..., 2], radius, frames, least, most)


def _angles(cues: Float, shapes: _Shapes, gaze_scale: float) -> Float:
    """Return f (4, T) of the angles between the cues (4, 3) and the targets."""
    scales = np.array([gaze_scale, 0.8 * gaze_scale, _HEAD_RAD, _HEAD_RAD])[:, None]
    beyond = np.arccos(np.clip(cues @ shapes.directions.T, -1, 1))
    beyond = np.maximum(beyond - np.arctan(_INNER * np.tan(shapes.radius_rad)), 0)
    right, down, _ = (shapes.directions @ left_from_crop(cues[3])).T
    beyond[3] *= np.hypot(_SIDEWAYS * right, down) / np.maximum(np.hypot(right, down), _NEAREST_M)
    return np.log1p((beyond / scales) ** 2 / 4)


def _overlap(head: Float, shapes: _Shapes) -> Float:
    """-log of the probability (T,) that a direction with a normal error about ``head`` (3,) meets each outline."""
    from scipy.special import ndtr

    right, down, ahead = (head @ shapes.left_from_target).T
    axis = np.stack([np.arctan2(right, ahead), np.arctan2(down, np.hypot(right, ahead))], axis=-1)
    within = ndtr((shapes.most_rad - axis) / _OVERLAP_RAD) - ndtr((shapes.least_rad - axis) / _OVERLAP_RAD)
    return np.asarray(-np.log(within.prod(axis=-1) + _LEAST_OVERLAP))


def _decay(gap_s: float) -> Float:
    """Factors (C, 1) of the running means over a time, by cue."""
    return np.exp(-gap_s / MEAN_S)[:, None]


def _added(sums: Float, now: Float) -> Float:
    """The sums and weights (2, C, T) with another frame's values; unknown ones do not count."""
    known = np.isfinite(now)
    return sums + np.stack([np.where(known, now, 0.0), known])


def _mean(sums: Float) -> Float:
    """The means (C, T) of sums and weights; NaN without any value."""
    return np.asarray(np.divide(sums[0], sums[1], out=np.full_like(sums[0], np.nan), where=sums[1] > 0))


def _direction(mean: Float, otherwise: Float) -> Float:
    """The direction (3,) of a sum of directions; ``otherwise`` where it is unknown or they cancel."""
    length = float(np.linalg.norm(mean[:3]))
    return mean[:3] / length if length > 1e-6 else otherwise


def _of(ids: tuple[int, ...], known: tuple[int, ...], values: Float) -> Float:
    """The values (..., T) of the targets ``ids``, from those of ``known``: 0 for a target without any."""
    if ids == known:
        return values
    column = {number: k for k, number in enumerate(known)}
    padded = np.concatenate([values, np.zeros((*values.shape[:-1], 1))], axis=-1)
    return padded[..., [column.get(number, -1) for number in ids]]


def later_means(seen: Sequence[Seen], gaps_s: Sequence[float]) -> list[Float]:
    """Means (C, T) of f from each frame on; ``gaps_s`` are the times from each frame to the next."""
    found: list[Float] = []
    ids: tuple[int, ...] = ()
    sums = Means().sums
    for each, gap_s in zip(reversed(seen), reversed([*gaps_s, 0.0]), strict=True):
        sums = _added(_decay(gap_s) * _of(each.ids, ids, sums), each.now)
        ids = each.ids
        found.append(_mean(sums))
    return found[::-1]


def features(seen: Seen, case: Case, after: Float | None = None) -> Float:
    """The features (T, F) of a frame for a case; ``after`` (C, T) are the means of later frames, where known."""
    scales = [seen.now, seen.before] if after is None else [seen.now, seen.before, after]
    rows = np.stack(scales, axis=-1)[list(ROWS[case])].transpose(1, 0, 2).reshape(len(seen.ids), -1)
    return np.column_stack([np.ones(len(seen.ids)), seen.log_size, -rows])


def probabilities(utility: Float) -> Float:
    """Probabilities (..., T) of targets with these utilities (..., T); nowhere has the rest up to 1."""
    top = np.maximum(utility.max(axis=-1, initial=0.0, keepdims=True), 0)
    power = np.exp(utility - top)
    return np.asarray(power / (np.exp(-top) + power.sum(axis=-1, keepdims=True)))


def weigh_attentions(
    subjects: tuple[Subject, ...],
    targets: tuple[Target, ...],
    traces: Traces,
    settings: LogitSettings,
    time_ns: int | None = None,
) -> tuple[tuple[Attention, ...], Traces]:
    """Compute every subject's attention in one frame, and the running means that the next frame starts from.

    ``total`` is the probability of each target that has a box, except the subject's own instance. "Nowhere" has the
    rest up to 1, and the focus is None where that is the greatest. The total is divided between the cues by the sums of
    their weights. ``belief`` is the input of :func:`weigh_again`.
    """
    people = (subject.person for subject in subjects)
    eyes = {
        each.instance_id: each.eye_origin_left
        for each in people
        if each.instance_id is not None and each.eye_origin_left is not None
    }
    by_track = dict(traces.by_track)
    results = []
    for subject in subjects:
        before = by_track.get(subject.track_id, Means())
        dt_s = seconds_between(before.time_ns, time_ns, settings)
        found = observe(subject, targets, eyes, before, dt_s)
        if isinstance(found, NoAttention):
            results.append(Attention(subject=subject, missing=found))
            continue
        seen, means = found
        by_track[subject.track_id] = replace(means, time_ns=time_ns)
        results.append(_attention(subject, seen, settings.of_case(seen.case, later=False)))
    return tuple(results), Traces(by_track=by_track)


def weigh_again(window: Sequence[FrameResult], settings: LogitSettings) -> list[FrameResult]:
    """Return the frames of a window with every subject's attention given the later frames of the window, too."""
    found: dict[tuple[int, int], Attention] = {}
    for track in {each.subject.track_id for frame in window for each in frame.attentions}:
        of_track = [
            (index, frame.scene.time_ns, each)
            for index, frame in enumerate(window)
            for each in frame.attentions
            if each.subject.track_id == track and isinstance(each.belief, Seen)
        ]
        seen = [each.belief for _, _, each in of_track]
        times = [time_ns for _, time_ns, _ in of_track]
        gaps_s = [seconds_between(*pair, settings) for pair in pairwise(times)]
        for (index, _, each), after in zip(of_track, later_means(seen, gaps_s), strict=True):
            weights = settings.of_case(each.belief.case, later=True)
            found[index, track] = _attention(each.subject, each.belief, weights, after)
    return [
        replace(frame, attentions=tuple(found.get((index, each.subject.track_id), each) for each in frame.attentions))
        for index, frame in enumerate(window)
    ]


def seconds_between(before_ns: int | None, now_ns: int | None, settings: LogitSettings) -> float:
    """Time between two frames, seconds; one period of ``frame_rate_hz`` where it is unknown or not positive."""
    if before_ns is None or now_ns is None or now_ns <= before_ns:
        return 1 / settings.frame_rate_hz
    return (now_ns - before_ns) / 1e9


def _attention(subject: Subject, seen: Seen, weights: Weights, after: Float | None = None) -> Attention:
    probability = probabilities(features(seen, seen.case, after) @ weights.vector)
    nowhere = 1 - probability.sum()
    on_gaze = sum(weights.gaze) + sum(weights.middle) / 2
    on_head = sum(map(sum, (weights.head, weights.head_swing, weights.head_overlap))) + sum(weights.middle) / 2
    share = {"gaze": 1.0, "head": 0.0}.get(seen.case, _share(on_gaze, on_head))
    values = tuple(
        TargetAttention(
            instance_id=number,
            gaze=math.nan if seen.case == "head" else share * total,
            head=math.nan if seen.case == "gaze" else (1 - share) * total,
            total=total,
        )
        for number, total in zip(seen.ids, probability.tolist(), strict=True)
    )
    best = max((each.total for each in values), default=0.0)
    first = [each.instance_id for each in values if each.total == best > nowhere]
    return Attention(subject=subject, values=values, focus=next(iter(first), None), tied=tuple(first[1:]), belief=seen)


def _share(gaze: float, head: float) -> float:
    """The share of the first of two sums of weights; negative sums count as 0."""
    gaze, head = max(gaze, 0.0), max(head, 0.0)
    return gaze / (gaze + head) if gaze + head > 0 else 0.5
