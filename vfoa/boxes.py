"""Boxes about clouds of points."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from vfoa.types import Box3D, Float

MIN_HALF_SIZE_M = 0.001
"""Half the thickness given to a cloud that is flat: a box has an inside."""


def axis_aligned_box(points_left: Float) -> Box3D:
    """The smallest box that holds (N, 3) points, along the camera's axes."""
    return _box_along(np.eye(3), points_left)


def oriented_box(points_left: Float) -> Box3D:
    """The smallest box that holds (N, 3) points, with a face on their convex hull (Open3D).

    Of the 24 ways to name its axes, that nearest to the camera's axes is taken.
    """
    import open3d

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(_thickened(points_left)))
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        # it warns of axes that are not quite orthogonal, and they are made so below
        axes = np.array(cloud.get_minimal_oriented_bounding_box().R)
    axes = axes[:, max(permutations(range(3)), key=lambda order: np.abs(axes[range(3), order]).sum())]
    # right-handed: named like this, the diagonal sums to more than 1, and no left-handed triad's does
    left, _, right = np.linalg.svd(axes * np.where(np.diag(axes) < 0, -1, 1))
    return _box_along(left @ right, points_left)


def _box_along(axes: Float, points: Float) -> Box3D:
    local = points @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    half = np.maximum((high - low) / 2, MIN_HALF_SIZE_M)
    return Box3D(center_m=axes @ (low + high) / 2, half_size_m=half, left_from_box=axes)


def _thickened(points: Float) -> Float:
    """Points with two copies moved apart along every direction in which they are flat, so that they have a hull."""
    offsets = points - points.mean(axis=0)
    variances, directions = np.linalg.eigh(offsets.T @ offsets / len(points))
    for direction in directions.T[variances < MIN_HALF_SIZE_M**2]:
        points = np.concatenate([points - MIN_HALF_SIZE_M * direction, points + MIN_HALF_SIZE_M * direction])
    return points
