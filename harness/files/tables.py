"""CSV tables with a header. A blank cell is an unknown value.

Tables with a version are read strictly, also as a spreadsheet program saves them; others in any dialect of
:mod:`harness.files.dialects`, their columns in capitals or not.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness.files.dialects import (
    Row,
    are_booleans,
    check_width,
    csv_lines,
    is_missing,
    number_hint,
    separator_of,
    table_rows,
    with_decimal_point,
)
from harness.files.garbage import collected_later
from harness.files.io import atomic_write, read_text
from vfoa.errors import VfoaError, did_you_mean
from vfoa.types import Float

_INTEGER = re.compile(r"-?[0-9]{1,19}")
_DIGITS = 19
"""Most digits of a whole number of 64 bits."""

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_NUMERALS = frozenset("0123456789+-.eE")
"""The characters of numbers: what Python takes for a number of these alone is one of :data:`_NUMBER`, too."""


LARGEST = 1e6
"""Greatest coordinate and size in metres or pixels; squares of much greater ones are infinite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TableColumns:
    """The cells of a table by column, stripped; "" is a blank one."""

    path: Path
    lines: tuple[int, ...]
    cells: Mapping[str, tuple[str, ...]]

    def where(self, row: int) -> str:
        """The place of a row for messages."""
        return f"{self.path}:{self.lines[row]}"

    def integers(self, column: str) -> NDArray[np.int64]:
        """The whole numbers (n,) of a required column.

        Raises
        ------
        VfoaError
            For the first cell that is blank, or no whole number of 64 bits.
        """
        values = [_whole_number_or_float(cell) for cell in self.cells[column]]
        self._refuse_none(column, values, "a whole number of 64 bits")
        return np.array(values, dtype=np.int64)

    def integers_or_none(self, column: str) -> list[int | None]:
        """The whole numbers (n,) of a column, None where a cell is blank; all None without the column.

        Raises
        ------
        VfoaError
            For the first cell that is not a whole number of 64 bits.
        """
        cells = self.cells.get(column, ("",) * len(self.lines))
        values = [None if is_missing(cell) else _whole_number_or_float(cell) for cell in cells]
        for row, (cell, value) in enumerate(zip(cells, values, strict=True)):
            if value is None and not is_missing(cell):
                self._refuse(row, column, cell, "a whole number of 64 bits")
        return values

    def numbers(self, column: str) -> Float:
        """The numbers (n,) of a column, NaN where a cell is blank; all NaN without the column.

        Raises
        ------
        VfoaError
            For the first cell that is not a finite number.
        """
        cells = self.cells.get(column, ())
        if not any(cells):
            return np.broadcast_to(np.float64(np.nan), len(self.lines))
        if (plain := _plain_numbers(cells)) is not None:
            return plain
        values = [math.nan if is_missing(cell) else _finite_number(cell) for cell in cells]
        self._refuse_none(column, values, "a finite number")
        return np.array(values, dtype=np.float64)

    def _refuse_none(self, column: str, values: Sequence[float | None], expected: str) -> None:
        """Reject the first cell without a value."""
        if None in values:
            row = values.index(None)
            self._refuse(row, column, self.cells[column][row], expected)

    def _refuse(self, row: int, column: str, cell: str, expected: str) -> NoReturn:
        raise VfoaError(f"{self.where(row)}: {column}: expected {expected}, {found(cell)}{number_hint(cell)}")

    def vectors(self, columns: Sequence[str]) -> Float:
        """The coordinates (n, columns) of :meth:`group`, each at most :data:`LARGEST`.

        Raises
        ------
        VfoaError
            For the first row with a greater one, or as :meth:`group`.
        """
        values, named = self.group(columns), ", ".join(columns)
        self.refuse_first(
            (np.abs(values) > LARGEST).any(axis=1),
            lambda row: f"{named}: found {values[row]}; expected at most {LARGEST:g}",
        )
        return values

    def group(self, columns: Sequence[str]) -> Float:
        """The numbers (n, columns) of columns that belong together, NaN in rows where all of them are blank.

        Raises
        ------
        VfoaError
            For the first row where only some are blank, or as :meth:`numbers`.
        """
        values = np.stack([self.numbers(column) for column in columns], axis=1)
        blank = np.isnan(values)

        def why(row: int) -> str:
            missing = columns[int(blank[row].argmax())]
            cell = self.cells[missing][row] if missing in self.cells else ""
            return f"{missing}: {found(cell)}; expected all of {', '.join(columns)}, or none"

        self.refuse_first(blank.any(axis=1) & ~blank.all(axis=1), why)
        return values

    def refuse_first(self, wrong: ArrayLike, why: Callable[[int], str]) -> None:
        """Raise a :class:`VfoaError` with the place of the first row that is ``wrong`` (n,), and why; if any is."""
        for row in np.flatnonzero(wrong)[:1].tolist():
            raise VfoaError(f"{self.where(row)}: {why(row)}")

    def refuse_repeated(self, names: Iterable[str | None]) -> None:
        """Raise a :class:`VfoaError` for the first row whose name an earlier row has; None is no name."""
        first: dict[str, int] = {}
        for row, name in enumerate(names):
            if name is not None and (before := first.setdefault(name, row)) != row:
                raise VfoaError(f"{self.where(row)}: {name}: occurs twice, first at {self.where(before)}")


