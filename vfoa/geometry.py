"""Pin-hole projection, directions and ray-box intersection: the only file with rotation conventions.

It uses three coordinate frames:

camera  the rectified left camera: x right, y down, z forward.
crop    the axes of the crop of a head: z along the ray from the camera to the head (away), x right and y down in
        the crop. Networks that see only a crop of a head answer in this frame. Wherever a person stands, (0, 0, -1)
        looks into the camera.
box     a box's own axes, from :attr:`vfoa.types.Box3D.left_from_box`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vfoa.recent import Recent
from vfoa.types import Box3D, Float, StereoRig

_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))

MEAN_ANGLE_PER_SIGMA = float(np.sqrt(np.pi / 2))
"""Mean angle of an error over its standard deviation in each tangent direction (Rayleigh)."""

CONE_HEIGHT_M = 1.10
"""Height of the cones for which the paper gives radii (Simões and Moreno 2022, synthetic cases)."""


# Angles


def unit(vectors: ArrayLike) -> Float:
    """Vectors (..., 3) scaled to length 1."""
    array = np.asarray(vectors, dtype=np.float64)
    return array / length_of(array)[..., None]


def length_of(vectors: Float) -> Float:
    """Lengths (...) of vectors (..., 3): the numbers of ``np.linalg.norm`` in half of its time for few vectors."""
    return np.asarray(np.sqrt(np.add.reduce(vectors * vectors, axis=-1)))


def cross(a: Float, b: Float) -> Float:
    """Vector products (3, ...) of vectors (3, ...): the numbers of ``np.cross`` in a fifth of its time for few."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def angle_between(a: ArrayLike, b: ArrayLike) -> Float:
    """Angles (...) in radians, 0 to pi, between vectors (..., 3) of any length; exact also for tiny angles.

    Kahan's formula: 2 atan2(|a/|a| - b/|b||, |a/|a| + b/|b||).
    """
    first, second = unit(a), unit(b)
    return np.asarray(2 * np.arctan2(length_of(first - second), length_of(first + second)))


def sigma_rad(error_deg: float) -> float:
    """Standard deviation per tangent direction, radians, of an error with this mean angle in degrees."""
    return math.radians(error_deg) / MEAN_ANGLE_PER_SIGMA


def fov_from_radius(radius_m: float) -> float:
    """Full apex angle in radians of a cone 1.10 m high with this base radius; the paper gives cones by their radius."""
    return float(2 * np.arctan2(radius_m, CONE_HEIGHT_M))


# Projection


def depth_from_disparity(disparity_px: ArrayLike, rig: StereoRig) -> Float:
    """Depth z in metres for disparities of any shape; NaN where unknown or not in front of the camera.

    z = fx B / (d + cx_right - cx).
    """
    shifted = np.asarray(disparity_px, dtype=np.float64) + (rig.cx_right_px - rig.cx_px)
    is_ahead = (shifted > 0) & (shifted < np.inf)
    return np.asarray(rig.fx_px * rig.baseline_m / np.where(is_ahead, shifted, np.nan))


def disparity_from_depth(depth_m: ArrayLike, rig: StereoRig) -> Float:
    """Disparity in pixels for depths of any shape; the inverse of :func:`depth_from_disparity`."""
    depth = np.asarray(depth_m, dtype=np.float64)
    of_parallel = rig.fx_px * rig.baseline_m / np.where(depth > 0, depth, np.nan)
    return np.asarray(of_parallel - (rig.cx_right_px - rig.cx_px))


def back_project(u_px: ArrayLike, v_px: ArrayLike, depth_m: ArrayLike, rig: StereoRig) -> Float:
    """Points (..., 3) in the camera frame, metres, of pixels (u, v) at depths z."""
    u, v, z = np.broadcast_arrays(*(np.asarray(value, dtype=np.float64) for value in (u_px, v_px, depth_m)))
    return np.stack([(u - rig.cx_px) * z / rig.fx_px, (v - rig.cy_px) * z / rig.fy_px, z], axis=-1)


