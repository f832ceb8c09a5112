"""People and objects that something else measured, without images: as people and targets of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vfoa.types import Box3D, Cues, Float, Gaze, HeadPose, Instance, Person, Target

PERSON = "person"
"""The category of people."""
POINT_SIZE_M = 0.1
"""Side of the cube that stands for an object of which only the middle is known."""
HEAD_SIZE_M = (0.18, 0.25, 0.2)
"""Extent along the camera's axes of the box around an adult's head."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Observed:
    """A person in one frame: the point between the eyes (3,), and directions (3,) of any length. None: not measured.

    ``gaze_error_rad`` and ``head_error_rad`` are the angular errors that the device claims; the posterior and the logit
    use them, cones do not.
    """

    eyes_m: ArrayLike | None
    gaze: ArrayLike | None = None
    head: ArrayLike | None = None
    gaze_error_rad: float | None = None
    head_error_rad: float | None = None

    def person(self, number: int) -> Person:
        """The person under this number.

        Raises
        ------
        ValueError
            If the eyes are not a finite point (3,), a direction is zero or not finite (3,), or an error is above pi.
        """
        for name in ("gaze_error_rad", "head_error_rad"):
            if (error_rad := getattr(self, name)) is not None and error_rad > math.pi:
                raise ValueError(f"{name}: expected radians, at most pi, found {error_rad}; math.radians(degrees)")
        gaze = None if self.gaze is None else Gaze(direction=np.asarray(self.gaze), sigma_rad=self.gaze_error_rad)
        head = None if self.head is None else HeadPose(direction=np.asarray(self.head), sigma_rad=self.head_error_rad)
        eyes_m = None if self.eyes_m is None else np.array(self.eyes_m, dtype=np.float64)
        return Person(view=Cues(head_pose=head, gaze=gaze), instance_id=number, eye_origin_left=eyes_m)


def box_of(center_m: ArrayLike, size_m: ArrayLike, left_from_box: Float | None = None) -> Box3D:
    """The box with this middle (3,), these extents (3,) and this rotation (3, 3), along the camera's axes without one.

    Raises
    ------
    ValueError
        If an extent is not positive, or the middle is not finite.
    """
    rotation = np.eye(3) if left_from_box is None else left_from_box
    return Box3D(center_m=np.array(center_m), half_size_m=np.array(size_m) / 2, left_from_box=rotation)


def target_of(number: int, category: str, category_id: int, box: Box3D | None, name: str | None = None) -> Target:
    """The target under this number that was measured without an image: it has a box, and neither mask nor cloud.

    ``name`` is the source's own name of it.
    """
    instance = Instance(id=number, label=category, category_id=category_id, is_thing=True, score=1.0, name=name)
    return Target(instance=instance, box_px=None, points_left=np.zeros((0, 3), np.float32), box=box)


def box_around(given: ArrayLike | Box3D) -> Box3D:
    """The box itself, or that of a middle with extents (2, 3), or of a point (3,): a cube of :data:`POINT_SIZE_M`.

    Raises
    ------
    ValueError
        If it has another shape, an extent is not positive, or the middle is not finite.
    """
    if isinstance(given, Box3D):
        return given
    numbers = np.array(given, dtype=np.float64)
    if numbers.shape == (3,):
        return box_of(numbers, np.full(3, POINT_SIZE_M))
    if numbers.shape == (2, 3):
        return box_of(numbers[0], numbers[1])
    raise ValueError(f"expected a point (3,), or a middle and extents (2, 3), found the shape {numbers.shape}")
