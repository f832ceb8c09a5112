"""Tables of other programs in CSV, TSV or XLSX: rows by column name, with their line numbers."""

from __future__ import annotations

import csv
import io
import warnings
from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path

from harness.files.io import read_bytes, read_text
from harness.files.parsing import check_archive
from harness.labels.timeline import parse_seconds
from vfoa.errors import VfoaError

_ZIP = b"PK\x03\x04"
"""A workbook is a ZIP archive."""


def _csv_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """The rows of a text; separated by tabs if the first line has one, else by commas."""
    text = read_text(path)
    delimiter = "\t" if "\t" in text.lstrip().partition("\n")[0] else ","
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        for row in reader:
            if any(row):
                yield reader.line_num, row
    except csv.Error as error:
        raise VfoaError(f"{path}:{reader.line_num}: not CSV: {error}") from None


def rows_of(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of every row that is not empty, of a text table or of the first sheet of an ``.xlsx``.

    Raises
    ------
    VfoaError
        If the file is neither.
    """
    data = read_bytes(path)
    yield from _workbook_rows(data, path) if data.startswith(_ZIP) else _csv_rows(path)


def _workbook_rows(data: bytes, path: Path) -> Iterator[tuple[int, list[str]]]:
    from openpyxl import load_workbook

    check_archive(data, path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # openpyxl warns about content that it ignores: styles, extensions
            book = load_workbook(io.BytesIO(data), read_only=True, data_only=True)
            rows = [[_cell(each) for each in row] for row in book.worksheets[0].iter_rows(values_only=True)]
            book.close()
    except Exception as error:  # errors of openpyxl, and of the ZIP, XML and dates that it reads
        raise VfoaError(f"{path}: not a workbook that can be read: {error}") from None
    yield from ((line, cells) for line, cells in enumerate(rows, start=1) if any(cells))


def _cell(value: object) -> str:
    """A cell as text; numbers as decimals without an exponent, to the microsecond if they are seconds."""
    if isinstance(value, float):
        return f"{value:.6f}".rstrip("0").rstrip(".")
    return "" if value is None else str(value)


def read_table(
    rows: Iterable[tuple[int, list[str]]], required: Sequence[str], path: Path
) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield line and cells by column of every row below the header, the first row with all ``required`` columns.

    Lines above the header are skipped. A short row has empty cells at its end.

    Raises
    ------
    VfoaError
        If there is no such header.
    """
    header: list[str] | None = None
    for line, row in rows:
        if header is not None:
            yield line, dict(zip_longest(header, row[: len(header)], fillvalue=""))
        elif set(required) <= set(row):
            header = row
    if header is None:
        raise VfoaError(f"{path}: no header with the columns {', '.join(required)}")


def milliseconds(row: dict[str, str], column: str, where: str) -> int:
    """Parse a cell of decimal seconds as ms.

    Raises
    ------
    VfoaError
        If it holds anything else.
    """
    time_ns = parse_seconds(row.get(column, ""))
    if time_ns is None:
        raise VfoaError(f"{where}: {column}: found {row.get(column, '')!r}; expected seconds, such as 12.500")
    return (time_ns + 500_000) // 1_000_000
