"""Attention: how much a subject looks at each target, from hollow cones of rays about the gaze and the head.

Simões and Moreno (ICARSC 2022), as their text and figures have it:

    cone    apex at the eye origin, axis = the cue's direction, full apex angle 2 atan(radius / 1.10 m)
    ray     A = 1.5 - |P - C| / d_max where it enters a box, 0 where it misses                          (1)
    cue     s = sum A / (N (1.5 - d_min / d_max)), in [0, 1], over the N rays of all the cue's cones    (2)
    total   A_T = w_gaze s_gaze + w_head s_head                                                         (3)
    focus   the target with the greatest A_T; none where all are 0

P is where the ray enters the box, C the box's centroid. d_max (half the diagonal) and d_min (the smallest half
extent) are the greatest and the least distance of the box's surface from C: rays that all enter at the middle of
the nearest face make s = 1.

The printed equations multiply by w and divide by it again, so that the weights cancel. The text and the figures need
them, so they are applied here once, in (3).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import islice
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from vfoa.geometry import Boxes, entry_distances, fov_from_radius, left_from_crop, of_people, stacked
from vfoa.methods import MethodSettings, boxes_of_others
from vfoa.types import (
    CUES,
    Attention,
    Cast,
    Cue,
    Float,
    NoAttention,
    Scene,
    Subject,
    Target,
    TargetAttention,
)

Weighting = Literal["adaptive", "equal", "gaze", "head"]

SINGLE_CONE_CM = (10.0,)
"""Default radii: the paper's single cone. The paper's pair of a small and a medium cone is (10, 25)."""

AGREEMENT_DEG = 30.0
"""Gaze and head pose count as agreeing if the angle between them is at most this."""

AT_ONCE = 4096
"""Pairs of a ray and a box that are computed together: as many as stay in the processor's cache."""

_COS_AGREEMENT = float(np.cos(np.deg2rad(AGREEMENT_DEG)))

WEIGHTS = {
    "agree": (0.6, 0.4),
    "differ": (0.9, 0.1),
    "equal": (0.5, 0.5),
    "gaze": (1.0, 0.0),
    "head": (0.0, 1.0),
}
"""(w_gaze, w_head). The first two are the paper's adaptive weights: eyes turned away from the head say more."""


class ConesSettings(MethodSettings):
    """Settings of :func:`pay_attention`.

    Weights of one cue alone (``gaze``, ``head``) are ablations: a subject without that cue has no direction. A ray
    counts for every box on its way, as in the paper.
    """

    method: Literal["cones"] = "cones"
    """``cones`` of rays; ``bayes``, a posterior over the objects; ``logit``, weights fitted to labels; ``nearest``."""
    cones_deg: tuple[Annotated[float, Field(gt=0, lt=180)], ...] | None = Field(default=None, min_length=1)
    """Full apex angles of the cones. Set this or ``cones_cm``; one cone of 10 cm without either."""
    cones_cm: tuple[Annotated[float, Field(gt=0, le=10_000)], ...] | None = Field(default=None, min_length=1)
    """Base radii of the cones at a height of 1.10 m, as in the paper, instead of ``cones_deg``."""
    n_rays: int = Field(default=40, gt=0, le=100_000)
    """Rays on the surface of each cone."""
    axis_ray: bool = True
    """Also cast one ray along the axis of each cone."""
    weighting: Weighting = "adaptive"
    """``adaptive``: the paper's weights of gaze and head; ``equal``; ``gaze`` or ``head`` alone."""

    @model_validator(mode="before")
    @classmethod
    def _name_cones_once(cls, given: Any) -> Any:
        """Fill in the default cones here, so that settings that were saved read back as equal."""
        if not isinstance(given, dict):
            return given
        named = [name for name in ("cones_deg", "cones_cm") if given.get(name) is not None]
        if len(named) > 1:
            raise ValueError("expected cones_deg or cones_cm, found both")
        return given if named else {**given, "cones_cm": SINGLE_CONE_CM}

    @property
    def cones_rad(self) -> tuple[float, ...]:
        """Full apex angle of each cone, radians."""
        return _apex_angles_rad(self.cones_deg, self.cones_cm)


@lru_cache(maxsize=64)
def _apex_angles_rad(cones_deg: tuple[float, ...] | None, cones_cm: tuple[float, ...] | None) -> tuple[float, ...]:
    """The apex angles of cones that are given in one of both ways; every person in every frame asks for them."""
    if cones_deg is not None:
        return tuple(float(np.deg2rad(angle)) for angle in cones_deg)
    return tuple(fov_from_radius(radius / 100) for radius in cones_cm or ())


