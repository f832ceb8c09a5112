"""CSV tables of signals: one row a frame and subject, read strictly.

    frame,subject,<columns of the signal>

``frame`` is the clip's own number. ``subject`` is any word: it joins the rows of a frame over several files, and need
not be a name of the manifest. The unit is in a column's name. A blank cell means that the value is not known.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.files import atomic_write, read_text
from vfoa.errors import VfoaError, did_you_mean
from vfoa.types import Float

KEYS = ("frame", "subject")
_INTEGER = re.compile(r"-?[0-9]{1,18}")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One line: its place for messages, its keys, and the cells that are not blank by column."""

    where: str
    frame: int
    subject: str
    cells: Mapping[str, str]

    def number(self, column: str) -> float | None:
        """The number in a column; None where it is blank.

        Raises
        ------
        VfoaError
            If it is no finite number.
        """
        cell = self.cells.get(column)
        if cell is None:
            return None
        if not _NUMBER.fullmatch(cell) or not math.isfinite(float(cell)):
            raise VfoaError(f"{self.where}: {column}: expected a finite number, found {cell!r}")
        return float(cell)

    def numbers(self, columns: Sequence[str]) -> Float | None:
        """The numbers (n,) of columns that belong together; None where all are blank.

        Raises
        ------
        VfoaError
            If some are blank, or one is no finite number.
        """
        found = [self.number(column) for column in columns]
        if all(value is None for value in found):
            return None
        if None in found:
            blank = columns[found.index(None)]
            raise VfoaError(f"{self.where}: {blank}: found nothing; expected all of {', '.join(columns)}, or none")
        return np.array(found, dtype=np.float64)


def read_table(path: Path, columns: Sequence[str], frames: Collection[int]) -> list[Row]:
    """Read the rows of a table, in the file's order.

    Parameters
    ----------
    columns
        What the table may have beside ``frame`` and ``subject``, in any order.
    frames
        The clip's frame numbers.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line: a column that is not known, missing or there twice, a wrong number
        of cells, a frame that the clip does not have, a blank subject, or a frame and subject that come twice.
    """
    rows: list[Row] = []
    first_seen: dict[tuple[int, str], str] = {}
    known_frames = frozenset(frames)
    for where, cells in _lines(path, columns):
        row = _row(where, cells, known_frames)
        if before := first_seen.get((row.frame, row.subject)):
            raise VfoaError(f"{where}: frame {row.frame}, subject {row.subject!r}: is there twice, first at {before}")
        first_seen[row.frame, row.subject] = where
        rows.append(row)
    return rows


def write_table(path: Path, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write a table, whole or not at all: ``columns`` follow ``frame,subject``; floats exactly, None as a blank."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*KEYS, *columns])
    writer.writerows(rows)
    atomic_write(path, text.getvalue())


def _lines(path: Path, columns: Sequence[str]) -> list[tuple[str, dict[str, str]]]:
    """Place and cells of every line below the header, blank lines left out."""
    reader = csv.reader(io.StringIO(read_text(path), newline=""), strict=True)
    header: list[str] = []
    lines = []
    try:
        for cells in reader:
            where = f"{path}:{reader.line_num}"
            if not header:
                header = _header([cell.strip() for cell in cells], (*KEYS, *columns), where)
            elif cells:
                if len(cells) != len(header):
                    raise VfoaError(f"{where}: found {len(cells)} cells; expected {len(header)}, as in the header")
                lines.append((where, dict(zip(header, (cell.strip() for cell in cells), strict=True))))
    except csv.Error as error:
        raise VfoaError(f"{path}:{reader.line_num}: not CSV: {error}") from None
    if not header:
        raise VfoaError(f"{path}:1: no header; expected {','.join(KEYS)},...")
    return lines


def _header(found: list[str], known: Sequence[str], where: str) -> list[str]:
    if unknown := next((column for column in found if column not in known), None):
        raise VfoaError(f"{where}: no column {unknown!r} here; {did_you_mean(unknown, known)}")
    if twice := next((column for column in found if found.count(column) > 1), None):
        raise VfoaError(f"{where}: the column {twice!r} is there twice")
    if missing := next((column for column in KEYS if column not in found), None):
        raise VfoaError(f"{where}: no column {missing!r}; expected {','.join(KEYS)},...")
    return found


def _row(where: str, cells: dict[str, str], frames: Collection[int]) -> Row:
    frame, subject = cells.pop("frame"), cells.pop("subject")
    if not _INTEGER.fullmatch(frame):
        raise VfoaError(f"{where}: frame: expected a whole number, found {frame!r}")
    if int(frame) not in frames:
        raise VfoaError(f"{where}: frame {frame}: not in the clip; expected {min(frames)} to {max(frames)}")
    if not subject:
        raise VfoaError(f"{where}: subject: found nothing; expected a word")
    filled = {column: cell for column, cell in cells.items() if cell}
    return Row(where=where, frame=int(frame), subject=subject, cells=filled)
