"""From percepts to a scene in metres: a cloud and a box for every instance, an eye origin for every head.

A cloud is cleaned in three steps, each against one fault of stereo:

erode    the outermost pixels of a mask, where the matcher mixes the object with its background;
gate     points far from the median depth: background that the mask includes;
outlier  points farther from their neighbours than is usual in this cloud: single mismatches, and pixels between two
         objects.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from itertools import permutations
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from vfoa.crops import whole_head
from vfoa.geometry import back_project, left_from_crop, length_of, turn_about_z, unit
from vfoa.pixels import ViewMaps, Window, known_pixels, points_of, window_of
from vfoa.settings import Settings
from vfoa.types import (
    Box3D,
    Disparity,
    Float,
    Head,
    HeadView,
    Instance,
    Instances,
    Mask,
    Percepts,
    Person,
    Scene,
    StereoRig,
    Target,
)

MIN_HALF_SIZE_M = 0.001
"""Half the thickness given to a flat cloud, so that its box has a volume."""

EYE_HEIGHT = 0.35
"""Height of the patch in a head's box, from its top (the paper's 65 % counts from the bottom)."""

EYE_PATCH = 0.2
"""Side of the patch, in widths of the head's box (the paper's value)."""

_RESOLVED = 1e-7
"""Relative to the distance: rounding errors of hulls are smaller, even for points 1e11 m away (Sintel's sky)."""


class ReconstructionSettings(Settings):
    """Settings of :func:`reconstruct`."""

    stuff: tuple[str, ...] = ()
    """Labels of the stuff that is a target. Things are always targets."""
    person: tuple[str, ...] = ("person",)
    """Labels of the instances that are people."""
    boxes: Literal["aabb", "oriented"] = "aabb"
    """``aabb``: boxes along the camera's axes (the paper); ``oriented``: the smallest in any orientation."""
    erode_px: int = Field(default=1, ge=0, le=20)
    """Width of the rim of each mask that is left out: the matcher mixes objects with their background there."""
    gate_mads: float = Field(default=8, gt=0)
    """Points farther from the median depth, in median absolute deviations, are left out."""
    outlier_neighbours: int = Field(default=4, ge=1)
    """Number of nearest neighbours whose distance decides whether a point is an outlier."""
    outlier_ratio: float = Field(default=5, ge=1)
    """An outlier is this many times as far from its neighbours as is usual in its cloud."""
    min_points: int = Field(default=20, ge=1)
    """Least points of a cloud that gets a 3D box."""
    max_points: int = Field(default=1000, ge=100)
    """Most points of a cloud; a larger one is thinned out."""
    eyes: Literal["head", "patch"] = "head"
    """Eye origin from the ``head``'s direction, or from the paper's ``patch`` of the head's box."""
    min_eye_points: int = Field(default=9, ge=1)
    """Least points of a head with an eye origin."""
    max_eye_points: int | None = Field(default=None, ge=1)
    """Most points that an eye origin is computed from; more are thinned out. Not set: all of the head's."""

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        if self.min_points > self.max_points:
            raise ValueError(f"min_points: expected at most max_points = {self.max_points}, found {self.min_points}")
        if self.max_eye_points is not None and self.min_eye_points > self.max_eye_points:
            most = self.max_eye_points
            raise ValueError(f"min_eye_points: expected at most max_eye_points = {most}, found {self.min_eye_points}")
        return self


def reconstruct(percepts: Percepts, settings: ReconstructionSettings) -> Scene:
    """Return the scene of one frame: its instances and heads in the camera frame, metres."""
    targets = place_targets(percepts.disparity, percepts.instances, percepts.rig, settings)
    return place_people(percepts, targets, settings)


# Targets


def place_targets(
    disparity: Disparity, instances: Instances, rig: StereoRig, settings: ReconstructionSettings
) -> tuple[Target, ...]:
    """Return one target for each wanted instance that has pixels, in the order of the instances.

    This half of :func:`reconstruct` depends on no head. Configurations that agree on its inputs can share it.
    """
    from scipy.ndimage import find_objects

    seen = ViewMaps(disparity=disparity, instances=instances, rig=rig)
    windows = find_objects(instances.ids)
    targets = []
    for instance in instances.instances:
        window = windows[instance.id - 1] if instance.id <= len(windows) else None
        if window is not None and (instance.is_thing or instance.label in settings.stuff):
            targets.append(_target(instance, (window[0], window[1]), seen, settings))
    return tuple(targets)


def _target(instance: Instance, window: Window, seen: ViewMaps, settings: ReconstructionSettings) -> Target:
    rows, columns = window
    mask = np.equal(seen.instances.ids[window], instance.id)
    pixels = known_pixels(_eroded(mask, settings.erode_px), window, seen, most=settings.max_points)
    points = points_of(pixels, seen)
    points = _without_outliers(_gated(points, settings, seen.rig, max(mask.shape)), settings)
    return Target(
        instance=instance,
        box_px=np.array([columns.start, rows.start, columns.stop, rows.stop]) - 0.5,
        points_left=points.astype(np.float32),
        box=_box(points, settings),
    )


def _eroded(mask: Mask, radius_px: int) -> Mask:
    """Remove the border of a mask; a mask that would lose more than half of its pixels is kept whole."""
    import cv2

    if radius_px == 0:
        return mask
    square = np.ones((2 * radius_px + 1, 2 * radius_px + 1), np.uint8)
    inner = cv2.erode(mask.view(np.uint8), square, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    return inner if 2 * inner.sum() >= mask.sum() else mask


def _gated(points: Float, settings: ReconstructionSettings, rig: StereoRig, extent_px: int) -> Float:
    """Keep the points near the median depth.

    ``extent_px`` is the greater side of the mask: the visible face may be flat, with a deviation of zero, although the
    object is as deep as it is wide.
    """
    if len(points) == 0:
        return points
    depth = points[:, 2]
    median = np.median(depth)
    deviation = np.abs(depth - median)
    gate = max(settings.gate_mads * np.median(deviation), extent_px * median / min(rig.fx_px, rig.fy_px))
    return points[deviation <= gate]


def _without_outliers(points: Float, settings: ReconstructionSettings) -> Float:
    """Remove the points far from their nearest neighbours, relative to the median of the cloud.

    Distances are between (x / z, y / z, ln z): in these coordinates the camera samples a surface evenly at any depth.
    """
    from scipy.spatial import KDTree

    neighbours = settings.outlier_neighbours
    if len(points) <= neighbours:
        return points
    even = np.column_stack([points[:, :2] / points[:, 2:], np.log(points[:, 2])])
    distance = np.mean(KDTree(even).query(even, k=neighbours + 1)[0], axis=1)
    return points[distance <= settings.outlier_ratio * np.median(distance)]


def _box(points: Float, settings: ReconstructionSettings) -> Box3D | None:
    if len(points) < settings.min_points:
        return None
    return axis_aligned_box(points) if settings.boxes == "aabb" else oriented_box(points)


# People


def place_people(percepts: Percepts, targets: tuple[Target, ...], settings: ReconstructionSettings) -> Scene:
    """Return the scene of these targets and of all people with a head: the other half of :func:`reconstruct`."""
    seen = ViewMaps(disparity=percepts.disparity, instances=percepts.instances, rig=percepts.rig)
    return Scene(
        index=percepts.index,
        time_ns=percepts.time_ns,
        targets=targets,
        people=tuple(_person(view, seen, settings) for view in percepts.views),
        masks_from=percepts.instances.carried_from,
        masks_age_s=percepts.instances.carried_s,
    )


def _person(view: HeadView, seen: ViewMaps, settings: ReconstructionSettings) -> Person:
    instance_id = view.head.instance_id
    if instance_id is None:
        instance_id = covering_person(view.head, seen.instances, seen.rig, settings.person)
    origin = eye_origin(view, instance_id, seen, settings)
    return Person(view=view, instance_id=instance_id, eye_origin_left=origin)


def covering_person(head: Head, instances: Instances, rig: StereoRig, labels: Collection[str]) -> int | None:
    """Return the person whose mask covers most of the head's box; the first of equals; None if none overlaps it.

    ``labels`` are those of people.
    """
    u0, v0, u1, v1 = head.box_px
    window = window_of(u0, v0, u1, v1, rig)
    covered = np.bincount(instances.ids[window].ravel(), minlength=2**16)
    people = [it.id for it in instances.instances if it.label in labels and covered[it.id] > 0]
    return max(people, key=lambda it: covered[it], default=None)


# The eye origin: the point between the eyes where gaze begins, from a head's box, its depths and its direction
#
# head   The head is an ellipsoid that touches the planes through the camera and the sides of its box, and is as long as
#        the mean of its breadth and its height. Each pixel gives an estimate of the distance of its middle; the median
#        is used. The eyes are where the head's direction leaves the ball of that mean radius about the middle. The
#        box of a head that the image's border cuts goes on beyond it (vfoa.crops.whole_head).
# patch  The paper's (Simões and Moreno 2022): the median of the points of a square patch, centred in the box, at 35 %
#        of its height from the top. It is right for a head turned to the camera. For one turned by 40 degrees, or bent
#        over a table, the patch lies on the temple or the hair, and the cone's apex is off by up to 7 cm.
#
# A head without a direction, or with too few points, uses the patch; with too few points in it, a patch twice as wide;
# then the median of the person's points in the box.


def eye_origin(
    view: HeadView, instance_id: int | None, seen: ViewMaps, settings: ReconstructionSettings
) -> Float | None:
    """Return the point (3,) between a head's eyes, metres, camera frame; None where too few points are known.

    ``instance_id`` is the person's: pixels of other instances do not count. None: the person is not known, all count.
    """
    if settings.eyes == "head" and view.head_pose is not None:
        ball = _ball(view.head, instance_id, seen, settings)
        if ball is not None:
            center, radius = ball
            return center + radius * view.head_pose.direction
    return _patch(view.head, instance_id, seen, settings)


def _ball(
    head: Head, instance_id: int | None, seen: ViewMaps, settings: ReconstructionSettings
) -> tuple[Float, float] | None:
    """Middle (3,) and radius of the ball in a head's box, metres; None if too few points are known."""
    u0, v0, u1, v1 = whole_head(head, seen.instances.ids)
    (left, top, _), (right, bottom, _) = back_project([u0, u1], [v0, v1], 1, seen.rig)
    (x, half_x), (y, half_y) = _tangent_circle(left, right), _tangent_circle(top, bottom)
    towards = np.array([x, y, 1])
    half = np.array([half_x, half_y]) / length_of(towards)
    radius = float(half.mean())
    points = _points_in((u0, v0, u1, v1), instance_id, seen, settings.max_eye_points) @ left_from_crop(towards)
    aside = ((points[:, :2] / points[:, 2:] / half) ** 2).sum(axis=1)
    # a ray (slopes, 1) enters the ellipsoid about (0, 0, 1) at the smaller root of a quadratic equation in its z
    square = 1 - aside * (1 - radius**2)
    inside = square >= 0
    if np.count_nonzero(inside) < settings.min_eye_points:
        return None
    entry = (1 - radius * np.sqrt(square[inside])) / (1 + radius**2 * aside[inside])
    distance = float(np.median(points[inside, 2] / entry))
    return distance * unit(towards), distance * radius


def _tangent_circle(low: float, high: float) -> tuple[float, float]:
    """Offset and radius, in units of its depth, of a circle that touches the lines x = low z and x = high z."""
    first, last = math.atan(low), math.atan(high)
    middle = (first + last) / 2
    return math.tan(middle), math.sin(last - middle) / math.cos(middle)


def _patch(head: Head, instance_id: int | None, seen: ViewMaps, settings: ReconstructionSettings) -> Float | None:
    """Median (3,) of the points of the patch, else of a patch twice as wide, else of the person in the head's box."""
    u0, v0, u1, v1 = head.box_px
    center_u, center_v, side = (u0 + u1) / 2, v0 + EYE_HEIGHT * (v1 - v0), EYE_PATCH * (u1 - u0)
    patches = [(center_u - half, center_v - half, center_u + half, center_v + half) for half in (side / 2, side)]
    regions = patches if instance_id is None else [*patches, (u0, v0, u1, v1)]
    for region in regions:
        points = _points_in(region, instance_id, seen, settings.max_eye_points)
        if len(points) >= settings.min_eye_points:
            return np.median(points, axis=0)
    return None


def _points_in(
    region: tuple[float, float, float, float], instance_id: int | None, seen: ViewMaps, most: int | None
) -> Float:
    """``most`` or fewer points (N, 3) of the person's pixels in a region; of all pixels if the person is not known."""
    window = window_of(*region, seen.rig)
    ids = seen.instances.ids[window]
    mask = np.full(ids.shape, True) if instance_id is None else np.equal(ids, instance_id)
    return points_of(known_pixels(mask, window, seen, most=most), seen)


# Boxes


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
