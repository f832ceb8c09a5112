"""Tables as columns of numbers: for files of many rows, which take more time and memory as rows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.strict_tables import INTEGER, checked_rows, finite_number, place
from vfoa.errors import VfoaError
from vfoa.types import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class TableColumns:
    """The cells of a table by column, stripped; "" is a blank one."""

    path: Path
    lines: tuple[int, ...]
    cells: Mapping[str, tuple[str, ...]]

    def where(self, row: int) -> str:
        """The place of a row for messages."""
        return place(self.path, self.lines[row])

    def integers(self, column: str) -> NDArray[np.int64]:
        """The whole numbers (n,) of a required column.

        Raises
        ------
        VfoaError
            For the first cell that is blank, or no whole number.
        """
        found: list[int] = []
        for row, cell in enumerate(self.cells[column]):
            if not INTEGER.fullmatch(cell) or abs(int(cell)) >= 2**63:
                said = repr(cell) if cell else "nothing"
                raise VfoaError(f"{self.where(row)}: {column}: expected a whole number, found {said}")
            found.append(int(cell))
        return np.array(found, dtype=np.int64)

    def numbers(self, column: str) -> Float:
        """The numbers (n,) of a column, NaN where a cell is blank; all NaN without the column.

        Raises
        ------
        VfoaError
            For the first cell that is no finite number.
        """
        cells = self.cells.get(column, ())
        if not any(cells):
            return np.broadcast_to(np.float64(np.nan), len(self.lines))
        found = [finite_number(cell) if cell else math.nan for cell in cells]
        if None in found:
            row = found.index(None)
            raise VfoaError(f"{self.where(row)}: {column}: expected a finite number, found {cells[row]!r}")
        return np.array(found, dtype=np.float64)

    def group(self, columns: Sequence[str]) -> Float:
        """The numbers (n, columns) of columns that belong together, NaN in rows where all of them are blank.

        Raises
        ------
        VfoaError
            For the first row where only some are blank, or as :meth:`numbers`.
        """
        found = np.stack([self.numbers(column) for column in columns], axis=1)
        blank = np.isnan(found)
        for row in np.flatnonzero(blank.any(axis=1) & ~blank.all(axis=1))[:1]:
            missing = columns[int(blank[row].argmax())]
            said = f"{missing}: found nothing; expected all of {', '.join(columns)}, or none"
            raise VfoaError(f"{self.where(int(row))}: {said}")
        return found


def read_columns(path: Path, columns: Sequence[str], required: Sequence[str]) -> TableColumns:
    """Read the columns of a table; parameters and errors are those of ``strict_tables.read_rows``."""
    rows = checked_rows(path, columns, required)
    _, header = next(rows)
    lines: list[int] = []
    cells: list[list[str]] = []
    for line, row in rows:
        lines.append(line)
        cells.append(row)
    by_column = zip(*cells, strict=True) if cells else ((),) * len(header)
    return TableColumns(path=path, lines=tuple(lines), cells=dict(zip(header, by_column, strict=True)))
