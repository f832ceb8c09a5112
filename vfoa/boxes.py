"""3D boxes around point clouds."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from vfoa.geometry import left_from_crop, turn_about_z
from vfoa.types import Box3D, Float

MIN_HALF_SIZE_M = 0.001
"""Half the thickness given to a flat cloud, so that its box has a volume."""

_RESOLVED = 1e-7
"""Relative to the distance: rounding errors of hulls are smaller, even for points 1e11 m away (Sintel's sky)."""


def axis_aligned_box(points_left: Float) -> Box3D:
    """Return the smallest box that holds (N, 3) points and is aligned with the camera's axes."""
    return _box_along(np.eye(3), points_left)


def oriented_box(points_left: Float) -> Box3D:
    """Return the smallest box, in any orientation, that holds (N, 3) points and has a face on their convex hull.

    Of the 24 ways to name its axes, the one nearest to the camera's axes is taken.
    """
    axes = _smallest_axes(_thickened(points_left))
    axes = axes[:, max(permutations(range(3)), key=lambda order: np.abs(axes[range(3), order]).sum())]
    # the nearest naming is right-handed: its diagonal sums to more than 1, which no left-handed one reaches
    return _box_along(axes * np.where(np.diag(axes) < 0, -1, 1), points_left)


def _smallest_axes(points: Float) -> Float:
    """Return the axes (3, 3) of the smallest box with a face on a face of the points' hull.

    Open3D's minimal box returns the camera's axes, with only a warning, for many clouds that are almost flat.
    """
    import cv2
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points - points.mean(axis=0))
    vertices = hull.points[hull.vertices]
    smallest, axes = np.inf, np.eye(3)
    # several triangles often lie in one face
    for left_from_face in left_from_crop(np.unique(hull.equations[:, :3].round(9), axis=0)):
        local = vertices @ left_from_face
        _, size, angle_deg = cv2.minAreaRect(local[:, :2].astype(np.float32))
        volume = float(np.prod(size) * np.ptp(local[:, 2]))
        if volume < smallest:
            smallest, axes = volume, left_from_face @ turn_about_z(np.deg2rad(angle_deg))
    return axes


def _box_along(axes: Float, points: Float) -> Box3D:
    local = points @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    half = np.maximum((high - low) / 2, MIN_HALF_SIZE_M)
    return Box3D(center_m=axes @ (low + high) / 2, half_size_m=half, left_from_box=axes)


def _thickened(points: Float) -> Float:
    """Add two shifted copies of the points for every direction in which they are flat, so that they have a hull."""
    offsets = points - points.mean(axis=0)
    variances, directions = np.linalg.eigh(offsets.T @ offsets / len(points))
    half = max(MIN_HALF_SIZE_M, _RESOLVED * float(np.abs(points).max()))
    for direction in directions.T[variances < half**2]:
        points = np.concatenate([points - half * direction, points + half * direction])
    return points
