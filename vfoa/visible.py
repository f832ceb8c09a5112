"""Each target as seen from a pair of eyes: its mean direction, and its angular spread."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vfoa.geometry import angle_between, box_corners, left_from_crop, own_entry_distance, unit
from vfoa.recent import Recent
from vfoa.settings import Settings
from vfoa.types import Box3D, Float, Target

FACE_RADIUS_M = 0.07
"""Spread of looks at a face about the point between its eyes, per direction: eyes, nose and mouth."""


class SurfaceSettings(Settings):
    """Settings of :func:`views_of`."""

    surface: Literal["box", "cloud"] = "cloud"
    """A target is its box, or its cloud as the camera saw it; recorded 3D poses have boxes but no clouds."""
    faces: bool = True
    """People are looked at in the face, if their eye origin is known."""
    directions: int = Field(default=128, ge=16, le=10_000)
    """Number of rays to a target."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Views:
    """The targets as seen: ids, middle directions (T, 3), and variances (T,) per tangent direction, rad^2."""

    ids: tuple[int, ...]
    directions: Float
    variances: Float


_RECENT: Recent[Views] = Recent(32)


def views_of(origin: Float, targets: tuple[Target, ...], eyes: Mapping[int, Float], settings: SurfaceSettings) -> Views:
    """Return each target as seen from ``origin`` (3,), through everything in front of it.

    ``eyes`` are the eye origins of other people by instance id. Left out are targets without a box, and targets
    without a cloud if clouds are the surface and other targets have one. Configurations that ask for the same targets
    one after the other share an answer: also those with clouds and with boxes, where no target has a cloud.
    """
    clouds = settings.surface == "cloud" and any(len(target.points_left) for target in targets)
    eyes_m = tuple((number, eyes[number].tobytes()) for number in sorted(eyes))
    asked = origin.tobytes(), eyes_m, clouds, settings.faces, settings.directions
    return _RECENT.get(targets, asked, lambda: _views(origin, targets, eyes, clouds, settings))


def _views(
    origin: Float, targets: tuple[Target, ...], eyes: Mapping[int, Float], clouds: bool, settings: SurfaceSettings
) -> Views:
    targets = tuple(target for target in targets if target.box and (not clouds or len(target.points_left)))
    boxes = tuple(target.box for target in targets if target.box is not None)
    moments: dict[int, tuple[Float, float]] = {}
    if boxes:
        count = settings.directions
        rays = _cloud_rays(origin, targets, count) if clouds else _rays_about(origin, boxes, count)
        reached = np.isfinite(own_entry_distance(origin, rays, boxes)) if not clouds else np.ones(rays.shape[:2], bool)
        seen = np.asarray(reached.any(axis=1))
        middles, variances = _moments(rays[seen], reached[seen])
        for target, middle, variance in zip(compress(targets, seen), middles, variances.tolist(), strict=True):
            number = target.instance.id
            if settings.faces and number in eyes:
                towards = eyes[number] - origin
                distance = float(np.linalg.norm(towards))
                moments[number] = towards / distance, (FACE_RADIUS_M / distance) ** 2
            else:
                moments[number] = middle, variance
    return Views(
        ids=tuple(moments),
        directions=np.array([direction for direction, _ in moments.values()]).reshape(-1, 3),
        variances=np.array([variance for _, variance in moments.values()]),
    )


def _moments(rays: Float, reached: NDArray[np.bool_]) -> tuple[Float, Float]:
    """Mean directions (T, 3) of the rays (T, K, 3) that reach a target (T, K), at least one of each.

    And half of the mean squared chords (T,) about them: the variances per tangent direction.
    """
    count = reached.sum(axis=1)
    middles = unit((rays * reached[..., None]).sum(axis=1) / count[:, None])
    squares = ((rays - middles[:, None]) ** 2).sum(axis=-1)
    return middles, (squares * reached).sum(axis=1) / count / 2


def _cloud_rays(origin: Float, targets: tuple[Target, ...], count: int) -> Float:
    """Rays (T, count, 3) to points of each cloud."""
    points = np.stack([spaced(target.points_left, count) for target in targets]) - origin
    distance = np.linalg.norm(points, axis=-1, keepdims=True)
    return np.asarray(points / np.maximum(distance, np.finfo(float).tiny))


def spaced(points: np.ndarray, count: int) -> Float:
    """Choose ``count`` of the points (N, 3), evenly spaced in their order, with repetitions if N is less.

    The same number of the chosen ones are all of them.
    """
    return points[np.linspace(0, len(points) - 1, count).round().astype(np.intp)].astype(np.float64)


def _rays_about(origin: Float, boxes: tuple[Box3D, ...], count: int) -> Float:
    """Unit rays (T, K, 3), even over the narrowest cap about each box's centre that holds all of its corners.

    The whole sphere for a box that holds the eyes, or is so near that it fills half of their view. A cap's rays are a
    Fibonacci lattice, whose first ray is the axis.
    """
    towards = np.array([box.center_m for box in boxes]) - origin
    reach = angle_between(box_corners(boxes) - origin, towards[:, None]).max(axis=1)
    within = np.linalg.norm(towards, axis=-1) <= np.array([box.d_max_m for box in boxes])
    reach[within], towards[within] = np.pi, (0, 0, 1)
    return _lattices(reach, count) @ left_from_crop(towards).transpose(0, 2, 1)


def _lattices(reach_rad: Float, count: int) -> Float:
    """Lattices (T, K, 3) over caps about (0, 0, 1)."""
    share, right, down = _spiral(count)
    z = 1 - share * (1 - np.cos(reach_rad[:, None]))
    aside = np.sqrt(np.maximum(1 - z**2, 0))
    return np.stack([aside * right, aside * down, z], axis=-1)


@lru_cache(maxsize=4)
def _spiral(count: int) -> tuple[Float, Float, Float]:
    number = np.arange(count)
    angle = np.pi * (3 - np.sqrt(5)) * number
    return number / (count - 1), np.cos(angle), np.sin(angle)
