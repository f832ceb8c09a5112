"""Heads of another program, from a CSV table.

frame,subject,u0_px,v0_px,u1_px,v1_px[,score][,instance_id]
    [,face_u0_px,face_v0_px,face_u1_px,face_v1_px]
    [,right_eye_u_px,right_eye_v_px,left_eye_...,nose_...,right_mouth_...,left_mouth_...]

A table of OpenFace or gaze3d is read, too (:mod:`harness.pipeline.stage_files.other_programs`).

``frame`` is its number, or the name of its image, such as ``00070.png``, which has it. Pixels of the rectified left
image, (u0, v0) the upper left and (u1, v1) the lower right corner; the whole head, not the face alone. The landmarks
are the person's own right and left. ``instance_id`` is the person's id in the masks. A frame without a row has no
heads.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePath

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from harness.files.digests import digest_files, file_digest
from harness.files.remote import expand
from harness.files.tables import TableColumns, read_columns
from harness.pipeline.stage_files.other_programs import Part, program_of, read_part
from harness.sources import Clip
from harness.sources.media.frame_files import IMAGE_SUFFIXES, count_from_1, number_names
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.types import Head, Instances, StereoFrame

KEYS = ("frame", "subject")


@dataclass(frozen=True, slots=True, kw_only=True)
class RowKeys:
    """The frame (n,) and the subject of each row of a table; ``order`` (n,) sorts the rows by frame."""

    frames: NDArray[np.int64]
    order: NDArray[np.intp]
    subjects: tuple[str, ...]

    def pairs(self) -> Iterator[tuple[int, str]]:
        """The frame and the subject of each row."""
        return zip(self.frames.tolist(), self.subjects, strict=True)

    def rows(self, frame: int) -> list[int]:
        """The rows of a frame, in the file's order."""
        begin, end = np.searchsorted(self.frames, (frame, frame + 1), sorter=self.order).tolist()
        rows: list[int] = self.order[begin:end].tolist()
        return rows


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTable(RowKeys):
    """A table of stage outputs while it is checked, with the text of its cells."""

    columns: TableColumns

    def keys(self) -> RowKeys:
        """The keys of the rows, without the text: an hour of video has 90,000 rows for each person."""
        return RowKeys(frames=self.frames, order=self.order, subjects=self.subjects)


def read_table(path: Path, part: Part, columns: Sequence[str], frames: Sequence[int]) -> FrameTable:
    """Read a table.

    Parameters
    ----------
    part
        Which outputs are wanted of the table of another program.
    columns
        The columns that the table may have beside ``frame`` and ``subject``, in any order.
    frames
        The clip's frame numbers.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line: a column that is unknown, missing or repeated, a wrong number
        of cells, a frame that the clip does not have, a blank subject, or a repeated pair of frame and subject.
    """
    program = program_of(path)
    content = read_part(path, program, part, frames) if program else read_columns(path, (*KEYS, *columns), KEYS)
    numbers = frame_numbers(content, frames)
    order = np.argsort(numbers, kind="stable")
    table = FrameTable(columns=content, frames=numbers, order=order, subjects=content.cells["subject"])
    content.refuse_first(
        ~np.isin(table.frames, np.array([*frames], dtype=np.int64)),
        lambda row: f"frame {table.frames[row]}: not in the clip; expected {min(frames)} to {max(frames)}",
    )
    content.refuse_first(
        np.array([not subject for subject in table.subjects], dtype=bool),
        lambda row: "subject: found nothing; expected a word",
    )
    content.refuse_repeated(f"frame {frame}, subject {subject!r}" for frame, subject in table.pairs())
    return table


def frame_numbers(columns: TableColumns, frames: Sequence[int]) -> NDArray[np.int64]:
    """The frame (n,) of each row: its number, or that in the name of its image, of a clip with these frames.

    Raises
    ------
    VfoaError
        If a cell is neither, or the names of images do not differ in one number.
    """
    names = {*columns.cells["frame"]}
    if not names or any(PurePath(name).suffix.lower() not in IMAGE_SUFFIXES for name in names):
        return columns.integers("frame")
    by_number = number_names(names, f"{columns.path}: frame")
    numbers = {name: number for number, name in by_number.items()}
    return np.array([numbers[name] for name in columns.cells["frame"]], np.int64) - count_from_1(by_number, frames)


BOX = ("u0_px", "v0_px", "u1_px", "v1_px")
FACE = tuple(f"face_{name}" for name in BOX)
LANDMARKS = tuple(
    f"{point}_{axis}_px" for point in ("right_eye", "left_eye", "nose", "right_mouth", "left_mouth") for axis in "uv"
)
COLUMNS = (*BOX, "score", *FACE, *LANDMARKS, "instance_id")


_FEWEST_FACES = 5
"""Faces of which one may be upside down, but not most."""
MOST_OUTSIDE = 0.25
"""Most heads outside of the image, as a share: a tracker may follow one that leaves it."""


class FileHeadsSettings(Settings):
    """Location of the heads: the table ``file`` under ``root``."""

    root: str
    """Folder of the table; ``${CLIP}`` stands for the clip's name."""
    file: str = Field(default="heads.csv", min_length=1)
    """Table of head boxes below ``root``."""


