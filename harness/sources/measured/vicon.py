"""The CSV of objects that Vicon Tracker exports, with quaternions.

::

    Objects
    100                                                         frames per second
    ,,Global Angle (Quaternion) cap:cap,,,,,,,Global Angle (Quaternion) cup:cup,...
    Frame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ,RX,...
    ,,,,,,mm,mm,mm,...
    1,0,0.008,-0.649,0.002,0.760,3717.9,45.9,-2209.5,...

The unit quaternion turns the object's own axes into those of the room, which are right-handed with z up. A lost object
has blank cells, or zeros. The file does not say which angles are meant where there is no RW, so these are not read. No
file that Tracker wrote was at hand: the form is that which other programs read and write.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
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
    frames_per_second,
    poses_of,
    read_cells,
)
from vfoa.errors import VfoaError

_TITLES = ("Objects", "Segments")
_OTHERS = ("Trajectories", "Model Outputs", "Joints", "Devices")
"""Sections of Vicon Nexus, which have no rigid bodies."""
_POSE = ("RX", "RY", "RZ", "RW", "TX", "TY", "TZ")
_NAME = re.compile(r"(?:Global Angle \([^)]*\) )?(.+)")


class ViconSettings(MotionCaptureSettings):
    """Settings of :class:`ViconClip`."""

    up: Up = "z"


class ViconClip(MotionCaptureClip):
    """A clip without images from the objects of Vicon Tracker."""

    Settings = ViconSettings

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a file, or a folder that holds some.

        Raises
        ------
        VfoaError
            If the path is a file of Vicon with other data: markers, joints, analogue signals.
        """
        if title := next((title for title in _OTHERS if _has_title(path, (title,))), None):
            raise VfoaError(
                f"{path}: found {title} of Vicon; expected Objects: rigid bodies, by Tracker's export with quaternions"
            )
        return recognised_files(path, _has_title, "objects of Vicon")

    @staticmethod
    def read(path: Path, every: int = 1) -> Take:
        """Read each n-th frame of a file.

        Raises
        ------
        VfoaError
            For the first mistake, with file and line: no header of Tracker, angles in place of quaternions, lengths
            that are not mm, a cell that is no number, or a quaternion that is not of length 1.
        """
        rows = csv_rows(path)
        rate_hz = _rate_hz(rows, path)
        header, bodies = _bodies(rows, path)
        columns = [0, *(place for first in bodies.values() for place in range(first, first + len(_POSE)))]
        lines, cells = read_cells(_frames(rows, len(header)), header, columns, every, path)
        numbers = frame_numbers(cells[:, 0], lines, path)
        return Take(
            numbers=numbers,
            times_ns=[round(1e9 * (number - numbers[0]) / rate_hz) for number in numbers],
            poses=poses_of(bodies, cells[:, 1:], 0.001, lines, path),
        )


def _has_title(path: Path, titles: Sequence[str] = _TITLES) -> bool:
    return any(header_names(path) - {""} == {title} for title in titles)


def _rate_hz(rows: Iterator[tuple[int, list[str]]], path: Path) -> float:
    """Frames per second, from the line below the title."""
    _, title = next(rows, (1, [""]))
    if title[0] not in _TITLES:
        raise VfoaError(f"{path}:1: found {title[0][:40]!r}; expected {' or '.join(_TITLES)}, as Vicon Tracker writes")
    line, cells = next(rows, (2, [""]))
    return frames_per_second(cells[0], f"{path}:{line}")


def _bodies(rows: Iterator[tuple[int, list[str]]], path: Path) -> tuple[list[str], dict[str, int]]:
    """The names of columns, and the first column of each body by its name."""
    _, names = next(rows, (3, []))
    line, header = next(rows, (4, [""]))
    unit_line, units = next(rows, (5, []))
    if header[0] != "Frame" or min(len(names), len(units)) < len(header) - 1:
        raise VfoaError(
            f"{path}:{line}: found other lines above the frames; expected Vicon Tracker's: names, columns, units"
        )
    found: dict[str, int] = {}
    for place in (place for place, cell in enumerate(header) if cell == _POSE[0]):
        match = _NAME.fullmatch(names[place].strip())
        name = _short(match[1]) if match else ""
        check_body(name, found, f"{path}:{line - 1}", "Tracker")
        if tuple(header[place : place + len(_POSE)]) != _POSE:
            raise VfoaError(
                f"{path}:{line}: {name}: found {','.join(header[place : place + 6])}; expected {','.join(_POSE)}: "
                "quaternions, chosen in Tracker's CSV export"
            )
        if (unit := units[place + 4]) != "mm":
            raise VfoaError(f"{path}:{unit_line}: {name}: found the unit {unit!r}; expected mm")
        found[name] = place
    if not found:
        raise VfoaError(f"{path}:{line}: no object; expected {','.join(_POSE)} of each")
    return header, found


def _short(name: str) -> str:
    """The name of an object without that of its segment, if both are the same."""
    first, _, second = name.partition(":")
    return first if first == second else name


def _frames(rows: Iterator[tuple[int, list[str]]], width: int) -> Iterator[tuple[int, list[str]]]:
    """The lines of frames, up to the title of another section; lines may end with a comma."""

    def is_frame(row: tuple[int, Sequence[str]]) -> bool:
        first, *others = row[1]
        return any(others) or not first.replace(" ", "").isalpha()

    for line, cells in takewhile(is_frame, rows):
        yield line, cells[:-1] if len(cells) == width + 1 and not cells[-1] else cells
