"""Heads of another program, from a CSV table.

frame,subject,u0_px,v0_px,u1_px,v1_px[,score][,instance_id]
    [,face_u0_px,face_v0_px,face_u1_px,face_v1_px]
    [,right_eye_u_px,right_eye_v_px,left_eye_...,nose_...,right_mouth_...,left_mouth_...]

Pixels of the rectified left image, (u0, v0) the upper left and (u1, v1) the lower right corner; the whole head, not the
face alone. The landmarks are the person's own right and left. ``instance_id`` is the person's id in the masks. A frame
without a row has no heads.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from pydantic import Field

from harness.data_folders import expand
from harness.files import digest_files, file_digest
from harness.sources import Clip
from harness.stages.outputs.tables import Row, read_table, write_table
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.types import Float, Head, Instances, StereoFrame

BOX = ("u0_px", "v0_px", "u1_px", "v1_px")
FACE = tuple(f"face_{name}" for name in BOX)
LANDMARKS = tuple(
    f"{point}_{axis}_px" for point in ("right_eye", "left_eye", "nose", "right_mouth", "left_mouth") for axis in "uv"
)
COLUMNS = (*BOX, "score", *FACE, *LANDMARKS, "instance_id")


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

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return the heads of one frame."""
        return tuple(self._heads.get(frame.index, {}).values())

    def digest(self) -> str:
        """Hexadecimal sha256 of the table."""
        return digest_files([("heads", self._path)])


def read_heads(path: Path, clip: Clip) -> dict[int, dict[str, Head]]:
    """The heads of a table by frame and subject, in the order of the rows.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line.
    """
    return _read_heads(path, file_digest(path), tuple(clip.frames))


@lru_cache(maxsize=2)
def _read_heads(path: Path, digest: str, frames: tuple[int, ...]) -> dict[int, dict[str, Head]]:
    """As above, once for a content: several stages read it, and so does whoever describes the run."""
    heads: dict[int, dict[str, Head]] = {}
    for row in read_table(path, COLUMNS, frames):
        heads.setdefault(row.frame, {})[row.subject] = _head(row)
    return heads


def write_heads(path: Path, rows: list[tuple[int, str, Head]]) -> None:
    """Write heads by frame and subject, as :func:`read_heads` reads them."""
    write_table(path, COLUMNS, [(frame, subject, *_cells(head)) for frame, subject, head in rows])


def _head(row: Row) -> Head:
    box = row.numbers(BOX)
    if box is None:
        raise VfoaError(f"{row.where}: no box; expected {', '.join(BOX)}")
    score, landmarks = row.number("score"), row.numbers(LANDMARKS)
    try:
        return Head(
            box_px=box,
            score=1.0 if score is None else score,
            face_box_px=row.numbers(FACE),
            landmarks_px=None if landmarks is None else landmarks.reshape(5, 2),
            instance_id=_instance(row),
        )
    except ValueError as error:  # a box without an area; the error's text says which
        raise VfoaError(f"{row.where}: {error}") from None


def _instance(row: Row) -> int | None:
    """The person's id. It need not be among the masks: a hidden person has no pixel there."""
    value = row.number("instance_id")
    if value is not None and (value != int(value) or not 0 < value < 2**16):
        raise VfoaError(f"{row.where}: instance_id: expected 1 to 65535, found {row.cells['instance_id']!r}")
    return None if value is None else int(value)


def _cells(head: Head) -> list[float | int | None]:
    return [
        *_numbers(head.box_px, len(BOX)),
        float(head.score),
        *_numbers(head.face_box_px, len(FACE)),
        *_numbers(head.landmarks_px, len(LANDMARKS)),
        head.instance_id,
    ]


def _numbers(values: Float | None, count: int) -> list[float] | list[None]:
    return [None] * count if values is None else values.ravel().tolist()