def project(points_left: ArrayLike, rig: StereoRig) -> Float:
    """Pixels (..., 2) of points (..., 3) in the camera frame; NaN for points not in front of the camera."""
    points = np.asarray(points_left, dtype=np.float64)
    z = np.where(points[..., 2:] > 0, points[..., 2:], np.nan)
    return points[..., :2] / z * [rig.fx_px, rig.fy_px] + [rig.cx_px, rig.cy_px]


# Directions seen in a crop


def left_from_crop(ray_left: ArrayLike) -> Float:
    """Rotation (..., 3, 3) that turns directions in a crop's axes to the camera's, for the ray (..., 3) to the head.

    Columns r, d, f with f = ray / |ray|, r = (0, 1, 0) x f normalised, d = f x r. For a ray straight up or down,
    where that product is zero, r = (1, 0, 0).
    """
    rays = np.asarray(ray_left, dtype=np.float64)
    return _frame_of_one(*rays.tolist()) if rays.shape == (3,) else _frame_of_units(unit(rays))


def _frame_of_one(x: float, y: float, z: float) -> Float:
    """The same numbers for one ray, in a third of the time."""
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    level = float(np.hypot(x, z))
    sine, cosine = (x / level, z / level) if level > 0 else (0.0, 1.0)
    return np.array([(cosine, -y * sine, x), (0.0, level, y), (-sine, -y * cosine, z)])


def _frame_of_units(rays: Float) -> Float:
    x, y, z = rays.T
    level, sine, cosine = _bearing(x, z)
    right, down = (cosine, np.zeros_like(y), -sine), (-y * sine, level, -y * cosine)
    return np.array([right, down, (x, y, z)]).T


_TINY = 1e-300
"""A length that is lost beside any other: it decides the direction of vectors of length 0."""
_LESS_TINY = 1e-280
"""Another one, of offsets: what the first leaves in a direction along an axis does not cancel it."""


def _bearing(x: Float, z: Float) -> tuple[Float, Float, Float]:
    """Length (...) of the level part of unit vectors, and sine and cosine of its turn from z to x; 0, 1 without one."""
    ahead = z + _TINY
    level = np.hypot(x, ahead)
    return level - _TINY, x / level, ahead / level


def _components(vectors: Float) -> tuple[Float, Float, Float]:
    return vectors[..., 0], vectors[..., 1], vectors[..., 2]


def _vectors(*components: Float) -> Float:
    """Vectors (..., N) of N components (...), which are broadcast."""
    vectors = np.empty((*np.broadcast(*components).shape, len(components)))
    for axis, component in enumerate(components):
        vectors[..., axis] = component
    return vectors


def direction_from_crop(direction_crop: ArrayLike, ray_left: ArrayLike) -> Float:
    """Directions (..., 3) in the camera frame from directions (..., 3) in a crop's axes and rays (..., 3)."""
    return np.einsum("...ij,...j->...i", left_from_crop(ray_left), np.asarray(direction_crop, dtype=np.float64))


def head_direction_crop(yaw_rad: ArrayLike, pitch_rad: ArrayLike) -> Float:
    """Direction (..., 3) in the crop's axes of a head: yaw > 0 turned to the image's left, pitch > 0 up.

    (-sin y, -cos y sin p, -cos y cos p), the convention of FSA-Net and its relatives.
    """
    yaw, pitch = np.asarray(yaw_rad, dtype=np.float64), np.asarray(pitch_rad, dtype=np.float64)
    return np.stack([-np.sin(yaw), -np.cos(yaw) * np.sin(pitch), -np.cos(yaw) * np.cos(pitch)], axis=-1)