class FileHeads:
    """A head detector that reads each frame's heads from a table, in the order of their rows."""

    Settings = FileHeadsSettings

    def __init__(self, settings: FileHeadsSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), "heads.root")
        self._path = root / settings.file
        self._heads = read_heads(self._path, clip)
        self._checked_px: set[tuple[int, int]] = set()

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return the heads of one frame.

        Raises
        ------
        VfoaError
            If many heads of the table lie outside of an image of this size.
        """
        size_px = frame.rig.width_px, frame.rig.height_px
        if size_px not in self._checked_px:
            self._heads.check_size(self._path, *size_px)
            self._checked_px.add(size_px)
        return tuple(self._heads.of(frame.index).values())

    def digest(self) -> str:
        """Hexadecimal sha256 of the table."""
        return digest_files([("heads", self._path)])


class HeadTable:
    """The heads of a table, as arrays: a head is made when its frame is asked for. All rows are checked before."""

    def __init__(self, path: Path, frames: Sequence[int]) -> None:
        table = read_table(path, "heads", COLUMNS, frames)
        columns = table.columns
        self._boxes, self._faces, self._landmarks = (columns.group(names) for names in (BOX, FACE, LANDMARKS))
        self._lines = np.array(columns.lines)
        self._scores, self._instances = columns.numbers("score"), columns.numbers("instance_id")
        self._keys, ids = table.keys(), self._instances
        columns.refuse_first(np.isnan(self._boxes[:, 0]), lambda row: f"no box; expected {', '.join(BOX)}")
        if len(self._boxes) > 1 and (self._boxes >= 0).all() and (self._boxes <= 1).all():
            raise VfoaError(
                f"{path}: {', '.join(BOX)}: all are from 0 to 1; expected pixels of the left image: multiply by its "
                "width and height"
            )
        is_swapped = self._landmarks[:, 0] > self._landmarks[:, 2]
        swapped, faces = np.count_nonzero(is_swapped), np.count_nonzero(~np.isnan(self._landmarks[:, 0]))
        columns.refuse_first(
            is_swapped & (2 * swapped > faces >= _FEWEST_FACES),
            lambda row: (
                f"right_eye_u_px: found the right eye to the right of the left one in {swapped} of {faces} faces; "
                "expected the person's own right eye and corner of the mouth, on the image's left: exchange them"
            ),
        )
        for names, points in ((FACE, self._faces), (LANDMARKS, self._landmarks)):
            self._check_inside(columns, names, points.reshape(-1, len(names) // 2, 2).mean(axis=1))
        columns.refuse_first(
            # the person's id need not be among the masks: a hidden person has no pixel there
            ~np.isnan(ids) & ((ids != np.floor(ids)) | (ids <= 0) | (ids >= 2**16)),
            lambda row: f"instance_id: expected 1 to 65535, found {columns.cells['instance_id'][row]!r}",
        )
        for names, boxes in ((BOX, self._boxes), (FACE, self._faces)):
            has_area = (boxes[:, 0] < boxes[:, 2]) & (boxes[:, 1] < boxes[:, 3])
            why = f"{', '.join(names)}: expected a box with an area"
            columns.refuse_first(~(has_area | np.isnan(boxes[:, 0])), lambda row, why=why: why)  # type: ignore[misc]

    def _check_inside(self, columns: TableColumns, names: Sequence[str], middles: NDArray[np.float64]) -> None:
        """Check that the middles (n, 2) of most faces, NaN where unknown, are in the heads' boxes."""
        is_outside = ((middles < self._boxes[:, :2]) | (middles > self._boxes[:, 2:])).any(axis=1)
        outside, faces = np.count_nonzero(is_outside), np.count_nonzero(~np.isnan(middles[:, 0]))
        columns.refuse_first(
            is_outside & (2 * outside > faces >= _FEWEST_FACES),
            lambda row: (
                f"{names[0]} to {names[-1]}: their middle is outside of the head's box in {outside} of {faces} faces; "
                "expected pixels of the left image"
            ),
        )

    def check_size(self, path: Path, width_px: int, height_px: int) -> None:
        """Check that most heads are in an image of this size.

        Raises
        ------
        VfoaError
            If not: they are of larger pictures, or of a film that has both views beside each other.
        """
        u0, v0, u1, v1 = self._boxes.T
        outside = np.flatnonzero((u1 <= 0) | (v1 <= 0) | (u0 >= width_px) | (v0 >= height_px))
        if len(outside) > MOST_OUTSIDE * len(self._boxes):
            raise VfoaError(
                f"{path}:{self._lines[outside[0]]}: found {len(outside)} of {len(self._boxes)} heads outside of the "
                f"left image of {width_px} x {height_px}, this one first; expected pixels of that image"
            )

    def of(self, frame: int) -> dict[str, Head]:
        """The heads of a frame by subject, in the order of the rows."""
        return {self._keys.subjects[row]: self._head(row) for row in self._keys.rows(frame)}

    def has(self, table: FrameTable) -> NDArray[np.bool_]:
        """Whether the frame and the subject of each row (n,) of another table have a head."""
        known = {*self._keys.pairs()}
        return np.array([key in known for key in table.pairs()], dtype=bool)

    def _head(self, row: int) -> Head:
        face, landmarks, score, instance = (
            column[row] for column in (self._faces, self._landmarks, self._scores, self._instances)
        )
        return Head(
            box_px=self._boxes[row],
            score=1.0 if math.isnan(score) else float(score),
            face_box_px=None if math.isnan(face[0]) else face,
            landmarks_px=None if math.isnan(landmarks[0]) else landmarks.reshape(5, 2),
            instance_id=None if math.isnan(instance) else int(instance),
        )


def read_heads(path: Path, clip: Clip) -> HeadTable:
    """The heads of a table.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line.
    """
    return _read_heads(path, file_digest(path), tuple(clip.frames))


@lru_cache(maxsize=2)
def _read_heads(path: Path, digest: str, frames: tuple[int, ...]) -> HeadTable:
    """Read a table once per content: several stages need it, and the description of the run."""
    return HeadTable(path, frames)
