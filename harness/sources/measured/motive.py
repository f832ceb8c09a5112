"""Motive's CSV of a take of OptiTrack: rigid bodies, and bones of skeletons (docs.optitrack.com, Data Export: CSV).

A line of names and values in turn, an empty one, lines that say what each column is, and a line for each frame::

    Format Version,1.23,...,Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global

    ,Type,Rigid Body,Rigid Body,...                             and other kinds: markers are not read
    ,Name,anna,anna,...
    ,ID,...                                                     in newer versions, ,Parent,... below it
    ,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,...
    Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,...
    0,0.000000,-0.008570,-0.649345,-0.001615,-0.760444,3.717927,0.045963,-2.209530,0.000727,...

The unit quaternion x, y, z, w turns the body's own axes into those of the room, which are right-handed with y up; here
they are turned about x so that y is down. The position is that of the body's pivot. A lost body has
blank cells.
Where the eyes and the face are in a body's axes is not in the file: it follows from how the body was made.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator

from harness.files.dialects import check_width
from harness.files.digests import file_digest
from harness.files.safe_names import check_name
from harness.files.tables import csv_rows, header_names
from harness.sources import Recognised
from harness.sources.measured.clip import (
    Extents,
    FramesOfMeasurements,
    MeasuredFrame,
    MeasuredObject,
    MeasuredPerson,
    MeasuredSettings,
    Metres,
)
from vfoa.errors import VfoaError, did_you_mean, listed, reported_as
from vfoa.settings import Settings
from vfoa.types import Float, HeadPose

_FIRST = "Format Version"
_UNITS_M = {"Meters": 1.0, "Centimeters": 0.01, "Millimeters": 0.001}
_OTHERS = {"Rotation Type": "Quaternion", "Coordinate Space": "Global"}
_POSE = (*(("Rotation", axis) for axis in "XYZW"), *(("Position", axis) for axis in "XYZ"))
_BODY, _BONE = "Rigid Body", "Bone"
_UNIT_TOLERANCE = 0.01
_LEFT_FROM_ROOM = {
    "y": np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
}
"""The rotation into axes whose y is down, by the axis of the room that is up."""


class WornBody(Settings):
    """A rigid body or a bone that moves with somebody's head.

    ``body`` is its name in Motive; without it, it has the person's. In its own axes, ``forward`` is where the face
    points, and ``eyes_m`` the point between the eyes, from the pivot.
    """

    body: str | None = None
    forward: Metres = (0.0, 0.0, 1.0)
    eyes_m: Metres = (0.0, 0.0, 0.0)

    @field_validator("forward")
    @classmethod
    def _check_forward(cls, forward: Metres) -> Metres:
        if not any(forward):
            raise ValueError(f"found {[*forward]}; expected a direction")
        return forward


class MotiveSettings(MeasuredSettings):
    """The file under the manifest's root, and who wears which body; all other rigid bodies are objects.

    ``sizes_m`` are the extents of objects along their own axes, about their pivots. ``up`` is the axis that points up,
    as chosen in the export. ``every`` takes each n-th frame of the file: cameras are faster than looks.
    """

    file: str = Field(min_length=1)
    heads: dict[str, WornBody] = Field(default_factory=dict)
    sizes_m: dict[str, Extents] = Field(default_factory=dict)
    up: Literal["y", "z"] = "y"
    every: int = Field(default=1, ge=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Take:
    """A file's frames: numbers (N,), times (N,) s, and by name the pose of each body (N, 7), NaN where it was lost.

    A pose is the quaternion x, y, z, w and the position, m, in the axes of the room. ``bones`` are names of ``poses``.
    """

    numbers: tuple[int, ...]
    times_s: Float
    poses: Mapping[str, Float]
    bones: frozenset[str]


class MotiveClip(FramesOfMeasurements):
    """A clip without images from a take: people whose heads wear a rigid body, and the other rigid bodies."""

    Settings = MotiveSettings

    def __init__(self, settings: MotiveSettings, root: Path | None) -> None:
        path = (root if root is not None else Path.cwd()) / settings.file
        take = read_take(path, settings.every)
        bodies = _worn(settings, take, path)
        people = {name: _people(name, settings, take.poses[body]) for name, body in bodies.items()}
        others = [name for name in take.poses if name not in {*bodies.values(), *take.bones}]
        _check_known(settings.sizes_m, others, f"{path}: sizes_m")
        objects = [_objects(name, settings, take.poses[name]) for name in others]
        frames = {
            number: MeasuredFrame(
                time_ns=round(1e9 * time_s),
                people=tuple(each[place] for each in people.values()),
                objects=tuple(each[place] for each in objects),
            )
            for place, (number, time_s) in enumerate(zip(take.numbers, take.times_s.tolist(), strict=True))
        }
        super().__init__(frames, settings.fixed_objects(), settings, str(path), file_digest(path))
        self.notes = tuple(_notes(settings, take, {**bodies, **{name: name for name in others}}))

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a file, or a folder that holds some."""
        files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
        return tuple(
            Recognised(
                root=file.parent,
                source={"file": file.name},
                layout=f"a take of Motive in {file.name}",
                name=file.stem,
                calibration="not needed",
            )
            for file in files
            if _FIRST in header_names(file)
        )


