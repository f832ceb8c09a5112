"""Faces of other programs as stage outputs: OpenFace 2's table of a sequence, and that of idiap/gaze3d's demo.

Each row becomes a row of the tables of heads and directions (:mod:`harness.pipeline.stage_files.heads`,
:mod:`harness.pipeline.stage_files.directions`), with the line of its own file. The n-th frame of the program is the
n-th frame of the clip: both programs number from 1. Pixels are those of the left image.

OpenFace (:mod:`harness.sources.measured.openface`): the box about its 68 landmarks, which reaches from the brows to the
chin, is enlarged to a face's; directions are in the camera frame.

gaze3d (``demo.py`` at f2c13de; read, not used) writes ``xmin,ymin,xmax,ymax,pid,frame_id,gaze_x,gaze_y,gaze_z``: boxes
of whole heads in pixels, numbers as ``1.0``, and a unit vector with x to the image's left, y up and z away. Its network
sees the head alone, so 0, 0, -1 looks into the camera wherever the person stands. It has no head poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from harness.files.digests import file_digest
from harness.files.tables import TableColumns, header_names, read_columns
from harness.sources.measured.openface import REQUIRED, Face, is_openface, read_openface
from vfoa.crops import grow, head_box
from vfoa.errors import VfoaError
from vfoa.types import Float

Part = Literal["heads", "head_pose", "gaze"]
"""A table of stage outputs."""

Program = Literal["openface", "gaze3d"]

GAZE3D = ("xmin", "ymin", "xmax", "ymax", "pid", "frame_id", "gaze_x", "gaze_y", "gaze_z")

_FOREHEAD = 0.25
"""Height of the forehead that a face's box has above the brows, over the height from brows to chin."""
_POINTS = {"right_eye": range(36, 42), "left_eye": range(42, 48), "nose": [30], "right_mouth": [48], "left_mouth": [54]}
"""OpenFace's landmarks whose mean is one of a head's; the person's own right is on the image's left."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _FaceLine:
    """One face: the line of its file, its frame from 1, its subject, and its cells in each table that has it."""

    line: int
    frame: int
    subject: str
    parts: Mapping[Part, Mapping[str, float]]


def program_of(path: Path) -> Program | None:
    """Which program wrote a table, by its header; None for any other file."""
    if is_openface(path):
        return "openface"
    return "gaze3d" if {*GAZE3D} <= header_names(path) else None


def check_program(path: Path, program: Program) -> None:
    """Check that a table is one of this program.

    Raises
    ------
    VfoaError
        If it is of another one, or none.
    """
    if not path.is_file():
        raise VfoaError(f"{path}: no such file; expected the table of {program}")
    if (found := program_of(path)) != program:
        what = f"a table of {found}" if found else "another table"
        expected = REQUIRED if program == "openface" else GAZE3D
        raise VfoaError(f"{path}:1: {what}; expected that of {program}, with the columns {', '.join(expected)}")


def read_part(path: Path, program: Program, part: Part, frames: Sequence[int]) -> TableColumns:
    """Read one table of stage outputs from a program's file; ``frames`` are the clip's.

    Raises
    ------
    VfoaError
        If the file has a mistake (with its line), no such part, or a frame that the clip does not have.
    """
    rows = _rows(path, program, file_digest(path))
    if late := next((row for row in rows if not 1 <= row.frame <= len(frames)), None):
        raise VfoaError(
            f"{path}:{late.line}: frame {late.frame}: the clip has {len(frames)} frames; expected 1 to {len(frames)}, "
            "the table of the same film"
        )
    chosen = [(row, row.parts[part]) for row in rows if part in row.parts]
    if rows and not chosen:
        raise VfoaError(f"{path}:1: {_MISSING[program, part]}")
    columns = dict.fromkeys(name for _, cells in chosen for name in cells)
    return TableColumns(
        path=path,
        lines=tuple(row.line for row, _ in chosen),
        cells={
            "frame": tuple(str(frames[row.frame - 1]) for row, _ in chosen),
            "subject": tuple(row.subject for row, _ in chosen),
            **{name: tuple(repr(float(cells[name])) for _, cells in chosen) for name in columns},
        },
    )


def parts_in(path: Path, program: Program) -> frozenset[Part]:
    """The tables of stage outputs that a program's file has rows for."""
    return frozenset(part for row in _rows(path, program, file_digest(path)) for part in row.parts)


_MISSING: Mapping[tuple[Program, Part], str] = {
    ("openface", "heads"): "no columns x_0 to y_67; expected OpenFace's landmarks (option -2Dfp)",
    ("openface", "head_pose"): "no head pose; expected OpenFace's option -pose",
    ("openface", "gaze"): "no gaze (columns gaze_0_x to gaze_1_z, not all 0); expected OpenFace's option -gaze",
    ("gaze3d", "head_pose"): "gaze3d has no head poses; expected another head_pose.model, or none",
}


@lru_cache(maxsize=2)
def _rows(path: Path, program: Program, digest: str) -> tuple[_FaceLine, ...]:
    """Read a file once per content: three stages need it."""
    return tuple(_of_openface(path) if program == "openface" else _of_gaze3d(path))


def _of_openface(path: Path) -> Iterator[_FaceLine]:
    for frame, faces in read_openface(path).faces.items():
        for number, face in enumerate(faces, start=1):
            yield _FaceLine(line=face.line, frame=frame, subject=str(number), parts=_parts_of_face(face))


def _parts_of_face(face: Face) -> dict[Part, Mapping[str, float]]:
    parts: dict[Part, Mapping[str, float]] = {"head_pose": _named("xyz", face.head)}
    if face.points_px is not None:
        first, last = face.points_px.min(axis=0), face.points_px.max(axis=0)
        box_px = grow([*first, *last], side=0, top=_FOREHEAD, bottom=0)
        points = {f"{name}_{axis}_px": face.points_px[list(places)].mean(axis=0)[index]
                  for name, places in _POINTS.items() for index, axis in enumerate("uv")}  # fmt: skip
        corners = ("u0_px", "v0_px", "u1_px", "v1_px")
        boxes = {**_named(corners, head_box(box_px)), **_named([f"face_{name}" for name in corners], box_px)}
        parts["heads"] = {**boxes, "score": face.confidence, **points}
    if face.gaze is not None:
        parts["gaze"] = _named("xyz", face.gaze)
    return parts


def _named(names: Sequence[str], values: Float) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def _of_gaze3d(path: Path) -> Iterator[_FaceLine]:
    table = read_columns(path, None, GAZE3D)
    frames, people = (table.integers(name) for name in ("frame_id", "pid"))
    boxes, gazes = table.group(GAZE3D[:4]), table.group(GAZE3D[6:])
    for row, (line, frame, person) in enumerate(zip(table.lines, frames.tolist(), people.tolist(), strict=True)):
        parts: dict[Part, Mapping[str, float]] = {"heads": _named(("u0_px", "v0_px", "u1_px", "v1_px"), boxes[row])}
        length = float(np.linalg.norm(gazes[row]))
        if math.isfinite(length) and length > 0:
            x, y, z = gazes[row] / length
            parts["gaze"] = {"theta_rad": math.atan2(x, -z), "phi_rad": math.asin(y)}
        yield _FaceLine(line=line, frame=frame, subject=str(person), parts=parts)
