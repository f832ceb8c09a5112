"""CSV tables of stage outputs: one row per frame and subject, read strictly.

frame,subject,<columns of the output>

``frame`` is the clip's own number. ``subject`` is any word: it joins the rows of a frame over several files, and need
not be a name of the manifest. The unit is in a column's name. A blank cell means that the value is not known.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.strict_tables import TableRow, read_rows, write_rows
from vfoa.errors import VfoaError

KEYS = ("frame", "subject")


@dataclass(frozen=True, slots=True, kw_only=True)
class Row(TableRow):
    """One row with its keys."""

    frame: int
    subject: str


def read_table(path: Path, columns: Sequence[str], frames: Collection[int]) -> list[Row]:
    """Read the rows of a table, in the file's order.

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
    rows: list[Row] = []
    first_seen: dict[tuple[int, str], str] = {}
    known_frames = frozenset(frames)
    for cells in read_rows(path, (*KEYS, *columns), KEYS):
        row = _row(cells, known_frames)
        if before := first_seen.get((row.frame, row.subject)):
            raise VfoaError(f"{row.where}: frame {row.frame}, subject {row.subject!r}: occurs twice, first at {before}")
        first_seen[row.frame, row.subject] = row.where
        rows.append(row)
    return rows


def write_table(path: Path, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write a table atomically: ``columns`` follow ``frame,subject``; floats are exact, None is a blank cell."""
    write_rows(path, (*KEYS, *columns), rows)


def _row(row: TableRow, frames: Collection[int]) -> Row:
    frame, subject = row.integer("frame"), row.cells.get("subject")
    if frame is None:
        raise VfoaError(f"{row.where}: frame: expected a whole number, found nothing")
    if frame not in frames:
        raise VfoaError(f"{row.where}: frame {frame}: not in the clip; expected {min(frames)} to {max(frames)}")
    if not subject:
        raise VfoaError(f"{row.where}: subject: found nothing; expected a word")
    cells = {column: cell for column, cell in row.cells.items() if column not in KEYS}
    return Row(where=row.where, frame=frame, subject=subject, cells=cells)