def read_take(path: Path, every: int = 1) -> Take:
    """Read each n-th frame of a file.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line: settings of the export that cannot be read, no rigid body, a cell
        that is no number, or a quaternion that is not of length 1.
    """
    rows = csv_rows(path)
    unit_m = _unit_m(next(rows, (1, []))[1], path)
    header, columns, bones = _columns(rows, path)
    needed = sorted(itertools.chain.from_iterable(columns.values()))
    lines, numbers, times_s, values = [], [], [], []
    for line, cells in itertools.islice(rows, 0, None, every):
        check_width(cells, header, f"{path}:{line}")
        try:
            numbers.append(int(cells[0]))
            times_s.append(float(cells[1]))
            values.append([float(cells[place] or "nan") for place in needed])
        except ValueError as error:
            raise VfoaError(f"{path}:{line}: {error}; expected a number") from None
        lines.append(line)
    table = np.array(values, dtype=np.float64).reshape(len(lines), len(needed))
    table[np.isinf(table)] = np.nan
    of = {column: place for place, column in enumerate(needed)}
    poses = {name: table[:, [of[column] for column in places]] for name, places in columns.items()}
    for name, pose in poses.items():
        pose[np.isnan(pose).any(axis=1)] = np.nan
        lengths = np.linalg.norm(pose[:, :4], axis=1)
        for row in np.flatnonzero(np.abs(lengths - 1) > _UNIT_TOLERANCE)[:1]:
            found = f"found a quaternion of length {lengths[row]:.3g}"
            raise VfoaError(f"{path}:{lines[row]}: {name}: {found}; expected 1")
        pose[:, 4:] *= unit_m
    return Take(numbers=tuple(numbers), times_s=np.array(times_s), poses=poses, bones=bones)


def _unit_m(first: Sequence[str], path: Path) -> float:
    """The unit of length, m, from the first line, which also says how rotations are written."""
    said = dict(zip(first[::2], first[1::2], strict=False))
    if _FIRST not in said:
        raise VfoaError(f"{path}:1: no {_FIRST!r}; expected a CSV of Motive with its header")
    for name, expected in _OTHERS.items():
        if (found := said.get(name, expected)) != expected:
            raise VfoaError(f"{path}:1: {name}: found {found!r}; expected {expected}: choose it in Motive's CSV export")
    if (unit := said.get("Length Units", "")) not in _UNITS_M:
        raise VfoaError(f"{path}:1: Length Units: {did_you_mean(unit, _UNITS_M)}")
    return _UNITS_M[unit]


