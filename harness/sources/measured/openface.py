"""OpenFace 2's table of faces (``RecorderCSV.cpp`` of github.com/TadasBaltrusaitis/OpenFace; read, not used).

A line for each frame and face, frames from 1; in older versions a blank follows each comma. Columns may be left out by
OpenFace's options; those of :data:`REQUIRED` must be there::

    frame,face_id,timestamp,confidence,success                     timestamp: seconds; confidence: 0 to 1
    gaze_0_x,gaze_0_y,gaze_0_z,gaze_1_x,gaze_1_y,gaze_1_z          unit vectors; eye 0 is on the image's left
    pose_Tx,pose_Ty,pose_Tz                                        place of the head, mm
    pose_Rx,pose_Ry,pose_Rz                                        radians, R = Rx Ry Rz
    x_0..x_67,y_0..y_67                                            landmarks, px
    X_0..X_67,Y_0..Y_67,Z_0..Z_67                                  landmarks, mm

All vectors are in the camera's axes (x right, y down, z away), wherever the person stands. A face without rotation
looks along -z. Rows with ``success`` 0 or a confidence below :data:`LEAST_CONFIDENCE` hold stale values and are left
out; a gaze of 0, 0, 0 was not found. Frames are identified by number, since time stamps are wrong on films of variable
rate, and people by place, since ``face_id`` is not stable.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from harness.files.dialects import check_width
from harness.files.digests import file_digest
from harness.files.tables import header_names
from harness.sources import Recognised, given_root
from harness.sources.measured.clip import (
    FramesOfMeasurements,
    MeasuredFrame,
    MeasuredPerson,
    MeasuredSettings,
    recognised_files,
)
from vfoa.errors import VfoaError
from vfoa.types import Float, Gaze, HeadPose

LEAST_CONFIDENCE = 0.8
"""Confidence of a row below which it is left out."""

_PLACE = ("pose_Tx", "pose_Ty", "pose_Tz")
_ROTATION = ("pose_Rx", "pose_Ry", "pose_Rz")
REQUIRED = ("frame", "confidence", "success", *_PLACE, *_ROTATION)
"""Columns without which a table is not read."""

_GAZES = tuple(f"gaze_{eye}_{axis}" for eye in "01" for axis in "xyz")
_POINTS_PX = tuple(f"{axis}_{point}" for axis in "xy" for point in range(68))
_EYE_POINTS = range(36, 48)
_EYES_MM = tuple(f"{axis}_{point}" for axis in "XYZ" for point in _EYE_POINTS)

_REACH_M = 0.3
"""Greatest step of a person's eyes from one row to the next; a farther face is somebody else."""
_LONGEST_M = 1000.0
_MOST_FRAMES, _LATEST_S = 1_000_000, 1e9
_MOST_HZ = 500.0
"""Above it, time stamps are not times: versions of OpenFace wrote the number of the frame in milliseconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Face:
    """One face in one frame, camera frame, and its line in the file.

    ``eyes_m`` (3,) is the point between the eyes, or that of the head without 3D landmarks. ``head`` and ``gaze`` (3,)
    are unit directions. ``points_px`` (68, 2) are the landmarks.
    """

    line: int
    confidence: float
    eyes_m: Float
    head: Float
    gaze: Float | None
    points_px: Float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FaceTable:
    """A table: the faces that count by frame, the time stamp of each frame, s, and whether it has 3D landmarks."""

    faces: Mapping[int, tuple[Face, ...]]
    stamps_s: Mapping[int, float]
    has_eyes: bool


def is_openface(path: Path) -> bool:
    """Whether a file begins with the header of such a table.

    Raises
    ------
    VfoaError
        If it is one of single images, whose rows have no frame.
    """
    names = header_names(path)
    if {"face", *_PLACE} <= names and "frame" not in names:
        raise VfoaError(
            f"{path}:1: a table of OpenFace for one image (a column face and no column frame); expected that of a "
            "sequence: FeatureExtraction -fdir FOLDER"
        )
    return {"frame", "confidence", "success"} <= names and bool({*_PLACE, *_GAZES} & names)


def read_openface(path: Path) -> FaceTable:
    """Read a table.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line: a missing column, a cell that is no number, or a place that is not
        finite; or if no row counts.
    """
    faces: dict[int, list[Face]] = {}
    stamps_s: dict[int, float] = {}
    rows = _rows(path)
    _, header = next(rows, (1, []))
    columns = {name.strip(): place for place, name in enumerate(header)}
    if missing := [name for name in REQUIRED if name not in columns]:
        raise VfoaError(
            f"{path}:1: no column {missing[0]!r}; expected OpenFace's {', '.join(REQUIRED)} (options -pose and -gaze)"
        )
    groups = {
        names: [columns[name] for name in names]
        for names in (_PLACE, _ROTATION, _GAZES, _POINTS_PX, _EYES_MM)
        if all(name in columns for name in names)
    }
    for line, cells in rows:
        where = f"{path}:{line}"
        check_width(cells, header, where)
        try:
            frame = int(float(cells[columns["frame"]]))
            confidence, success = (float(cells[columns[name]]) for name in ("confidence", "success"))
            if "timestamp" in columns:
                stamps_s.setdefault(frame, float(cells[columns["timestamp"]]))
            numbers = {names: np.array([float(cells[place]) for place in places]) for names, places in groups.items()}
        except (ValueError, OverflowError) as error:
            raise VfoaError(f"{where}: {error}; expected a number") from None
        of_frame = faces.setdefault(frame, [])
        if success == 1 and confidence >= LEAST_CONFIDENCE:
            of_frame.append(_face(numbers, path, line, confidence))
    if not any(faces.values()):
        raise VfoaError(
            f"{path}: no row counts; expected some with success 1 and a confidence from {LEAST_CONFIDENCE} on"
        )
    return FaceTable(
        faces={frame: tuple(of_frame) for frame, of_frame in sorted(faces.items())},
        stamps_s=stamps_s,
        has_eyes=_EYES_MM in groups,
    )


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of each row; a line at a time, since an hour of two faces has a gigabyte."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            for cells in reader:
                if cells:
                    yield reader.line_num, cells
    except OSError as error:
        raise VfoaError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise VfoaError(f"{path}: not CSV in UTF-8: {error}") from None


def _face(numbers: Mapping[tuple[str, ...], Float], path: Path, line: int, confidence: float) -> Face:
    place_m, rotation = numbers[_PLACE] / 1000, numbers[_ROTATION]
    eyes_m = numbers[_EYES_MM].reshape(3, -1).mean(axis=1) / 1000 if _EYES_MM in numbers else place_m
    if not (np.isfinite(rotation).all() and math.hypot(*eyes_m) < _LONGEST_M):
        raise VfoaError(f"{path}:{line}: {', '.join(_PLACE)}: expected a place in mm, and finite angles")
    points = numbers.get(_POINTS_PX)
    return Face(
        line=line,
        confidence=confidence,
        eyes_m=eyes_m,
        head=head_direction(rotation[0], rotation[1]),
        gaze=_gaze(numbers[_GAZES].reshape(2, 3)) if _GAZES in numbers else None,
        points_px=None if points is None or not np.isfinite(points).all() else points.reshape(2, -1).T,
    )


def head_direction(rx: float, ry: float) -> Float:
    """Unit direction (3,) of a head, minus the third column of R = Rx Ry Rz; angles in radians.

    rx > 0 turns down, ry > 0 to the image's left; rz turns the head about this direction.
    """
    return np.array([-math.sin(ry), math.cos(ry) * math.sin(rx), -math.cos(ry) * math.cos(rx)])


def _gaze(of_eyes: Float) -> Float | None:
    """Mean direction (3,) of the eyes (2, 3) that have one."""
    lengths = np.linalg.norm(of_eyes, axis=1)
    seen = of_eyes[np.isfinite(lengths) & (np.abs(lengths - 1) < 0.1)]
    mean = seen.sum(axis=0)
    length = float(np.linalg.norm(mean))
    return mean / length if length > 0.1 else None


class OpenFaceSettings(MeasuredSettings):
    """The table under the manifest's root. ``rate_hz``: frames per second, in place of the time stamps."""

    file: str = Field(min_length=1)
    rate_hz: float | None = Field(default=None, gt=0)