class Cones:
    """Cones of rays about gaze and head, as a :class:`vfoa.methods.AttentionMethod`."""

    Settings = ConesSettings
    probabilistic = False
    says_nowhere = False

    def __init__(self, settings: ConesSettings) -> None:
        self._settings = settings

    def start(self) -> None:
        """No state."""

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[None, ...]
    ) -> tuple[tuple[Attention, ...], tuple[None, ...]]:
        """Compute every subject's attention in one frame, each alone."""
        (attentions,) = self.attend_frames([(subjects, scene)])
        return attentions, states

    def attend_frames(self, frames: Sequence[tuple[tuple[Subject, ...], Scene]]) -> list[tuple[Attention, ...]]:
        """Compute that of the subjects of many frames."""
        people = [(subject, scene.targets) for subjects, scene in frames for subject in subjects]
        answers = iter(attend_people(people, self._settings))
        return [tuple(islice(answers, len(subjects))) for subjects, _ in frames]


def pay_attention(subject: Subject, targets: tuple[Target, ...], settings: ConesSettings) -> Attention:
    """Compute one subject's attention to every target that has a box, except the subject's own instance.

    The values keep the order of the targets. Among targets with exactly the same total, the one entered nearest to the
    eyes has the focus. Without an eye origin or a usable direction, the result gives the reason in ``missing`` and has
    no values.
    """
    (attention,) = attend_people([(subject, targets)], settings)
    return attention


def attend_people(people: Iterable[tuple[Subject, tuple[Target, ...]]], settings: ConesSettings) -> list[Attention]:
    """Compute :func:`pay_attention` for many subjects, each with the targets of its frame, in less time."""
    answers: dict[int, Attention] = {}
    alike: dict[tuple[object, ...], dict[int, _Looking]] = {}
    for place, (subject, targets) in enumerate(people):
        looking = _looking(subject, targets, settings.weighting)
        if isinstance(looking, NoAttention):
            answers[place] = Attention(subject=subject, missing=looking)
        else:
            alike.setdefault((*looking.axes, len(looking.ids)), {})[place] = looking
    for group in alike.values():
        parts = _in_parts([*group.values()], settings)
        answers.update(zip(group, (each for part in parts for each in _attend_alike(part, settings)), strict=True))
    return [answers[place] for place in range(len(answers))]


class _Looking(NamedTuple):
    """A subject with eyes and a direction: the axis and the weight of each cue, and the boxes of the others."""

    subject: Subject
    origin_left: Float
    axes: Mapping[Cue, Float]
    weights: Mapping[Cue, float]
    ids: tuple[int, ...]
    boxes: Boxes


def _looking(subject: Subject, targets: tuple[Target, ...], weighting: Weighting) -> _Looking | NoAttention:
    origin = subject.person.eye_origin_left
    if origin is None:
        return NoAttention.NO_EYES_3D
    axes = {cue: axis for cue in CUES if (axis := subject.direction(cue)) is not None}
    weights = cue_weights(axes, weighting)
    if not weights:
        return NoAttention.NO_DIRECTION
    boxes = boxes_of_others(subject, targets)
    return _Looking(subject, origin, axes, weights, tuple(boxes), stacked(tuple(boxes.values())))


