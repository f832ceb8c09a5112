"""The eye origin: the point between the eyes where gaze begins, from a head's box, its depths and its direction.

head     The head is a ball, seen as the ellipse in its box. Each pixel gives an estimate of the depth of the ball's
         middle; their median is used. The eyes are where the head's direction leaves the ball. Its radius is the mean
         half side of the box, since a head is about as long as the mean of its breadth and its height.
patch    The paper's (Simões and Moreno 2022): the median of the points of a square patch, centred in the box, at 35 %
         of its height from the top. It is right for a head turned to the camera. For one turned by 40 degrees, or bent
         over a table, the patch lies on the temple or the hair, and the cone's apex is off by up to 7 cm.

A head without a direction, or with too few points, uses the patch; with too few points in it, a patch twice as wide;
then the median of the person's points in the box.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from vfoa.geometry import back_project, project
from vfoa.pixels import ViewMaps, known_pixels, points_of, window_of
from vfoa.types import Float, Head, HeadView

EyeMethod = Literal["head", "patch"]

EYE_HEIGHT = 0.35
"""Height of the patch in a head's box, from its top (the paper's 65 % counts from the bottom)."""

EYE_PATCH = 0.2
"""Side of the patch, in widths of the head's box (the paper's value)."""


class PointLimits(NamedTuple):
    """Least points that an eye origin needs, and most that it is computed from (None: all)."""

    least: int
    most: int | None = None


def eye_origin(
    view: HeadView, instance_id: int | None, seen: ViewMaps, *, method: EyeMethod, points: PointLimits
) -> Float | None:
    """Return the point (3,) between a head's eyes, metres, camera frame; None where too few points are known.

    ``instance_id`` is the person's: pixels of other instances do not count. None: the person is not known, all count.
    """
    if method == "head" and view.head_pose is not None:
        ball = _ball(view.head, instance_id, seen, points)
        if ball is not None:
            center, radius = ball
            return center + radius * view.head_pose.direction
    return _patch(view.head, instance_id, seen, points)


def _ball(head: Head, instance_id: int | None, seen: ViewMaps, limits: PointLimits) -> tuple[Float, float] | None:
    """Middle (3,) and radius of the ball in a head's box, metres; None if the ball would contain the camera."""
    u0, v0, u1, v1 = head.box_px
    rig = seen.rig
    points = _points_in((u0, v0, u1, v1), instance_id, seen, limits.most)
    middle, half = np.array([u0 + u1, v0 + v1]) / 2, np.array([u1 - u0, v1 - v0]) / 2
    from_middle = (((project(points, rig) - middle) / half) ** 2).sum(axis=1)
    inside = from_middle <= 1
    radius_per_m = float((half / [rig.fx_px, rig.fy_px]).mean())
    if np.count_nonzero(inside) < limits.least or radius_per_m >= 1:
        return None
    # the surface is sqrt(1 - rho^2) radii in front of the middle, and the radius is proportional to the middle's depth
    depth = float(np.median(points[inside, 2] / (1 - radius_per_m * np.sqrt(1 - from_middle[inside]))))
    return back_project(middle[0], middle[1], depth, rig), radius_per_m * depth


def _patch(head: Head, instance_id: int | None, seen: ViewMaps, limits: PointLimits) -> Float | None:
    """Median (3,) of the points of the patch, else of a patch twice as wide, else of the person in the head's box."""
    u0, v0, u1, v1 = head.box_px
    center_u, center_v, side = (u0 + u1) / 2, v0 + EYE_HEIGHT * (v1 - v0), EYE_PATCH * (u1 - u0)
    patches = [(center_u - half, center_v - half, center_u + half, center_v + half) for half in (side / 2, side)]
    regions = patches if instance_id is None else [*patches, (u0, v0, u1, v1)]
    for region in regions:
        points = _points_in(region, instance_id, seen, limits.most)
        if len(points) >= limits.least:
            return np.median(points, axis=0)
    return None


def _points_in(
    region: tuple[float, float, float, float], instance_id: int | None, seen: ViewMaps, most: int | None
) -> Float:
    """At most so many points (N, 3) of the person's pixels in a region; of all pixels if the person is not known."""
    window = window_of(*region, seen.rig)
    ids = seen.instances.ids[window]
    mask = np.full(ids.shape, True) if instance_id is None else np.equal(ids, instance_id)
    return points_of(known_pixels(mask, window, seen, most=most), seen)
