"""QTM's TSV of the 6DOF data of a measurement of Qualisys (docs.qualisys.com, Export to TSV).

Lines of a name and its values, a line that says what each column is, and a line for each frame, all with tabs::

    FREQUENCY   100
    DATA_INCLUDED   6D
    BODY_NAMES  anna    cup
    Frame   Time    anna X  Y   Z   Roll    Pitch   Yaw Residual    Rot[0]  ...  Rot[8]  cup X  ...
    1   0.00000 -194.91974  2.24150 ...

X, Y and Z are the body's origin, mm. The matrix goes down its columns, and turns the body's own axes into those of the
room, which are right-handed with z up if the project was not set otherwise; its angles are right-handed. Roll, Pitch
and Yaw depend on the project's definition and are not read. A lost body has blank cells, or a matrix of zeros.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.dialects import csv_lines
from harness.files.io import read_text
from harness.sources import Recognised
from harness.sources.measured.clip import recognised_files
from harness.sources.measured.motion_capture import (
    MotionCaptureClip,
    MotionCaptureSettings,
    Poses,
    Take,
    Up,
    check_body,
    frame_numbers,
    frames_per_second,
    nanoseconds,
    read_cells,
)
from vfoa.errors import VfoaError
from vfoa.types import Float

_MATRIX = tuple(f"Rot[{place}]" for place in range(9))
_POSE = ("X", "Y", "Z", *_MATRIX)
_TOLERANCE = 0.01
_INCLUDED = re.compile(r"^DATA_INCLUDED\t([^\t\r\n]*)", re.MULTILINE)
_SUFFIXES = (".tsv", ".txt")


class QualisysSettings(MotionCaptureSettings):
    """Settings of :class:`QualisysClip`."""

    up: Up = "z"


class QualisysClip(MotionCaptureClip):
    """A clip without images from the 6DOF data of QTM."""

    Settings = QualisysSettings

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a file, or a folder that holds some.

        Raises
        ------
        VfoaError
            If the path is a file of QTM with other data: markers.
        """
        if (included := _included(path)) not in (None, "6D"):
            raise VfoaError(
                f"{path}: DATA_INCLUDED: found {included!r}; expected 6D: rigid bodies, chosen in QTM's TSV export"
            )
        return recognised_files(path, lambda file: _included(file) == "6D", "rigid bodies of QTM", pattern="*")

    @staticmethod
    def read(path: Path, every: int = 1) -> Take:
        """Read each n-th frame of a file.

        Raises
        ------
        VfoaError
            For the first mistake, with file and line: no names of columns, no rigid body, a cell that is no number, or
            a matrix that is no rotation.
        """
        rows = csv_lines(read_text(path), path, 0, "\t")
        header_values, header = _above(rows, path)
        bodies = _bodies(header, path)
        clock = [header.index(name) for name in ("Frame", "Time") if name in header]
        columns = [*clock, *(place for places in bodies.values() for place in places)]
        lines, cells = read_cells(rows, header, columns, every, path)
        if len(clock) == 2:
            numbers, times_s = frame_numbers(cells[:, 0], lines, path), cells[:, 1]
        else:
            numbers = [1 + every * place for place in range(len(lines))]
            cell = next(iter(header_values.get("FREQUENCY", ())), "")
            rate_hz = frames_per_second(cell, f"{path}: FREQUENCY", ", or the columns Frame and Time")
            times_s = (np.array(numbers) - 1) / rate_hz
        of_bodies = np.split(cells[:, len(clock) :], len(bodies), axis=1)
        return Take(
            numbers=numbers,
            times_ns=nanoseconds(times_s, lines, path),
            poses={name: _poses(each, lines, path, name) for name, each in zip(bodies, of_bodies, strict=True)},
        )


def _included(path: Path) -> str | None:
    """What data a file of QTM says that it holds, by its beginning; None of any other file."""
    if path.suffix.lower() not in _SUFFIXES or not path.is_file():
        return None
    try:
        with path.open(encoding="utf-8-sig") as file:
            found = _INCLUDED.search(file.read(2**16))
    except (OSError, UnicodeDecodeError):
        return None
    return found[1] if found else None


def _above(rows: Iterator[tuple[int, list[str]]], path: Path) -> tuple[dict[str, Sequence[str]], list[str]]:
    """What the first lines say, by name, and the names of columns below them."""
    header_values: dict[str, Sequence[str]] = {}
    for _, cells in rows:
        if _MATRIX[0] in cells:
            return header_values, cells
        header_values[cells[0]] = cells[1:]
    raise VfoaError(
        f"{path}: no line with the names of columns, {_MATRIX[0]} among them; expected 6DOF data with header, names of "
        "columns and rotation matrix, chosen in QTM's TSV export"
    )


def _bodies(header: Sequence[str], path: Path) -> dict[str, list[int]]:
    """The columns of the pose of each body, whose name stands before its X."""
    found: dict[str, dict[str, int]] = {}
    of_body: dict[str, int] = {}
    for place, cell in enumerate(header):
        name, _, axis = cell.rpartition(" ")
        if axis == "X" and name:
            check_body(name, found, f"{path}: BODY_NAMES", "QTM")
            of_body = found[name] = {"X": place}
        else:
            of_body.setdefault(cell, place)
    for name, of_body in found.items():
        if missing := [column for column in _POSE if column not in of_body]:
            raise VfoaError(f"{path}: {name}: no column {missing[0]!r}; expected {', '.join(_POSE)}")
    if not found:
        raise VfoaError(f"{path}: no rigid body; expected a column 'NAME X' for each")
    return {name: [of_body[column] for column in _POSE] for name, of_body in found.items()}


def _poses(cells: Float, lines: Sequence[int], path: Path, name: str) -> Poses:
    """The poses of a body from its places, mm, and the columns of its matrices (N, 12)."""
    rotations = cells[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2).copy()
    places_m = cells[:, :3] / 1000
    is_lost = np.isnan(cells).any(axis=1) | ~rotations.any(axis=(1, 2))
    rotations[is_lost] = np.eye(3)
    apart = np.abs(rotations @ rotations.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
    for row in np.flatnonzero((apart > _TOLERANCE) | (np.linalg.det(rotations) < 0))[:1]:
        raise VfoaError(f"{path}:{lines[row]}: {name}: {_MATRIX[0]} to {_MATRIX[-1]}: expected a rotation matrix")
    rotations[is_lost], places_m[is_lost] = np.nan, np.nan
    return Poses(rotations=rotations, places_m=places_m)
