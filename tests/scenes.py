"""Small truths for the tests: values built by hand, in the camera frame (x right, y down, z forward, metres)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from vfoa.geometry import back_project, disparity_from_depth, entry_distances, of_people, stacked
from vfoa.types import (
    Box3D,
    Cues,
    Disparity,
    Float,
    Gaze,
    Head,
    HeadPose,
    HeadView,
    Instance,
    Instances,
    Map,
    Mask,
    Percepts,
    Person,
    StereoFrame,
    StereoRig,
    Subject,
    Target,
)

# Attention


def make_box(center: ArrayLike, half_size: float | Sequence[float] = 0.2, rotation: ArrayLike | None = None) -> Box3D:
    """A box: a cube if ``half_size`` is one number, axis-aligned if there is no rotation."""
    return Box3D(
        center_m=np.array(center, dtype=np.float64),
        half_size_m=np.broadcast_to(np.asarray(half_size, dtype=np.float64), 3).copy(),
        left_from_box=np.eye(3) if rotation is None else np.asarray(rotation),
    )


def make_target(instance_id: int, box: Box3D | None) -> Target:
    """A thing with this box, without points."""
    instance = Instance(id=instance_id, label="thing", category_id=1, is_thing=True, score=1.0)
    return Target(instance=instance, box_px=np.zeros(4), points_left=np.zeros((0, 3), np.float32), box=box)


def with_points(target: Target, points: ArrayLike) -> Target:
    """The target with these points (N, 3)."""
    return replace(target, points_left=np.asarray(points, dtype=np.float32))


def make_person(
    box_px: Sequence[float] = (0, 0, 10, 10),
    *,
    score: float = 1.0,
    eyes: ArrayLike | None = (0, 0, 0),
    gaze: ArrayLike | None = None,
    head: ArrayLike | None = None,
    instance_id: int | None = None,
) -> Person:
    """A person with a head box, the eye origin and the two directions. None: not measured."""
    view = HeadView(
        head=Head(box_px=np.array(box_px, dtype=np.float64), score=score),
        head_pose=None if head is None else HeadPose(direction=np.asarray(head, dtype=np.float64)),
        gaze=None if gaze is None else Gaze(direction=np.asarray(gaze, dtype=np.float64)),
    )
    origin = None if eyes is None else np.asarray(eyes, dtype=np.float64)
    return Person(view=view, instance_id=instance_id, eye_origin_left=origin)


def make_measured_person(
    instance_id: int, *, eyes: ArrayLike = (0, 0, 0), gaze: ArrayLike | None = None, head: ArrayLike | None = None
) -> Person:
    """A person who was measured without an image."""
    seen = make_person(eyes=eyes, gaze=gaze, head=head)
    return Person(
        view=Cues(head_pose=seen.view.head_pose, gaze=seen.view.gaze),
        instance_id=instance_id,
        eye_origin_left=seen.eye_origin_left,
    )


def make_subject(
    *,
    eyes: ArrayLike | None = (0, 0, 0),
    gaze: ArrayLike | None = None,
    head: ArrayLike | None = None,
    instance_id: int | None = None,
) -> Subject:
    """A subject with unfiltered cues: its own eyes, gaze and head direction."""
    person = make_person(eyes=eyes, gaze=gaze, head=head, instance_id=instance_id)
    return Subject(track_id=1, person=person, gaze=person.view.gaze, head_pose=person.view.head_pose)


def random_room(seed: int) -> tuple[Subject, tuple[Target, ...]]:
    """A subject whose gaze and head differ, among eight oriented boxes, most of them ahead. No ray grazes an edge."""
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(8, rng=rng).as_matrix()
    targets = tuple(
        make_target(number, make_box(rng.uniform((-1, -1, -0.5), (1, 1, 3)), rng.uniform(0.05, 0.5, 3), rotation))
        for number, rotation in enumerate(rotations, start=1)
    )
    gaze, head = rng.normal((0, 0, 1), 0.4, (2, 3))
    return make_subject(eyes=rng.uniform(-0.3, 0.3, 3), gaze=gaze, head=head), targets


# Stereo and reconstruction


def make_rig(
    width_px: int = 200,
    height_px: int = 120,
    *,
    fx_px: float = 160,
    cx_right_offset_px: float = 0,
    baseline_m: float = 0.1,
) -> StereoRig:
    """A rig with square pixels that looks through the middle of its image."""
    cx, cy = (width_px - 1) / 2, (height_px - 1) / 2
    return StereoRig(
        width_px=width_px,
        height_px=height_px,
        fx_px=fx_px,
        fy_px=fx_px,
        cx_px=cx,
        cy_px=cy,
        baseline_m=baseline_m,
        cx_right_px=cx + cx_right_offset_px,
    )


def square_box(center_px: tuple[float, float], side_px: float) -> Float:
    """A square box (4,) about a pixel."""
    u, v = center_px
    return np.array([u - side_px / 2, v - side_px / 2, u + side_px / 2, v + side_px / 2])


def stereo_planes(
    rig: StereoRig, *, far_px: int, near_px: int, window: tuple[slice, slice], noise: int = 0, seed: int = 0
) -> tuple[StereoFrame, Map, Mask]:
    """A wall with disparity ``far_px`` and, in a window of the left view, a plate with ``near_px``; random textures.

    Returns the pair, the true disparity, and the pixels of the left view that the right view shows as well.
    """
    rng = np.random.default_rng(seed)
    size = (rig.height_px, rig.width_px)
    wall = rng.integers(0, 256, (rig.height_px, rig.width_px + abs(far_px), 3), dtype=np.uint8)
    first = max(-far_px, 0)
    plate = rng.integers(0, 256, (*size, 3), dtype=np.uint8)
    rows, columns = window
    left, right = (wall[:, begin : begin + rig.width_px].copy() for begin in (first, first + far_px))
    left[window] = plate[window]
    seen = range(max(columns.start, near_px), columns.stop)
    right[rows, seen.start - near_px : seen.stop - near_px] = plate[rows, seen.start : seen.stop]
    disparity = np.full(size, far_px, np.float32)
    disparity[window] = near_px
    columns_right = np.arange(rig.width_px) - disparity
    visible = (columns_right >= 0) & (columns_right < rig.width_px)
    visible[rows, max(columns.start - (near_px - far_px), 0) : columns.start] = False
    if noise:
        left, right = (
            np.clip(image + rng.integers(-noise, noise + 1, image.shape), 0, 255).astype(np.uint8)
            for image in (left, right)
        )
    return StereoFrame(index=1, time_ns=0, left=left, right=right, rig=rig), disparity, visible


def rendered_boxes(rig: StereoRig, boxes: Sequence[Box3D], *, wall_m: float = 4.0, label: str = "thing") -> Percepts:
    """The output of a perfect stereo camera and a perfect segmenter for boxes before a wall: ids 1, 2, ... in order."""
    v, u = np.mgrid[: rig.height_px, : rig.width_px]
    rays = back_project(u, v, np.ones(u.shape), rig).reshape(-1, 3)
    lengths = np.linalg.norm(rays, axis=-1)
    entry = entry_distance(np.zeros(3), rays / lengths[:, None], tuple(boxes)) / lengths[:, None]
    depth = np.column_stack([np.full(len(rays), wall_m), entry])
    ids = np.nanargmin(depth, axis=1).astype(np.uint16)
    disparity = disparity_from_depth(np.nanmin(depth, axis=1), rig).astype(np.float32)
    instances = tuple(
        Instance(id=number, label=label, category_id=1, is_thing=True, score=1.0) for number in range(1, len(boxes) + 1)
    )
    size = (rig.height_px, rig.width_px)
    return Percepts(
        index=1,
        time_ns=0,
        rig=rig,
        disparity=Disparity(disparity_px=disparity.reshape(size)),
        instances=Instances(ids=ids.reshape(size), instances=instances),
        views=(),
    )


def entry_distance(origin_left: ArrayLike, directions: ArrayLike, boxes: tuple[Box3D, ...]) -> Float:
    """As :func:`vfoa.geometry.entry_distances` for one origin (3,): (R, T) of directions (R, 3) and T boxes."""
    origin, rays = np.asarray(origin_left, dtype=np.float64), np.asarray(directions, dtype=np.float64)
    return entry_distances(origin[None], rays[None], of_people([stacked(boxes)]))[0]