def head_angles(crop_from_head: ArrayLike) -> tuple[float, float, float]:
    """Yaw, pitch and roll in radians of a head's rotation (3, 3), as :func:`head_direction_crop` has them.

    The head's own axes are those of the crop when it faces the camera upright: x to the image's right, y to the chin,
    z to the back of the head. roll > 0 turns it clockwise in the image. At a yaw of 90 degrees, pitch and roll are one.
    """
    rotation = np.asarray(crop_from_head, dtype=np.float64)
    yaw = math.asin(float(np.clip(rotation[0, 2], -1, 1)))
    return yaw, math.atan2(rotation[1, 2], rotation[2, 2]), math.atan2(-rotation[0, 1], rotation[0, 0])


def gaze_direction_crop(theta_rad: ArrayLike, phi_rad: ArrayLike) -> Float:
    """Direction (..., 3) in the crop's axes of a gaze in Gaze360's angles: theta > 0 image-left, phi > 0 up.

    Gaze360's eye frame has x to the image's left and y up: (cos phi sin theta, sin phi, -cos phi cos theta) there.
    """
    theta, phi = np.asarray(theta_rad, dtype=np.float64), np.asarray(phi_rad, dtype=np.float64)
    return np.stack([-np.cos(phi) * np.sin(theta), -np.sin(phi), -np.cos(phi) * np.cos(theta)], axis=-1)


def pixel_ray(u_px: float, v_px: float, rig: StereoRig) -> Float:
    """Unit ray (3,) from the camera through a pixel."""
    return unit(back_project(u_px, v_px, 1.0, rig))


def perturb(direction: ArrayLike, right_rad: ArrayLike, down_rad: ArrayLike) -> Float:
    """Directions (..., 3) rotated by an angle of hypot(right, down) towards (right, down) of their own tangent plane.

    The exponential map on the sphere, with the tangent axes of :func:`left_from_crop`.
    """
    x, y, z = _components(unit(direction))
    level, sine, cosine = _bearing(x, z)
    right, down = np.asarray(right_rad, dtype=np.float64), np.asarray(down_rad, dtype=np.float64)
    angle = np.hypot(right, down)
    scale = np.sinc(angle / np.pi)
    right, down, ahead = right * scale, down * scale, np.cos(angle)
    return _vectors(
        cosine * right - y * sine * down + x * ahead,
        level * down + y * ahead,
        z * ahead - sine * right - y * cosine * down,
    )


def lowered(direction: Float, angle_rad: float) -> Float:
    """Unit vector (3,) turned down by an angle: :func:`perturb` of one direction, in a fifth of its time."""
    x, y, z = direction.tolist()
    level = math.hypot(x, z)
    sine, cosine = (x / level, z / level) if level > 0 else (0.0, 1.0)
    down, ahead = math.sin(angle_rad), math.cos(angle_rad)
    return np.array([x * ahead - y * sine * down, y * ahead + level * down, z * ahead - y * cosine * down])


def tangent_offset(direction: ArrayLike, other: ArrayLike) -> Float:
    """Angles (..., 2) towards (right, down) that rotate ``direction`` into ``other``: the inverse of :func:`perturb`.

    The logarithmic map on the sphere. For the opposite direction, where it is ambiguous, the result points right.
    """
    first, second = (np.moveaxis(np.asarray(each, dtype=np.float64), -1, 0) for each in (direction, other))
    return np.moveaxis(tangent_offsets(first, second), 0, -1)


def tangent_offsets(directions: Float, others: Float) -> Float:
    """Angles (2, ...) of :func:`tangent_offset` between vectors (3, ...) of any length: components first."""
    (x, y, z), (p, q, r) = directions, others
    level, sine, cosine = _bearing(x, z)
    along = sine * p + cosine * r
    right, down = np.hypot(level, y) * (cosine * p - sine * r) + _LESS_TINY, level * q - y * along
    aside = np.hypot(right, down)
    return np.arctan2(aside, y * q + level * along) / aside * np.array([right, down])


