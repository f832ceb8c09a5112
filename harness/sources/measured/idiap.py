"""Idiap's head tracker (github.com/idiap/vfoa, ``tests/test_runVfoaModule_data.csv``; read, not used).

No header; a line for each frame and person::

    time_ns,person,x,y,w,h,confidence,X,Y,Z,roll,tilt,pan[,target,probability]...

``X, Y, Z`` is the head in metres, in the axes of the robot's camera (x right, y down, z forward): the robot is at the
origin. ``roll``, ``tilt`` and ``pan`` are degrees, relative to the ray between head and camera: 0, 0 looks into the
camera. The head box in pixels is not read. The frames are the distinct times, numbered from 0.

The pairs from column 14 on are the answers of Idiap's own model, a hidden Markov model (Sheikhi and Odobez 2015), as
probabilities: of ``Robot``, ``Person 2`` and so on, and ``Unfocused``. They are no part of the clip
(:func:`answers_of_idiap`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from harness.files.digests import file_digest
from harness.files.tables import TableColumns, csv_rows
from harness.sources import Recognised, given_root
from harness.sources.measured.clip import (
    FramesOfMeasurements,
    MeasuredFrame,
    MeasuredPerson,
    MeasuredSettings,
    recognised_files,
)
from vfoa.errors import VfoaError
from vfoa.geometry import unit
from vfoa.types import Float, HeadPose

COLUMNS = ("time_ns", "person", "x", "y", "w", "h", "confidence", "X", "Y", "Z", "roll", "tilt", "pan")
_POSITION, _ANGLES = slice(7, 10), slice(11, 13)
_STAMP = re.compile(r"[0-9]{16,19}")
_DOWN = np.array([0.0, 1.0, 0.0])


class IdiapSettings(MeasuredSettings):
    """The tracker's file under the manifest's root."""

    file: str = Field(min_length=1)


class IdiapClip(FramesOfMeasurements):
    """A clip from the tracker's output."""

    Settings = IdiapSettings

    def __init__(self, settings: IdiapSettings, root: Path | None) -> None:
        path = given_root(root) / settings.file
        people: dict[int, dict[str, MeasuredPerson]] = {}
        for line, cells in csv_rows(path):
            time_ns, person = _person(f"{path}:{line}", [cell.strip() for cell in cells])
            if person.name in people.setdefault(time_ns, {}):
                raise VfoaError(f"{path}:{line}: person {person.name!r}: occurs twice at this time")
            people[time_ns][person.name] = person
        frames = {
            number: MeasuredFrame(time_ns=time_ns, people=tuple(people[time_ns].values()))
            for number, time_ns in enumerate(sorted(people))
        }
        super().__init__(frames, settings.fixed_objects(), settings, str(path), file_digest(path))

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a file of the tracker, or a folder that holds some."""
        robot = {"robot": {"center_m": [0.0, 0.0, 0.0], "size_m": [0.3, 0.3, 0.3]}}
        return tuple(
            replace(
                found,
                source={**found.source, "objects": robot},
                layout=f"{found.layout}, with the robot at the camera",
                name=found.root.name,
            )
            for found in recognised_files(path, is_tracker_output, "Idiap's head tracker")
        )


_NEAREST_M, _FARTHEST_M = 1e-6, 1e6
"""Range of distances at which a head has a direction from the camera."""


def answers_of_idiap(path: Path) -> TableColumns:
    """Read the answers of Idiap's model as columns of other systems' answers: frame, subject, target, probabilities.

    ``Person 2`` is the subject ``2``, ``Robot`` the target ``robot``, ``Unfocused`` is ``none``.

    Raises
    ------
    VfoaError
        If a line is none of the tracker, or its answers are no pairs of a name and a number.
    """
    rows = [(f"{path}:{line}", line, [cell.strip() for cell in cells]) for line, cells in csv_rows(path)]
    places = {
        time_ns: number for number, time_ns in enumerate(sorted({_person(where, cells)[0] for where, _, cells in rows}))
    }
    chances = [_chances(where, cells[len(COLUMNS) :]) for where, _, cells in rows]
    names = dict.fromkeys(name for of_row in chances for name in of_row)
    return TableColumns(
        path=path,
        lines=tuple(line for _, line, _ in rows),
        cells={
            "frame": tuple(str(places[int(cells[0])]) for *_, cells in rows),
            "subject": tuple(cells[1] for *_, cells in rows),
            "target": ("",) * len(rows),
            **{f"p_{name}": tuple(of_row.get(name, "") for of_row in chances) for name in names},
        },
    )


def _chances(where: str, cells: list[str]) -> dict[str, str]:
    """The probabilities at the end of a line, by the name that the clip has for the target."""
    if len(cells) % 2 or len({*cells[::2]}) * 2 != len(cells):
        raise VfoaError(f"{where}: found {','.join(cells)[:80]!r}; expected pairs of a name and its probability")
    return {
        _NAMES.get(name, name.removeprefix("Person ").lower()): chance
        for name, chance in zip(cells[::2], cells[1::2], strict=True)
    }


_NAMES = {"Unfocused": "none"}


def is_tracker_output(path: Path) -> bool:
    """Whether a file is one of the tracker, by its first line."""
    try:
        if not path.is_file():
            return False
        with path.open(encoding="utf-8") as file:
            cells = file.readline().rstrip("\n").split(",")
    except (OSError, UnicodeDecodeError):
        return False
    return len(cells) >= len(COLUMNS) and len(cells) % 2 == len(COLUMNS) % 2 and bool(_STAMP.fullmatch(cells[0]))


def _person(where: str, cells: list[str]) -> tuple[int, MeasuredPerson]:
    """The time and the person of one line."""
    if len(cells) < len(COLUMNS) or not _STAMP.fullmatch(cells[0]) or not cells[1]:
        raise VfoaError(f"{where}: found {','.join(cells)[:80]!r}; expected {','.join(COLUMNS)},...")
    try:
        eyes_m, (tilt, pan) = np.array(cells[_POSITION], float), np.radians(np.array(cells[_ANGLES], float))
    except ValueError as error:
        raise VfoaError(f"{where}: {error}; expected numbers in {','.join(COLUMNS)}") from None
    beside_m = math.hypot(eyes_m[0], eyes_m[2])  # straight above the camera, "to the left" is not defined for a person
    if not (beside_m > _NEAREST_M and math.hypot(*eyes_m) < _FARTHEST_M and math.isfinite(tilt) and math.isfinite(pan)):
        raise VfoaError(f"{where}: expected a finite place beside the camera, and finite angles")
    pose = HeadPose(direction=head_direction(eyes_m, tilt, pan))
    return int(cells[0]), MeasuredPerson(name=cells[1], eyes_m=eyes_m, head_pose=pose)


def head_direction(head_m: Float, tilt_rad: float, pan_rad: float) -> Float:
    """Direction of a head at (3,), a unit vector (3,): tilt > 0 up, pan > 0 to the image's left, 0 into the camera.

    The signs are those that make people look at the targets of upstream's ground truth.
    """
    forward = unit(head_m)  # from the camera to the head
    right = unit(np.cross(_DOWN, forward))
    down = np.cross(forward, right)
    aside, up = math.sin(pan_rad) * math.cos(tilt_rad), math.sin(tilt_rad)
    direction: Float = -aside * right - up * down - math.cos(pan_rad) * math.cos(tilt_rad) * forward
    return direction
