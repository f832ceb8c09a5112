"""Small truths for the tests: values built by hand, in the camera frame (x right, y down, z forward, metres)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from vfoa.types import Box3D, Gaze, Head, HeadPose, HeadView, Instance, Person, Subject, Target

# Attention


def make_box(center: ArrayLike, half_size: float | Sequence[float] = 0.2, rotation: ArrayLike | None = None) -> Box3D:
    """A box, a cube where ``half_size`` is one number, axis-aligned where there is no rotation."""
    return Box3D(
        center_m=np.array(center, dtype=np.float64),
        half_size_m=np.broadcast_to(np.asarray(half_size, dtype=np.float64), 3).copy(),
        left_from_box=np.eye(3) if rotation is None else np.asarray(rotation),
    )


def make_target(instance_id: int, box: Box3D | None) -> Target:
    """A thing with this box, without points."""
    instance = Instance(id=instance_id, label="thing", category_id=1, is_thing=True, score=1.0)
    return Target(instance=instance, box_px=np.zeros(4), points_left=np.zeros((0, 3), np.float32), box=box)


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