class OpenFaceClip(FramesOfMeasurements):
    """A clip without images from OpenFace's table: ``person_1``, ``person_2`` ... from left to right."""

    Settings = OpenFaceSettings

    def __init__(self, settings: OpenFaceSettings, root: Path | None) -> None:
        path = given_root(root) / settings.file
        table = read_openface(path)
        people = _named(table.faces)
        frames = {
            number: MeasuredFrame(time_ns=time_ns, people=tuple(people.get(number, ())))
            for number, time_ns in _times_ns(table, settings.rate_hz, path).items()
        }
        super().__init__(frames, settings.fixed_objects(), settings, str(path), file_digest(path))
        if not table.has_eyes:
            self.notes = (
                f"{path.name} has no columns X_36 to Z_47 (OpenFace's -3Dfp): eyes are where it says the head is, some "
                "cm below them.",
            )

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a table, or a folder that holds some."""
        return recognised_files(path, is_openface, "faces of OpenFace")


def _times_ns(table: FaceTable, rate_hz: float | None, path: Path) -> dict[int, int]:
    """Time of every frame from the first to the last row, ns: a frame without a face may have no row."""
    numbers = range(min(table.faces), max(table.faces) + 1)
    if numbers[-1] - numbers[0] >= _MOST_FRAMES:
        raise VfoaError(
            f"{path}: frame: found {numbers[0]} to {numbers[-1]}; expected at most {_MOST_FRAMES:,} frames in between"
        )
    if rate_hz is not None:
        return {number: round((number - numbers[0]) / rate_hz * 1e9) for number in numbers}
    stamped = sorted(table.stamps_s)
    stamps_s = np.array([table.stamps_s[number] for number in stamped])
    is_ascending = len(stamped) > 0 and (np.diff(stamps_s) > 0).all() and (np.abs(stamps_s) < _LATEST_S).all()
    if not is_ascending:
        raise VfoaError(f"{path}: timestamp: does not ascend with the frames; expected rate_hz in [source]")
    if len(stamped) > 1 and (found_hz := float(np.median(np.diff(stamped) / np.diff(stamps_s)))) > _MOST_HZ:
        raise VfoaError(f"{path}: timestamp: found {found_hz:.0f} frames per second; expected rate_hz in [source]")
    times_s = np.interp(np.array(numbers), stamped, stamps_s)
    return {number: round(time_s * 1e9) for number, time_s in zip(numbers, times_s.tolist(), strict=True)}


def _named(faces: Mapping[int, Sequence[Face]]) -> dict[int, list[MeasuredPerson]]:
    """The people of each frame. A face is the person whose eyes were nearest to it when last seen.

    Where no frame has more than one face, all are of one person.
    """
    reach_m = math.inf if max(map(len, faces.values())) == 1 else _REACH_M
    last_m: list[Float] = []
    named: dict[int, list[MeasuredPerson]] = {}
    for number, of_frame in faces.items():
        of_frame = sorted(of_frame, key=lambda face: face.eyes_m[0] / max(face.eyes_m[2], 1e-9))
        numbers = _followed([face.eyes_m for face in of_frame], last_m, reach_m)
        for person, face in zip(numbers, of_frame, strict=True):
            last_m[person : person + 1] = [face.eyes_m]
            named.setdefault(number, []).append(_person(f"person_{person + 1}", face))
    return named


def _followed(eyes_m: Sequence[Float], last_m: Sequence[Float], reach_m: float) -> list[int]:
    """The number of the person of each face, new ones from ``len(last_m)`` on: the least sum of steps within reach."""
    from scipy.optimize import linear_sum_assignment  # not above: every adapter is imported to recognise a path

    people: dict[int, int] = {}
    if eyes_m and last_m:
        steps_m = np.linalg.norm(np.array(eyes_m)[:, None] - np.array(last_m)[None], axis=2)
        rows, columns = linear_sum_assignment(np.minimum(steps_m, reach_m))
        pairs = zip(rows.tolist(), columns.tolist(), strict=True)
        people = {row: column for row, column in pairs if steps_m[row, column] < reach_m}
    new = iter(range(len(last_m), len(last_m) + len(eyes_m)))
    return [people[row] if row in people else next(new) for row in range(len(eyes_m))]


def _person(name: str, face: Face) -> MeasuredPerson:
    return MeasuredPerson(
        name=name,
        eyes_m=face.eyes_m,
        head_pose=HeadPose(direction=face.head),
        gaze=None if face.gaze is None else Gaze(direction=face.gaze),
    )