def on_the_way(starts: Float, ends: Float, share: Float) -> Float:
    """Vectors (3, ...) at shares (...) of the great circles from unit vectors to others, each (3, ...).

    Their length is the sine of the whole angle.
    """
    half_chord = np.minimum(np.sqrt(((starts - ends) ** 2).sum(axis=0)) / 2, 1)
    angle = np.maximum(2 * np.arcsin(half_chord), 1e-6)
    return np.sin((1 - share) * angle) * starts + np.sin(share * angle) * ends


def turn_about_z(angle_rad: float) -> Float:
    """Rotation (3, 3) about z by an angle; positive angles turn x towards y."""
    sine, cosine = np.sin(angle_rad), np.cos(angle_rad)
    return np.array([(cosine, -sine, 0), (sine, cosine, 0), (0, 0, 1)])


def quaternion(rotation: ArrayLike) -> tuple[float, float, float, float]:
    """The unit quaternion (x, y, z, w) of a rotation (3, 3), from the largest of its four parts, as Shepperd (1978)."""
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(rotation, dtype=np.float64).tolist()
    parts = (
        (1 + a - e - i, b + d, c + g, h - f),
        (b + d, 1 + e - a - i, f + h, c - g),
        (c + g, f + h, 1 + i - a - e, d - b),
        (h - f, c - g, d - b, 1 + a + e + i),
    )
    largest = max(range(4), key=lambda part: parts[part][part])
    x, y, z, w = parts[largest]
    length = math.hypot(x, y, z, w)
    return x / length, y / length, z / length, w / length


def rotation_of(quaternion: ArrayLike) -> Float:
    """The rotation (..., 3, 3) of quaternions (..., 4), x, y, z, w, of any length but 0. See :func:`quaternion`."""
    from scipy.spatial.transform import Rotation  # not above: it takes as long as all other imports of a run

    return np.asarray(Rotation.from_quat(np.asarray(quaternion, dtype=np.float64)).as_matrix())


# Boxes

_PARALLEL = 1e-200
"""A smaller component of a direction counts as zero: its inverse, times a distance, would overflow."""


def box_iou(a_px: Float, b_px: Float) -> float:
    """Intersection over union, in [0, 1], of two image boxes (u0, v0, u1, v1); 0 where both are empty."""
    (a0, b0, a1, b1), (c0, d0, c1, d1) = a_px.tolist(), b_px.tolist()
    common = max(0.0, min(a1, c1) - max(a0, c0)) * max(0.0, min(b1, d1) - max(b0, d0))
    union = (a1 - a0) * (b1 - b0) + (c1 - c0) * (d1 - d0) - common
    return common / union if union > 0 else 0.0


class Boxes(NamedTuple):
    """T boxes as arrays, camera frame, metres: ``center`` and ``half_size`` (T, 3), ``corners`` (T, 8, 3).

    ``d_max`` and ``d_min`` (T,) are the greatest and the least distance of the surface from the centre.
    ``left_from_box`` (T, 3, 3) has their axes in its columns. Rows of directions times ``cube_from_left`` (T, 3, 3) are
    in the axes of the box and in units of its half sizes, in which it is the cube from -1 to 1.
    """

    center: Float
    half_size: Float
    left_from_box: Float
    cube_from_left: Float
    corners: Float
    d_max: Float
    d_min: Float

    def in_cubes(self, point_left: Float) -> Float:
        """A point (..., 3) in the cube of each box (..., T, 3)."""
        offset = point_left[..., None, :] - self.center
        return np.asarray(np.einsum("...ji,...j->...i", self.left_from_box, offset) / self.half_size)


_STACKED: Recent[Boxes] = Recent(32)


def stacked(boxes: Sequence[Box3D]) -> Boxes:
    """Return boxes as arrays; the last ones are kept, since people and configurations look at the same boxes."""
    return _STACKED.get(tuple(boxes), (), lambda: _stacked(boxes))


