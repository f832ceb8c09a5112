"""Motive's CSV of a take of OptiTrack: rigid bodies, and bones of skeletons (docs.optitrack.com, Data Export: CSV).

A line of names and values in turn, an empty one, lines that say what each column is, and a line for each frame::

    Format Version,1.23,...,Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global

    ,Type,Rigid Body,Rigid Body,...                             and other kinds: markers are not read
    ,Name,anna,anna,...
    ,ID,...                                                     in newer versions, ,Parent,... below it
    ,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error,...
    Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,...
    0,0.000000,-0.008570,-0.649345,-0.001615,-0.760444,3.717927,0.045963,-2.209530,0.000727,...

The unit quaternion x, y, z, w turns the body's own axes into those of the room, which are right-handed with y up if the
export was not set otherwise. The position is that of the body's pivot. A lost body has blank cells.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.files.tables import csv_rows, header_names
from harness.sources import Recognised
from harness.sources.measured.clip import recognised_files
from harness.sources.measured.motion_capture import (
    MotionCaptureClip,
    MotionCaptureSettings,
    Take,
    Up,
    check_body,
    frame_numbers,
    nanoseconds,
    poses_of,
    read_cells,
)
from vfoa.errors import VfoaError, did_you_mean

_FIRST = "Format Version"
_UNITS_M = {"Meters": 1.0, "Centimeters": 0.01, "Millimeters": 0.001}
_READ = {"Rotation Type": "Quaternion", "Coordinate Space": "Global"}
_POSE = (*(("Rotation", axis) for axis in "XYZW"), *(("Position", axis) for axis in "XYZ"))
_BODY, _BONE = "Rigid Body", "Bone"


class MotiveSettings(MotionCaptureSettings):
    """Settings of :class:`MotiveClip`."""

    up: Up = "y"


class MotiveClip(MotionCaptureClip):
    """A clip without images from a take of Motive."""

    Settings = MotiveSettings

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a file, or a folder that holds some."""
        return recognised_files(path, lambda file: _FIRST in header_names(file), "a take of Motive")

    @staticmethod
    def read(path: Path, every: int = 1) -> Take:
        """Read each n-th frame of a file.

        Raises
        ------
        VfoaError
            For the first mistake, with file and line: settings of the export that cannot be read, no rigid body, a cell
            that is no number, or a quaternion that is not of length 1.
        """
        rows = csv_rows(path)
        unit_m = _unit_m(next(rows, (1, []))[1], path)
        header, bodies, bones = _columns(rows, path)
        columns = [0, 1, *(place for places in bodies.values() for place in places)]
        lines, cells = read_cells(rows, header, columns, every, path)
        return Take(
            numbers=frame_numbers(cells[:, 0], lines, path),
            times_ns=nanoseconds(cells[:, 1], lines, path),
            poses=poses_of(bodies, cells[:, 2:], unit_m, lines, path),
            bones=bones,
        )


def _unit_m(first: Sequence[str], path: Path) -> float:
    """The unit of length, m, from the first line, which also says how rotations are written."""
    header_values = dict(zip(first[::2], first[1::2], strict=False))
    if _FIRST not in header_values:
        raise VfoaError(f"{path}:1: no {_FIRST!r}; expected a CSV of Motive with its header")
    for name, expected in _READ.items():
        if (found := header_values.get(name, expected)) != expected:
            raise VfoaError(f"{path}:1: {name}: found {found!r}; expected {expected}: choose it in Motive's CSV export")
    if (unit := header_values.get("Length Units", "")) not in _UNITS_M:
        raise VfoaError(f"{path}:1: Length Units: {did_you_mean(unit, _UNITS_M)}")
    return _UNITS_M[unit]


def _columns(
    rows: Iterator[tuple[int, list[str]]], path: Path
) -> tuple[list[str], dict[str, list[int]], frozenset[str]]:
    """The line above the frames, the columns of the pose of each body, and the names of bones."""
    above: list[list[str]] = []
    for _, axes in rows:
        if axes[0] == "Frame":
            break
        if any(axes):
            above.append(axes)
    else:
        raise VfoaError(f"{path}: no line that begins with Frame; expected a CSV of Motive with its header")
    if len(above) < 3 or any(len(line) != len(axes) for line in above):
        raise VfoaError(
            f"{path}: found other lines above the frames; expected Motive's: Type, Name, ID, the quantity and its axis"
        )
    found: dict[str, dict[tuple[str, str], int]] = {}
    bones = set()
    for place, (kind, name, *quantity) in enumerate(zip(above[0], above[1], above[-1], axes, strict=True)):
        if kind not in (_BODY, _BONE) or (what := (quantity[0], quantity[1])) not in _POSE:
            continue
        check_body(name, [other for other, places in found.items() if what in places], f"{path}: Name", "Motive")
        found.setdefault(name, {})[what] = place
        if kind == _BONE:
            bones.add(name)
    whole = {name: [places[what] for what in _POSE] for name, places in found.items() if len(places) == len(_POSE)}
    if not whole:
        raise VfoaError(f"{path}: no rigid body; expected Rigid Body Bones, chosen in Motive's CSV export")
    return axes, whole, frozenset(bones & whole.keys())
