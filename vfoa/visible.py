"""Where each target lies for a pair of eyes: its middle direction, and how far what they see of it spreads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.geometry import angle_between, box_corners, entry_distance, left_from_crop, unit
from vfoa.settings import Settings
from vfoa.types import Box3D, Float, Target

FACE_RADIUS_M = 0.07
"""Spread of the looks at a face about the point between its eyes, per direction: eyes, nose and mouth."""

_SURFACE_DEPTH_M = 0.03
"""A point of a cloud is hidden by a box that is entered this much before it."""


class SurfaceSettings(Settings):
    """Settings of :func:`views_of`.

    ``surface``: a target is its box, or its cloud as the camera saw it; a measured scene has no clouds, only boxes.
    ``occlusion``: it is seen where it is met first, or wherever it lies. ``faces``: people are looked at in the face,
    where their eyes are known. ``directions`` is how many directions a target's outline is sampled with.
    """

    surface: Literal["box", "cloud"] = "cloud"
    occlusion: Literal["ignore", "first_hit"] = "ignore"
    faces: bool = True
    directions: int = Field(default=128, ge=16, le=10_000)


@dataclass(frozen=True, slots=True, kw_only=True)
class Views:
    """The targets that are seen: ids, middle directions (T, 3), and variances (T,) per tangent direction, rad^2."""

    ids: tuple[int, ...]
    directions: Float
    variances: Float


def views_of(origin: Float, targets: tuple[Target, ...], eyes: Mapping[int, Float], settings: SurfaceSettings) -> Views:
    """What is seen of each target from ``origin`` (3,); a target that others hide altogether is left out.

    ``eyes`` are the eye origins of other people by instance id. Targets without a box, or without a cloud where that is
    what is looked at and other targets have one, are left out, too.
    """
    clouds = settings.surface == "cloud" and any(len(each.points_left) for each in targets)
    targets = tuple(each for each in targets if each.box and (not clouds or len(each.points_left)))
    boxes = tuple(target.box for target in targets if target.box is not None)
    found: dict[int, tuple[Float, float]] = {}
    if boxes:
        rays, seen = (_cloud_rays if clouds else _box_rays)(origin, targets, boxes, settings)
        for target, directions, kept in zip(targets, rays, seen, strict=True):
            number = target.instance.id
            if not kept.any():
                continue
            if settings.faces and number in eyes:
                towards = eyes[number] - origin
                distance = float(np.linalg.norm(towards))
                found[number] = towards / distance, (FACE_RADIUS_M / distance) ** 2
            else:
                found[number] = _moments(directions[kept])
    return Views(
        ids=tuple(found),
        directions=np.array([direction for direction, _ in found.values()]).reshape(-1, 3),
        variances=np.array([variance for _, variance in found.values()]),
    )


def _moments(directions: Float) -> tuple[Float, float]:
    """The mean direction, and the mean squared chord about it, half for each tangent direction."""
    middle = unit(directions.mean(axis=0))
    return middle, float(((directions - middle) ** 2).sum(axis=1).mean() / 2)


def _box_rays(
    origin: Float, targets: tuple[Target, ...], boxes: tuple[Box3D, ...], settings: SurfaceSettings
) -> tuple[Float, np.ndarray]:
    """Rays (T, K, 3) about each box, and which of them (T, K) reach it (first, unless occlusion is ignored)."""
    rays = np.stack([_rays_about(origin, box, settings.directions) for box in boxes])
    count = len(boxes)
    entry = entry_distance(origin, rays.reshape(-1, 3), boxes).reshape(count, -1, count)
    own = np.einsum("tkt->tk", entry)
    seen = np.isfinite(own)
    if settings.occlusion == "first_hit":
        seen &= own <= np.fmin.reduce(entry, axis=2, initial=np.inf)
    return rays, seen


def _cloud_rays(
    origin: Float, targets: tuple[Target, ...], boxes: tuple[Box3D, ...], settings: SurfaceSettings
) -> tuple[Float, np.ndarray]:
    """Rays (T, K, 3) to points of each cloud, and which of them (T, K) no other box stops."""
    count = len(targets)
    points = np.stack([_spaced(target.points_left, settings.directions) for target in targets]) - origin
    distance = np.linalg.norm(points, axis=-1)
    rays = points / np.maximum(distance, np.finfo(float).tiny)[..., None]
    if settings.occlusion == "ignore":
        return rays, np.ones(distance.shape, dtype=np.bool_)
    entry = entry_distance(origin, rays.reshape(-1, 3), boxes).reshape(count, -1, count)
    entry[np.arange(count), :, np.arange(count)] = np.nan
    return rays, distance - _SURFACE_DEPTH_M <= np.fmin.reduce(entry, axis=2, initial=np.inf)


def _spaced(points: np.ndarray, count: int) -> Float:
    """``count`` of the points (N, 3), evenly spaced in their order; some of them several times where N is less."""
    return points[np.linspace(0, len(points) - 1, count).round().astype(np.intp)].astype(np.float64)


def _rays_about(origin: Float, box: Box3D, count: int) -> Float:
    """Unit rays (K, 3), even over the narrowest cap about the box's centre that holds all of its corners.

    The whole sphere for eyes inside of the box or so near that it fills half of what they see.
    """
    corners = box_corners(box) - origin
    towards = box.center_m - origin
    if np.linalg.norm(towards) <= box.d_max_m:
        return _cap(count, float(np.pi), (0.0, 0.0, 1.0))
    reach = float(angle_between(corners, towards).max())
    return _cap(count, reach, tuple(towards.tolist()))


def _cap(count: int, reach_rad: float, towards: tuple[float, ...]) -> Float:
    """A Fibonacci lattice (K, 3) over a cap; its first ray is the axis."""
    share, right, down = _spiral(count)
    z = 1 - share * (1 - np.cos(reach_rad))
    aside = np.sqrt(np.maximum(1 - z**2, 0))
    return np.stack([aside * right, aside * down, z], axis=-1) @ left_from_crop(unit(towards)).T


@lru_cache(maxsize=4)
def _spiral(count: int) -> tuple[Float, Float, Float]:
    number = np.arange(count)
    angle = np.pi * (3 - np.sqrt(5)) * number
    return number / (count - 1), np.cos(angle), np.sin(angle)