def _columns(
    rows: Iterator[tuple[int, list[str]]], path: Path
) -> tuple[list[str], dict[str, list[int]], frozenset[str]]:
    """The line above the frames, the places of the pose of each body in a row, and the names of bones."""
    above: list[list[str]] = []
    for _, cells in rows:
        if cells[0] == "Frame":
            break
        if any(cells):
            above.append(cells)
    else:
        raise VfoaError(f"{path}: no line that begins with Frame; expected a CSV of Motive with its header")
    if len(above) < 3 or any(len(line) != len(cells) for line in above):
        raise VfoaError(f"{path}: the lines above the frames are not those of Motive: Type, Name, ID, and what it is")
    kinds, names, quantities = above[0], above[1], above[-1]
    found: dict[str, dict[tuple[str, str], int]] = {}
    bones = set()
    for place, (kind, name, *what) in enumerate(zip(kinds, names, quantities, cells, strict=True)):
        if kind not in (_BODY, _BONE) or (quantity := (what[0], what[1])) not in _POSE:
            continue
        with reported_as(f"{path}: Name"):
            check_name(name)
        if quantity in found.setdefault(name, {}):
            raise VfoaError(f"{path}: two bodies have the name {name!r}; expected one: rename one in Motive")
        found[name][quantity] = place
        if kind == _BONE:
            bones.add(name)
    whole = {name: [places[each] for each in _POSE] for name, places in found.items() if len(places) == len(_POSE)}
    if not whole:
        raise VfoaError(f"{path}: no rigid body; expected Rigid Body Bones, chosen in Motive's CSV export")
    return cells, whole, frozenset(bones & whole.keys())


def _worn(settings: MotiveSettings, take: Take, path: Path) -> dict[str, str]:
    """The body that each person wears, by the person's name."""
    if not settings.heads:
        raise VfoaError(
            f"{path}: heads: found none; expected who wears which rigid body on the head, of: {listed([*take.poses])}; "
            "say --set 'heads={anna={body=\"NAME\"}}'"
        )
    bodies = {name: head.body or name for name, head in settings.heads.items()}
    _check_known(bodies.values(), take.poses, f"{path}: heads")
    return bodies


def _check_known(names: Iterable[str], known: Collection[str], where: str) -> None:
    for name in names:
        if name not in known:
            raise VfoaError(f"{where}: no rigid body {name!r}; {did_you_mean(name, known)}")


def _people(name: str, settings: MotiveSettings, pose: Float) -> list[MeasuredPerson]:
    """A person in each frame."""
    head, (rotations, places) = settings.heads[name], _in_camera_axes(pose, settings.up)
    forward = rotations @ (np.array(head.forward) / np.linalg.norm(head.forward))
    eyes_m = places + rotations @ np.array(head.eyes_m)
    return [
        MeasuredPerson(name=name, eyes_m=eye, head_pose=HeadPose(direction=direction))
        if np.isfinite(eye).all()
        else MeasuredPerson(name=name, eyes_m=None)
        for eye, direction in zip(eyes_m, forward, strict=True)
    ]


def _objects(name: str, settings: MotiveSettings, pose: Float) -> list[MeasuredObject]:
    """An object in each frame."""
    size_m = settings.sizes_m.get(name)
    rotations, places = _in_camera_axes(pose, settings.up)
    return [
        MeasuredObject(
            name=name,
            category=name,
            box=None if np.isnan(place).any() else settings.box(place, size_m, None if size_m is None else rotation),
        )
        for place, rotation in zip(places, rotations, strict=True)
    ]


def _in_camera_axes(pose: Float, up: Literal["y", "z"]) -> tuple[Float, Float]:
    """Rotations (N, 3, 3) from a body's axes, and places (N, 3), in axes whose y is down; NaN where it was lost."""
    from scipy.spatial.transform import Rotation  # not above: every adapter is imported to recognise a path

    is_known = ~np.isnan(pose).any(axis=1)
    rotations = np.full((len(pose), 3, 3), np.nan)
    if is_known.any():
        rotations[is_known] = _LEFT_FROM_ROOM[up] @ Rotation.from_quat(pose[is_known, :4]).as_matrix()
    return rotations, pose[:, 4:] @ _LEFT_FROM_ROOM[up].T


def _notes(settings: MotiveSettings, take: Take, bodies: Mapping[str, str]) -> Iterator[str]:
    for name, body in bodies.items():
        if lost := int(np.isnan(take.poses[body]).any(axis=1).sum()):
            yield f"{name}: not tracked in {lost} of {len(take.numbers)} frames"
    if unsaid := [name for name, head in settings.heads.items() if not any(head.eyes_m)]:
        yield (
            f"the eyes of {listed(unsaid)} are taken to be at the pivot of the rigid body, which is in the middle of "
            "its markers if it was not moved: say heads.NAME.eyes_m in [source]"
        )