def _stacked(boxes: Sequence[Box3D]) -> Boxes:
    center = np.array([box.center_m for box in boxes]).reshape(-1, 3)
    half_size = np.array([box.half_size_m for box in boxes]).reshape(-1, 3)
    axes = np.array([box.left_from_box for box in boxes]).reshape(-1, 3, 3)
    corners = center[:, None] + (_CORNERS * half_size[:, None]) @ axes.transpose(0, 2, 1)
    d_max, d_min = np.sqrt((half_size**2).sum(axis=1)), half_size.min(axis=1, initial=np.inf)
    return Boxes(center, half_size, axes, axes / half_size[:, None, :], corners, d_max, d_min)


class Outlines(NamedTuple):
    """T boxes as seen from a point: ``distance`` (T,) of their centres, ``axes`` (T, 3, 3) and ``corners`` (T, 8, 3).

    The axes right, down and ahead, to the centre, are columns. The corners are from the point, in these axes.
    """

    distance: Float
    axes: Float
    corners: Float


_OUTLINES: Recent[Outlines] = Recent(32)
NEAREST_M = 1e-6
"""What is nearer to the point counts as ahead of it."""


def outlines(origin_left: Float, boxes: Sequence[Box3D]) -> Outlines:
    """Return boxes as seen from a point (3,); the last ones are kept, as by :func:`stacked`."""
    return _OUTLINES.get(tuple(boxes), (origin_left.tobytes(),), lambda: _outlines(origin_left, stacked(boxes)))


def _outlines(origin_left: Float, boxes: Boxes) -> Outlines:
    towards = boxes.center - origin_left
    distance = length_of(towards)
    towards[distance < NEAREST_M] = 0, 0, 1
    axes = left_from_crop(towards)
    return Outlines(distance, axes, (boxes.corners - origin_left) @ axes)


def box_corners(boxes: Sequence[Box3D]) -> Float:
    """The eight corners (T, 8, 3) of each box, camera frame, metres."""
    return stacked(boxes).corners


def of_people(boxes: Sequence[Boxes]) -> Boxes:
    """The boxes of P people, T each, as arrays (P, T, ...)."""
    return Boxes(*map(np.array, zip(*boxes, strict=True)))


def entry_distances(origins_left: Float, directions: Float, boxes: Boxes) -> Float:
    """Distances (P, R, T) along each of R unit directions to the entry into each of T boxes, for P people; NaN: a miss.

    Origins are (P, 3), directions (P, R, 3), boxes (P, T, ...) as :func:`of_people` gives them. Only entries ahead
    count (t >= 0); an origin inside a box enters it at distance 0.

    The slab method (Kay and Kajiya 1986). A direction component of zero is handled by a branch, since the branch-free
    form gives NaN for an origin on the plane of a face.

    In the box's own axes and in units of its half sizes, a box is the cube from -1 to 1. The axes come first in the
    arrays, (3, P, R, T), so that the extremes over the three slabs are taken between whole planes. This is several
    times faster than taking them within each ray's own three numbers.
    """
    along = directions @ boxes.cube_from_left.transpose(3, 0, 2, 1)
    entry, leave = _slabs(boxes.in_cubes(origins_left).transpose(2, 0, 1)[:, :, None, :], along)
    return np.where(leave >= entry, entry, np.nan)


def _slabs(origin: Float, along: Float) -> tuple[Float, Float]:
    """Distances (...) of entry and exit of the cube, for origins and directions (3, ...), which are overwritten.

    A ray that misses the cube leaves before it enters.
    """
    size = np.abs(along)
    parallel = size < _PARALLEL if size.min(initial=1) < _PARALLEL else None
    if parallel is not None:
        along[parallel] = 1
    inverse = 1 / along
    middle, reach = -origin * inverse, np.abs(inverse)
    near, far = middle - reach, middle + reach
    if parallel is not None:
        near[parallel], far[parallel] = -np.inf, np.inf
        near[parallel & (np.abs(origin) > 1)] = np.inf
    entry = np.maximum(near.max(axis=0), 0)
    return entry, far.min(axis=0)
