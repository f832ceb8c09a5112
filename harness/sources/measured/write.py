"""Write measurements as the pair of tables that :mod:`harness.sources.measured.tables` reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from harness.files.tables import write_rows
from harness.sources.measured.clip import MeasuredFrame, MeasuredObject
from harness.sources.measured.tables import POSITION, QUATERNION, SIZE
from vfoa.types import Float, Gaze, HeadPose

_CUE = ("head_x", "head_y", "head_z", "head_sigma_rad", "gaze_x", "gaze_y", "gaze_z", "gaze_sigma_rad")
_PEOPLE = ("frame", "time_ns", "person", *POSITION, *_CUE)
_OBJECTS = ("frame", "object", "category", *POSITION, *SIZE, *QUATERNION)

Cells = list[object]


def write_measured(folder: Path, frames: Mapping[int, MeasuredFrame]) -> None:
    """Write ``people.csv`` and ``objects.csv``. Reading them gives the same bits, except for rotated boxes.

    A true gaze is written in place of a measured one: it is read with ``gaze = "truth"``.
    """
    numbered = sorted(frames.items())
    write_rows(folder / "people.csv", _PEOPLE, [row for each in numbered for row in _people(*each)])
    write_rows(
        folder / "objects.csv",
        _OBJECTS,
        [_object(number, each) for number, frame in numbered for each in frame.objects],
    )


def _people(number: int, frame: MeasuredFrame) -> Iterator[Cells]:
    for person in frame.people:
        yield [
            *(number, frame.time_ns, person.name, *_vector(person.eyes_m)),
            *(*_direction(person.head_pose), *_direction(person.gaze, person.true_gaze)),
        ]
    if not frame.people:
        yield [number, frame.time_ns, *[None] * (len(_PEOPLE) - 2)]


def _direction(cue: HeadPose | Gaze | None, truth: Float | None = None) -> Cells:
    return [*_vector(truth), None] if cue is None else [*_vector(cue.direction), cue.sigma_rad]


def _object(number: int, each: MeasuredObject) -> Cells:
    box = each.box
    if box is None:
        return [number, each.name, each.category, *[None] * 10]
    quaternion: Cells = [None] * 4
    if not np.array_equal(box.left_from_box, np.eye(3)):
        from scipy.spatial.transform import Rotation  # not above: see tables.py

        quaternion = Rotation.from_matrix(box.left_from_box).as_quat().tolist()
    return [number, each.name, each.category, *_vector(box.center_m), *_vector(2 * box.half_size_m), *quaternion]


def _vector(vector: Float | None) -> Cells:
    return [None] * 3 if vector is None else list(vector.tolist())