def found(cell: str) -> str:
    """The cell, for a message."""
    return f"found {cell!r}" if cell else "found nothing"


def read_columns(
    path: Path,
    columns: Sequence[str] | None,
    required: Sequence[str],
    *,
    known: Sequence[str] = (),
    version: str | None = None,
) -> TableColumns:
    """Read the columns of a table; blank lines are left out.

    Parameters
    ----------
    columns
        Every column that the table may have, in any order; None: any.
    required
        Columns that it must have.
    known
        Further columns that may be written in capitals, where any are allowed.
    version
        The first line of a CSV file whose format has a version, above the header.

    Raises
    ------
    VfoaError
        For the first error, with file and line: a column that is unknown, missing or repeated, or a wrong number of
        cells.
    """
    with collected_later():
        rows = _checked_rows(path, columns, required, version, known)
        _, header = next(rows)
        numbered = list(rows)
        by_column = zip(*(cells for _, cells in numbered), strict=True) if numbered else ((),) * len(header)
        lines = tuple(line for line, _ in numbered)
        return TableColumns(path=path, lines=lines, cells=dict(zip(header, by_column, strict=True)))


def read_header(path: Path) -> tuple[str, ...]:
    """The names in the header of a table; empty if the file cannot be read as one."""
    try:
        return tuple(next((header for _, header in table_rows(path)), ()))
    except VfoaError:
        return ()


def header_names(path: Path) -> frozenset[str]:
    """The names in the first line of a CSV file, without reading the rest; none of any other file."""
    try:
        if path.suffix.lower() != ".csv" or not path.is_file():
            return frozenset()
        with path.open(encoding="utf-8-sig") as file:
            return frozenset(name.strip() for name in file.readline(2**16).split(","))
    except (OSError, UnicodeDecodeError):
        return frozenset()


