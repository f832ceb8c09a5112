"""Attention ray by ray and box by box in plain Python: what cones must give, too.

Written from the equations in :mod:`vfoa.cones`, without using its code, one number at a time, without numpy.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from vfoa.cones import ConesSettings
from vfoa.types import Box3D, Subject, Target

Vector = tuple[float, float, float]


def plain_attention(
    subject: Subject, targets: tuple[Target, ...], settings: ConesSettings
) -> dict[int, tuple[float, float, float]]:
    """Attention (gaze, head, total) by instance id, as :func:`vfoa.cones.pay_attention` computes it.

    Only for a subject with an eye origin, both cues, and the paper's weights.
    """
    assert subject.person.eye_origin_left is not None
    assert subject.gaze is not None
    assert subject.head_pose is not None
    assert settings.weighting == "adaptive"
    origin, gaze, head = (
        _vector(array)
        for array in (subject.person.eye_origin_left, subject.gaze.direction, subject.head_pose.direction)
    )
    agree = math.degrees(math.acos(max(-1.0, min(1.0, _dot(gaze, head))))) <= 30
    w_gaze, w_head = (0.6, 0.4) if agree else (0.9, 0.1)

    gaze_rays, head_rays = list(_rays(gaze, settings)), list(_rays(head, settings))
    attention = {}
    for target in targets:
        if target.box is not None and target.instance.id != subject.person.instance_id:
            box = _PlainBox(target.box)
            gaze_part = w_gaze * _share(origin, gaze_rays, box)
            head_part = w_head * _share(origin, head_rays, box)
            attention[target.instance.id] = (gaze_part, head_part, gaze_part + head_part)
    return attention


class _PlainBox:
    """A box as plain numbers: its centre, half sizes, axes, and extreme distances."""

    def __init__(self, box: Box3D) -> None:
        self.center = _vector(box.center_m)
        self.half = _vector(box.half_size_m)
        self.axes = [_vector(axis) for axis in box.left_from_box.T]
        self.d_max = math.sqrt(_dot(self.half, self.half))
        self.d_min = min(self.half)


def _share(origin: Vector, rays: list[Vector], box: _PlainBox) -> float:
    """Share of a cue's attention to a box, in [0, 1]."""
    total = 0.0
    for ray in rays:
        t = _entry(origin, ray, box)
        if t is not None:
            point = [o + t * d for o, d in zip(origin, ray, strict=True)]
            distance = max(math.dist(point, box.center), box.d_min)
            total += 1.5 - distance / box.d_max
    return total / (len(rays) * (1.5 - box.d_min / box.d_max))


def _rays(axis: Vector, settings: ConesSettings) -> Iterator[Vector]:
    """Every ray of a cue, cone by cone; the first ray of a cone is to the camera's right, as seen along the cue."""
    right = _unit(_cross((0.0, 1.0, 0.0), axis))
    down = _cross(axis, right)
    for fov in settings.cones_rad:
        for k in range(settings.n_rays):
            angle = 2 * math.pi * k / settings.n_rays
            a, b, c = math.sin(fov / 2) * math.cos(angle), math.sin(fov / 2) * math.sin(angle), math.cos(fov / 2)
            x, y, z = (a * r + b * d + c * f for r, d, f in zip(right, down, axis, strict=True))
            yield x, y, z
        if settings.axis_ray:
            yield axis


def _entry(origin: Vector, ray: Vector, box: _PlainBox) -> float | None:
    """Distance along a ray to its entry into a box, None for a miss."""
    offset = (origin[0] - box.center[0], origin[1] - box.center[1], origin[2] - box.center[2])
    near, far = 0.0, math.inf
    for axis, half in zip(box.axes, box.half, strict=True):
        position, speed = _dot(axis, offset), _dot(axis, ray)
        if speed == 0:
            if abs(position) > half:
                return None
            continue
        first, second = (-half - position) / speed, (half - position) / speed
        near, far = max(near, min(first, second)), min(far, max(first, second))
        if near > far:
            return None
    return near


def _vector(array: object) -> Vector:
    x, y, z = (float(number) for number in array)  # type: ignore[attr-defined]
    return x, y, z


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _unit(a: Vector) -> Vector:
    length = math.sqrt(_dot(a, a))
    return a[0] / length, a[1] / length, a[2] / length
