"""Each target as seen from a pair of eyes: its mean direction, and its angular spread."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress

import numpy as np

from vfoa.geometry import length_of, meets_own_box, outlines
from vfoa.recent import Recent
from vfoa.types import Box3D, Float, Target

FACE_RADIUS_M = 0.07
"""Spread of looks at a face about the point between its eyes, per direction: eyes, nose and mouth."""

RAYS = 128
"""Number of rays to a target."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VisibleTargets:
    """The targets as seen: ids, middle directions (T, 3), and variances (T,) per tangent direction, rad^2."""

    ids: tuple[int, ...]
    directions: Float
    variances: Float


_RECENT: Recent[VisibleTargets] = Recent(32)


def visible_targets(
    origin: Float, targets: tuple[Target, ...], eyes: Mapping[int, Float], *, clouds: bool = False
) -> VisibleTargets:
    """Return each target as seen from ``origin`` (3,), through everything in front of it.

    A target is its box or, with ``clouds``, its cloud as the camera saw it, if any target has one. People are looked at
    in the face, if their eye origin is known and another point: ``eyes`` are those of other people by instance id. Left
    out are targets without a box, and targets without a cloud if clouds are asked for and other targets have one.
    Configurations that ask for the same targets one after the other share an answer: also those with clouds and with
    boxes, where no target has a cloud.
    """
    clouds = clouds and any(len(target.points_left) for target in targets)
    asked = origin.tobytes(), tuple((number, eyes[number].tobytes()) for number in sorted(eyes)), clouds
    return _RECENT.get(targets, asked, lambda: _visible_targets(origin, targets, eyes, clouds))


def _visible_targets(
    origin: Float, targets: tuple[Target, ...], eyes: Mapping[int, Float], clouds: bool
) -> VisibleTargets:
    seen = {target.instance.id: target for target in targets if target.box and (not clouds or len(target.points_left))}
    boxes = tuple(target.box for target in seen.values() if target.box is not None)
    if clouds:
        means = _mean_rays_to_clouds(origin, tuple(seen.values()), RAYS)
    else:
        means = _mean_rays_to_boxes(origin, boxes, RAYS)
    reached = np.isfinite(means[:, 0])
    ids, means = tuple(compress(seen, reached)), means[reached]
    # the mean of unit rays is shorter by half of their mean squared chord about its direction
    lengths = length_of(means)
    directions, variances = means / lengths[:, None], 1 - lengths
    for row, number in enumerate(ids):
        towards = eyes.get(number, origin) - origin
        if (distance := length_of(towards)) > 0:
            directions[row], variances[row] = towards / distance, (FACE_RADIUS_M / distance) ** 2
    return VisibleTargets(ids=ids, directions=directions, variances=variances)


def _mean_rays_to_clouds(origin: Float, targets: tuple[Target, ...], count: int) -> Float:
    """Means (T, 3) of the unit rays to ``count`` points of each cloud."""
    points = np.stack([spaced(target.points_left, count) for target in targets]) - origin
    square = np.einsum("tnc,tnc->tn", points, points)
    per_length = 1 / np.sqrt(np.maximum(square, np.finfo(float).tiny))
    return np.asarray((per_length[:, None] @ points)[:, 0] / count)


def spaced(points: np.ndarray, count: int) -> Float:
    """Choose ``count`` of the points (N, 3), evenly spaced in their order, with repetitions if N is less.

    The same number of the chosen ones are all of them.
    """
    if len(points) != count:
        points = points[np.linspace(0, len(points) - 1, count).round().astype(np.intp)]
    return points.astype(np.float64)


def _mean_rays_to_boxes(origin: Float, boxes: tuple[Box3D, ...], count: int) -> Float:
    """Means (T, 3) of the unit rays that meet each box, NaN for a box that none meets.

    The rays are even over the narrowest cap about the centre of the box that holds its corners: the whole sphere for a
    box that holds the eyes, or reaches half around them.
    """
    seen = outlines(origin, boxes)
    right, down, ahead = seen.corners.T
    reach, axes = np.arctan2(np.hypot(right, down), ahead).max(axis=0), seen.axes
    is_around = reach >= np.pi / 2
    if is_around.any():
        reach[is_around], axes = np.pi, np.where(is_around[:, None, None], np.eye(3), axes)
    rays = _lattices(reach, count)
    met = meets_own_box(origin, axes, rays, boxes)
    counts = met.sum(axis=1)[:, None]
    means = (rays @ met[..., None])[..., 0] / np.where(counts, counts, np.nan)
    return np.asarray((axes @ means[..., None])[..., 0])


def _lattices(reach_rad: Float, count: int) -> Float:
    """Fibonacci lattices (T, 3, K) over caps about (0, 0, 1), the first ray of each."""
    share, turns = _spiral(count)
    below = share * (1 - np.cos(reach_rad[:, None]))
    rays = np.sqrt(below * (2 - below))[:, None] * turns
    rays[:, 2] = 1 - below
    return np.asarray(rays)


@lru_cache(maxsize=4)
def _spiral(count: int) -> tuple[Float, Float]:
    """The share (K,) of the height of the cap below its top, and the direction (3, K) aside, of each ray."""
    number = np.arange(count)
    angle = np.pi * (3 - np.sqrt(5)) * number
    return number / (count - 1), np.array([np.cos(angle), np.sin(angle), np.zeros(count)])
