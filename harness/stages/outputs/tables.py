"""CSV tables of stage outputs: one row per frame and subject, read strictly.

frame,subject,<columns of the output>

``frame`` is the clip's own number. ``subject`` is any word: it joins the rows of a frame over several files, and need
not be a name of the manifest. The unit is in a column's name. A blank cell means that the value is not known.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.files.tables import TableColumns, read_columns
from vfoa.errors import VfoaError

KEYS = ("frame", "subject")


class RowIndex:
    """The rows of a table by frame: two numbers a row."""

    def __init__(self, frames: NDArray[np.int64]) -> None:
        self._order = np.argsort(frames, kind="stable")
        self._frames = frames[self._order]

    def of(self, frame: int) -> list[int]:
        """The rows of a frame, in the file's order."""
        begin, end = np.searchsorted(self._frames, (frame, frame + 1)).tolist()
        found: list[int] = self._order[begin:end].tolist()
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTable:
    """The columns of a table of stage outputs, with the frame (n,) and the subject of each row."""

    columns: TableColumns
    frames: NDArray[np.int64]
    subjects: tuple[str, ...]

    def reject(self, wrong: NDArray[np.bool_], said: Callable[[int], str]) -> None:
        """Raise a :class:`VfoaError` for the first row that is wrong, with what is ``said`` of it."""
        for row in np.flatnonzero(wrong)[:1].tolist():
            raise VfoaError(f"{self.columns.where(row)}: {said(row)}")


def read_table(path: Path, columns: Sequence[str], frames: Collection[int]) -> FrameTable:
    """Read a table.

    Parameters
    ----------
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
    found = read_columns(path, (*KEYS, *columns), KEYS)
    table = FrameTable(columns=found, frames=found.integers("frame"), subjects=found.cells["subject"])
    table.reject(
        ~np.isin(table.frames, np.array([*frames], dtype=np.int64)),
        lambda row: f"frame {table.frames[row]}: not in the clip; expected {min(frames)} to {max(frames)}",
    )
    table.reject(
        np.array([not subject for subject in table.subjects], dtype=bool),
        lambda row: "subject: found nothing; expected a word",
    )
    _check_once(table)
    return table


def _check_once(table: FrameTable) -> None:
    first: dict[tuple[int, str], int] = {}
    for row, key in enumerate(zip(table.frames.tolist(), table.subjects, strict=True)):
        if (before := first.setdefault(key, row)) != row:
            where, earlier = table.columns.where(row), table.columns.where(before)
            raise VfoaError(f"{where}: frame {key[0]}, subject {key[1]!r}: occurs twice, first at {earlier}")
