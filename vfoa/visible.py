"""Each target as seen from a pair of eyes: its mean direction, and its angular spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vfoa.geometry import NEAREST_M, cross, length_of, outlines, stacked, unit
from vfoa.recent import Recent
from vfoa.types import Box3D, Float, Target

FACE_RADIUS_M = 0.07
"""Spread of looks at a face about the point between its eyes, per direction: eyes, nose and mouth."""

RAYS = 128
"""Number of rays to a target's cloud."""

_RING = ((0, 0), (1, 0), (1, 1), (0, 1))
_FACES = [
    [side << (2 - axis) | i << (2 - (axis + 1) % 3) | j << (2 - (axis + 2) % 3) for i, j in ring]
    for side, ring in ((1, _RING), (0, _RING[::-1]))
    for axis in range(3)
]
"""The places, among a box's corners, of those of each face, clockwise as seen from within; +x, +y, +z, -x, -y, -z."""
_TRIANGLES = np.array([triangle for a, b, c, d in _FACES for triangle in ((a, b, c), (a, c, d))]).T
"""Those of two triangles of each face (3, 12)."""
_EDGES = np.array([(a, b) for a in range(8) for b in range(a) if (a ^ b).bit_count() == 1]).T
"""Those of each edge's ends (2, 12)."""
_SIDES = [{*pairwise([*face, face[0]])} for face in _FACES]
_FACES_OF_EDGES = np.array([[((b, a) in of_face) - ((a, b) in of_face) for a, b in _EDGES.T] for of_face in _SIDES])
"""Whether an edge is a side of a face (6, 12): 1 in its direction, -1 against it."""
_LEAST_LENGTH = 1e-6
"""A shorter mean has no direction: the rays go all around."""


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
    means = _mean_rays_to_clouds(origin, tuple(seen.values())) if clouds else _mean_rays_to_boxes(origin, boxes)
    # the mean of unit rays is shorter by half of their mean squared chord about its direction
    lengths = length_of(means)
    is_around = lengths < _LEAST_LENGTH
    means[is_around] = outlines(origin, boxes).axes[is_around, :, 2]
    directions, variances = unit(means), np.maximum(1 - lengths, 0)
    for row, number in enumerate(seen):
        towards = eyes.get(number, origin) - origin
        if (distance := length_of(towards)) > 0:
            directions[row], variances[row] = towards / distance, (FACE_RADIUS_M / distance) ** 2
    return VisibleTargets(ids=tuple(seen), directions=directions, variances=variances)


def _mean_rays_to_clouds(origin: Float, targets: tuple[Target, ...]) -> Float:
    """Means (T, 3) of the unit rays to :data:`RAYS` points of each cloud."""
    points = np.stack([spaced(target.points_left, RAYS) for target in targets]) - origin
    square = np.einsum("tnc,tnc->tn", points, points)
    per_length = 1 / np.sqrt(np.maximum(square, np.finfo(float).tiny))
    return np.asarray((per_length[:, None] @ points)[:, 0] / RAYS)


def spaced(points: np.ndarray, count: int) -> Float:
    """Choose ``count`` of the points (N, 3), evenly spaced in their order, with repetitions if N is less.

    The same number of the chosen ones are all of them.
    """
    if len(points) != count:
        points = points[np.linspace(0, len(points) - 1, count).round().astype(np.intp)]
    return points.astype(np.float64)


def _mean_rays_to_boxes(origin: Float, boxes: Sequence[Box3D]) -> Float:
    """Means (T, 3) of the unit rays from ``origin`` (3,) that meet each box, even over all directions that do.

    The faces that are turned to the origin cover these directions. The integral of unit vectors over them is half the
    sum, over the sides of their outline, of the angle of each times its normal (Lambert's formula; Arvo, "Applications
    of Irradiance Tensors to the Simulation of Non-Lambertian Phenomena", SIGGRAPH 1995). All rays from within a box
    meet it: the mean is 0.
    """
    known = stacked(boxes)
    at = known.in_cubes(origin)
    is_turned = np.concatenate([at >= 1, at <= -1], axis=1).astype(np.float64)
    corners = known.corners - origin
    rays = (corners / np.maximum(length_of(corners), NEAREST_M)[..., None]).transpose(2, 0, 1)
    begins, ends = rays[..., _EDGES[0]], rays[..., _EDGES[1]]
    normals = cross(begins, ends)
    sines = np.sqrt((normals**2).sum(axis=0))
    angles = np.arctan2(sines, (begins * ends).sum(axis=0))
    sides = (is_turned @ _FACES_OF_EDGES) * angles / np.where(sines > 0, sines, 1)
    integral = (sides * normals).sum(axis=2).T / 2
    solid_angle = (is_turned * _solid_angles(rays)).sum(axis=1)[:, None]
    return np.asarray(np.divide(integral, solid_angle, out=np.zeros_like(integral), where=solid_angle > 0))


def _solid_angles(rays: Float) -> Float:
    """Solid angles (T, 6) of the faces of T boxes, of two triangles each; ``rays`` (3, T, 8) are to their corners.

    Van Oosterom and Strackee, IEEE Transactions on Biomedical Engineering 30, 1983.
    """
    first, second, third = (rays[..., places] for places in _TRIANGLES)
    volume = np.abs((first * cross(second, third)).sum(axis=0))
    cosines = (first * second + second * third + third * first).sum(axis=0)
    return np.asarray(2 * np.arctan2(volume, 1 + cosines).reshape(-1, 6, 2).sum(axis=2))