def write_rows(path: Path, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Write a CSV table atomically: floats are exact, None is a blank."""
    atomic_write(path, format_rows(columns, rows))


def format_rows(columns: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """The text of a CSV table."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()


def _checked_rows(
    path: Path,
    columns: Sequence[str] | None,
    required: Sequence[str],
    version: str | None,
    known: Sequence[str] = (),
) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of the header, then of each row."""
    rows = table_rows(path) if version is None else _strict_rows(path, version)
    if not rows:
        raise VfoaError(f"{path}:1: no header; expected {','.join(required)},...")
    (line, header), *rows = rows
    header = _known_names(header, (*required, *known) if columns is None else columns)
    columns = header if columns is None else columns
    _check_flags(header, columns, rows, f"{path}:{line}")
    yield line, _checked_header(header, columns, required, f"{path}:{line}")
    for line, cells in rows:
        check_width(cells, header, f"{path}:{line}", _COMMAS if len(cells) > len(header) else "")
        yield line, cells


_COMMAS = "; decimal commas need semicolons between cells, and row names of R need a column name"


def _strict_rows(path: Path, version: str) -> list[Row]:
    return [(line, [cell.strip() for cell in cells]) for line, cells in csv_rows(path, version)]


def _known_names(header: Sequence[str], columns: Sequence[str]) -> list[str]:
    """The names of a header as ``columns`` have them: in capitals they are the same columns."""
    lower = {column.lower(): column for column in columns}
    return [name if name in columns else lower.get(name.lower(), name) for name in header]


def _check_flags(header: Sequence[str], columns: Sequence[str], rows: Sequence[Row], where: str) -> None:
    """Reject a column of True and False, which may say that a row is not to be used."""
    for place, name in enumerate(header):
        if name not in columns and are_booleans(cells[place] for _, cells in rows if place < len(cells)):
            raise VfoaError(
                f"{where}: the column {name!r} holds True and False, which may mark rows that do not count and is not "
                "read; delete it, and leave the values of such rows blank"
            )


def whole_number(cell: str) -> int | None:
    """The whole number in a cell, as a frame number is; None if the cell is not one of 64 bits."""
    return int(cell) if _INTEGER.fullmatch(cell) and abs(int(cell)) < 2**63 else None


def _whole_number_or_float(cell: str) -> int | None:
    """As :func:`whole_number`, also of ``12.0`` or ``1.2e+01``, if all digits before the point are written."""
    if (value := whole_number(cell)) is not None or not _NUMBER.fullmatch(cell):
        return value
    exact = Decimal(cell)
    if exact.is_zero():
        return 0
    _, _, exponent = exact.as_tuple()
    if not isinstance(exponent, int) or exponent > 0 or not 0 <= exact.adjusted() < _DIGITS:
        return None
    return int(exact) if exact == exact.to_integral_value() and abs(exact) < 2**63 else None


def _plain_numbers(cells: Sequence[str]) -> Float | None:
    """The numbers (n,) of cells that hold finite numbers and blanks alone, checked all at once; else None."""
    if not _NUMERALS.issuperset("".join(cells)):
        return None
    try:
        numbers = np.array([float(cell) if cell else math.nan for cell in cells])
    except ValueError:
        return None
    return None if np.isinf(numbers).any() else numbers


def _finite_number(cell: str) -> float | None:
    """The number in a cell; None if the cell is not a finite number."""
    if not _NUMBER.fullmatch(cell):
        return None
    number = float(cell)
    return number if math.isfinite(number) else None


def csv_rows(path: Path, version: str | None = None, instead: str = "") -> Iterator[tuple[int, list[str]]]:
    """Line and cells of every line that is not blank, the header first, below the line of the format's version.

    A file with a version may have been saved by a spreadsheet program: with semicolons or tabs between its cells, blank
    cells at the ends of its lines, and decimal commas in columns of seconds and pixels. ``instead`` is what to do with
    a table that has no such line.

    Raises
    ------
    VfoaError
        If the file cannot be read, is not CSV (with the line), or has another version.
    """
    text, above = read_text(path), 0
    if version is not None:
        first, _, text = text.partition("\n")
        above = 1
        if not re.fullmatch(rf'("?){re.escape(version)}\1[,;\t]*', first.rstrip("\r")):
            hint = "" if first.startswith("#") else instead
            raise VfoaError(f"{path}:1: found {first.rstrip()[:80]!r}; expected {version!r}{hint}")
    rows = csv_lines(text, path, above, "," if version is None else separator_of(text, ",;\t", ","))
    yield from rows if version is None else _plain_cells(rows)


_UNITS = ("_s", "_px")
"""Ends of the names of columns with decimal numbers."""


def _plain_cells(rows: Iterator[Row]) -> Iterator[Row]:
    """The rows that have any content, without blank cells beyond those of the header and without decimal commas."""
    width, measured = 0, set[int]()
    for line, cells in rows:
        while len(cells) > width and not cells[-1]:
            cells.pop()
        if not width:
            width = len(cells)
            measured = {place for place, name in enumerate(cells) if name.endswith(_UNITS)}
        if any(cells):
            yield line, [with_decimal_point(cell) if place in measured else cell for place, cell in enumerate(cells)]


def _checked_header(header: list[str], known: Sequence[str], required: Sequence[str], where: str) -> list[str]:
    if unknown := next((column for column in header if column not in known), None):
        raise VfoaError(f"{where}: no column {unknown!r} here; {did_you_mean(unknown, known)}")
    if twice := next((column for column in header if header.count(column) > 1), None):
        raise VfoaError(f"{where}: the column {twice!r} occurs twice")
    if missing := next((column for column in required if column not in header), None):
        raise VfoaError(f"{where}: no column {missing!r}; expected {','.join(required)},...")
    return header
