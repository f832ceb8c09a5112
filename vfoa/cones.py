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

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt, model_validator

from vfoa.geometry import entry_distance, fov_from_radius, left_from_crop, stacked
from vfoa.methods import MethodSettings, boxes_of_others
from vfoa.types import (
    CUES,
    Attention,
    Box3D,
    Cone,
    Cue,
    Float,
    NoAttention,
    Rays,
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

    Cones are full apex angles in degrees (``cones_deg``) or, as in the paper, base radii in centimetres at a height
    of 1.10 m (``cones_cm``). One of the two, never both; without either it is one cone of 10 cm. Each cone has
    ``n_rays`` rays evenly on its surface and, with ``axis_ray``, one along its axis.

    ``weighting``: ``adaptive`` is the paper's. The others are ablations; ``gaze`` and ``head`` rest on that cue
    alone, so that a subject without it has no direction.

    A ray counts for every box on its way, as in the paper.
    """

    method: Literal["cones"] = "cones"
    """``cones`` of rays; ``bayes``, a posterior over the objects; ``logit``, weights fitted to labels; ``nearest``."""
    cones_deg: tuple[Annotated[float, Field(gt=0, lt=180)], ...] | None = Field(default=None, min_length=1)
    """Full apex angles of the cones. Set this or ``cones_cm``; one cone of 10 cm without either."""
    cones_cm: tuple[Annotated[float, Field(gt=0)], ...] | None = Field(default=None, min_length=1)
    """Base radii of the cones at a height of 1.10 m, as in the paper, instead of ``cones_deg``."""
    n_rays: PositiveInt = 40
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
        return tuple(pay_attention(subject, scene.targets, self._settings) for subject in subjects), states


def pay_attention(subject: Subject, targets: tuple[Target, ...], settings: ConesSettings) -> Attention:
    """Compute one subject's attention to every target that has a box, except the subject's own instance.

    The values keep the order of the targets. Among targets with exactly the same total, the one entered nearest to the
    eyes has the focus. Without an eye origin or a usable direction, the result gives the reason in ``missing`` and has
    no values.
    """
    origin = subject.person.eye_origin_left
    if origin is None:
        return Attention(subject=subject, missing=NoAttention.NO_EYES_3D)
    axes = {cue: axis for cue in CUES if (axis := subject.direction(cue)) is not None}
    weights = cue_weights(axes, settings.weighting)
    if not weights:
        return Attention(subject=subject, missing=NoAttention.NO_DIRECTION)
    boxes = boxes_of_others(subject, targets)

    cones = tuple(
        Cone(cue=cue, apex_left=origin, axis=axis, fov_rad=fov_rad, n_rays=settings.n_rays)
        for cue, axis in axes.items()
        for fov_rad in settings.cones_rad
    )
    of_boxes = tuple(boxes.values())
    rays = _cast(cones, tuple(axes.values()), of_boxes, settings)
    scores = score_rays(rays, of_boxes)
    of_cue = len(scores) // len(axes)
    shares = scores.reshape(len(axes), of_cue, len(boxes)).sum(axis=1) / of_cue
    values = _weigh(tuple(boxes), dict(zip(axes, shares, strict=True)), weights)
    focus, tied = _focus(values, rays)
    return Attention(subject=subject, values=values, focus=focus, tied=tied, cones=cones, rays=rays)


def cue_weights(axes: Mapping[Cue, Float], weighting: Weighting) -> dict[Cue, float]:
    """Weights of the measured cues, with sum 1: a cue that was not measured gives its weight to the other.

    ``axes`` are the unit directions of the measured cues. Empty where no measured cue has any weight.
    """
    kind: str = weighting
    if weighting == "adaptive":
        kind = "agree" if len(axes) == 2 and np.vdot(*axes.values()) >= _COS_AGREEMENT else "differ"
    weights = {cue: weight for cue, weight in zip(CUES, WEIGHTS[kind], strict=True) if cue in axes}
    total = sum(weights.values())
    return {cue: weight / total for cue, weight in weights.items()} if total > 0 else {}


@lru_cache(maxsize=64)
def pencil(fovs_rad: tuple[float, ...], n_rays: int, axis_ray: bool) -> Float:
    """Unit rays (K, N, 3) of K cones about +z: ray k at the angle 2 pi k / n_rays from +x, the axis last."""
    angle = 2 * np.pi * np.arange(n_rays) / n_rays
    half = np.array(fovs_rad)[:, None] / 2
    x, y, z = np.broadcast_arrays(np.sin(half) * np.cos(angle), np.sin(half) * np.sin(angle), np.cos(half))
    surface = np.stack([x, y, z], axis=-1)
    axis = np.broadcast_to([0.0, 0.0, 1.0], (len(fovs_rad), int(axis_ray), 3))
    return np.concatenate([surface, axis], axis=1)


@lru_cache(maxsize=64)
def _cone_index(cones: int, n_rays: int) -> NDArray[np.intp]:
    """The cone of each ray, of cones with so many rays each."""
    return np.repeat(np.arange(cones), n_rays)


def _cast(cones: tuple[Cone, ...], axes: Sequence[Float], boxes: tuple[Box3D, ...], settings: ConesSettings) -> Rays:
    """Cast the rays of the cones about each axis, one cone after another, and find where they enter the boxes."""
    origin = cones[0].apex_left
    bundle = pencil(settings.cones_rad, settings.n_rays, settings.axis_ray)
    left_from_cone = np.array([left_from_crop(axis) for axis in axes])
    directions = (bundle @ left_from_cone[:, None].swapaxes(-1, -2)).reshape(-1, 3)
    return Rays(
        origin_left=origin,
        directions=directions,
        cone_index=_cone_index(len(cones), bundle.shape[1]),
        entry_m=entry_distance(origin, directions, boxes),
    )


def score_rays(rays: Rays, boxes: tuple[Box3D, ...]) -> Float:
    """Return the scores (R, T) of rays for targets: (1.5 d_max - |P - C|) / (1.5 d_max - d_min), from (1) and (2).

    The sum of a target's scores is N s. |P - C| is at least d_min, except for eyes inside the box, where P is the eye
    origin; there d_min is used.
    """
    scores = np.zeros(rays.entry_m.shape)
    if not boxes:
        return scores
    known = stacked(boxes)
    d_max, d_min = known.d_max, known.d_min

    # most rays miss most boxes: compute P for the hits only
    ray, box = np.nonzero(np.isfinite(rays.entry_m))
    entry_point = rays.origin_left + rays.entry_m[ray, box, None] * rays.directions[ray]
    distance = np.sqrt(((entry_point - known.center[box]) ** 2).sum(axis=1))
    scores[ray, box] = (1.5 * d_max[box] - np.maximum(distance, d_min[box])) / (1.5 * d_max - d_min)[box]
    return scores


def _weigh(
    ids: tuple[int, ...], shares: Mapping[Cue, Float], weights: Mapping[Cue, float]
) -> tuple[TargetAttention, ...]:
    """Equation (3): split each target's total into the parts of the cues, from the shares s (T,) of each cue."""
    parts = {cue: share * weights[cue] for cue, share in shares.items()}
    unknown = [float("nan")] * len(ids)
    gaze, head = (parts[cue].tolist() if cue in parts else unknown for cue in CUES)
    total = sum(parts.values(), start=np.zeros(len(ids))).tolist()
    rows = zip(ids, gaze, head, total, strict=True)
    return tuple(TargetAttention(instance_id=i, gaze=g, head=h, total=t) for i, g, h, t in rows)


def _focus(values: tuple[TargetAttention, ...], rays: Rays) -> tuple[int | None, tuple[int, ...]]:
    """Return the target with the most attention and those that tie with it: nearest entry first, then by id."""
    most = max((value.total for value in values), default=0.0)
    if most == 0:
        return None, ()
    best = [column for column, value in enumerate(values) if value.total == most]
    best.sort(key=lambda column: (np.fmin.reduce(rays.entry_m[:, column]), values[column].instance_id))
    first, *tied = (values[column].instance_id for column in best)
    return first, tuple(tied)