def _in_parts(alike: Sequence[_Looking], settings: ConesSettings) -> Iterator[Sequence[_Looking]]:
    """Split people with the same cues and number of boxes into batches that fit the cache (:data:`AT_ONCE`)."""
    first = alike[0]
    rays = len(first.axes) * len(settings.cones_rad) * (settings.n_rays + settings.axis_ray)
    people = max(1, AT_ONCE // (rays * max(1, len(first.ids))))
    for start in range(0, len(alike), people):
        yield alike[start : start + people]


def _attend_alike(people: Sequence[_Looking], settings: ConesSettings) -> Iterator[Attention]:
    """Attend for P people with the same C cues and the same number T of boxes."""
    cues, boxes = tuple(people[0].axes), of_people([each.boxes for each in people])
    origins = np.array([each.origin_left for each in people])
    axes = np.array([[*each.axes.values()] for each in people])
    directions = _directions(axes, settings)
    entry_m = entry_distances(origins, directions, boxes)
    scores = score_rays(origins, directions, entry_m, boxes)
    of_cue = scores.shape[1] // len(cues)
    shares = scores.reshape(len(people), len(cues), of_cue, -1).sum(axis=2) / of_cue
    for number, (each, values) in enumerate(zip(people, _weigh(people, shares), strict=True)):
        focus, tied = _focus(values, entry_m[number])
        cast = Cast(
            origin_left=each.origin_left,
            cues=cues,
            axes=axes[number],
            fovs_rad=settings.cones_rad,
            n_rays=settings.n_rays,
            directions=directions[number],
            entry_m=entry_m[number],
        )
        yield Attention(subject=each.subject, values=values, focus=focus, tied=tied, cast=cast)


def _directions(axes: Float, settings: ConesSettings) -> Float:
    """Directions (P, R, 3) of the rays about the axes (P, C, 3) of P people, one cone after another."""
    bundle = pencil(settings.cones_rad, settings.n_rays, settings.axis_ray)
    left_from_cone = np.ascontiguousarray(left_from_crop(axes))  # in one order: products are the same to the last bit
    return np.asarray((bundle @ left_from_cone[:, :, None].swapaxes(-1, -2)).reshape(len(axes), -1, 3))


def cue_weights(axes: Mapping[Cue, Float], weighting: Weighting) -> Mapping[Cue, float]:
    """Weights of the measured cues, with sum 1: a cue that was not measured gives its weight to the other.

    ``axes`` are the unit directions of the measured cues. Empty where no measured cue has any weight.
    """
    kind: str = weighting
    if weighting == "adaptive":
        kind = "agree" if len(axes) == 2 and np.vdot(*axes.values()) >= _COS_AGREEMENT else "differ"
    return _weights(kind, tuple(axes))


@lru_cache(maxsize=64)
def _weights(kind: str, cues: tuple[Cue, ...]) -> Mapping[Cue, float]:
    weights = {cue: weight for cue, weight in zip(CUES, WEIGHTS[kind], strict=True) if cue in cues}
    total = sum(weights.values())
    return MappingProxyType({cue: weight / total for cue, weight in weights.items()} if total > 0 else {})


@lru_cache(maxsize=64)
def pencil(fovs_rad: tuple[float, ...], n_rays: int, axis_ray: bool) -> Float:
    """Unit rays (K, N, 3) of K cones about +z: ray k at the angle 2 pi k / n_rays from +x, the axis last."""
    angle = 2 * np.pi * np.arange(n_rays) / n_rays
    half = np.array(fovs_rad)[:, None] / 2
    x, y, z = np.broadcast_arrays(np.sin(half) * np.cos(angle), np.sin(half) * np.sin(angle), np.cos(half))
    surface = np.stack([x, y, z], axis=-1)
    axis = np.broadcast_to([0.0, 0.0, 1.0], (len(fovs_rad), int(axis_ray), 3))
    return np.concatenate([surface, axis], axis=1)


def score_rays(origins_left: Float, directions: Float, entry_m: Float, boxes: Boxes) -> Float:
    """Scores (P, R, T) of rays for boxes: (1.5 d_max - |P - C|) / (1.5 d_max - d_min), from (1) and (2); 0 for a miss.

    The sum of a box's scores is N s. |P - C| is at least d_min, except for eyes inside the box, where P is the eye
    origin; there d_min is used. The arguments are those of :func:`vfoa.geometry.entry_distances`, and its result.
    """
    scores = np.zeros(entry_m.shape)
    # most rays miss most boxes: compute P for the hits only
    hits = np.nonzero(np.isfinite(entry_m))
    person, ray, box = hits
    entry_point = origins_left[person] + entry_m[hits][:, None] * directions[person, ray]
    distance = np.sqrt(((entry_point - boxes.center[person, box]) ** 2).sum(axis=1))
    d_max, d_min = boxes.d_max[person, box], boxes.d_min[person, box]
    scores[hits] = (1.5 * d_max - np.maximum(distance, d_min)) / (1.5 * d_max - d_min)
    return scores


def _weigh(people: Sequence[_Looking], shares: Float) -> Iterator[tuple[TargetAttention, ...]]:
    """Equation (3): split each target's total into the parts of the cues, from the shares s (P, C, T) of each cue."""
    cues = tuple(people[0].axes)
    parts = shares * np.array([[each.weights[cue] for cue in cues] for each in people])[:, :, None]
    totals = parts.sum(axis=1).tolist()
    unknown = np.full_like(parts[:, 0], np.nan)
    gaze, head = ((parts[:, cues.index(cue)] if cue in cues else unknown).tolist() for cue in CUES)
    for each, *columns in zip(people, gaze, head, totals, strict=True):
        rows = zip(each.ids, *columns, strict=True)
        yield tuple(TargetAttention(instance_id=i, gaze=g, head=h, total=t) for i, g, h, t in rows)


def _focus(values: tuple[TargetAttention, ...], entry_m: Float) -> tuple[int | None, tuple[int, ...]]:
    """Return the target with the most attention and those that tie with it: nearest entry first, then by id."""
    most = max((value.total for value in values), default=0.0)
    if most == 0:
        return None, ()
    best = [column for column, value in enumerate(values) if value.total == most]
    if len(best) > 1:
        best.sort(key=lambda column: (np.fmin.reduce(entry_m[:, column]), values[column].instance_id))
    first, *tied = (values[column].instance_id for column in best)
    return first, tuple(tied)
