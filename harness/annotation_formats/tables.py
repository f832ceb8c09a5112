"""Tables that other programs write as CSV or TSV: rows by column name, with their line."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path

from harness.annotations.timeline import parse_seconds
from harness.files import read_text
from vfoa.errors import VfoaError


def csv_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of every row that is not empty: commas, or tabs where the first line has one.

    Raises
    ------
    VfoaError
        If the file is not such text.
    """
    text = read_text(path)
    delimiter = "\t" if "\t" in text.lstrip().partition("\n")[0] else ","
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        for row in reader:
            if any(row):
                yield reader.line_num, row
    except csv.Error as error:
        raise VfoaError(f"{path}:{reader.line_num}: not CSV: {error}") from None


def read_table(path: Path, required: Sequence[str]) -> Iterator[tuple[int, dict[str, str]]]:
    """Line and cells by column of every row below the header: the first row that holds all ``required`` columns.

    What stands above the header is passed over. A short row has empty cells at its end.

    Raises
    ------
    VfoaError
        If the file is not text, or has no such header.
    """
    header: list[str] | None = None
    for line, row in csv_rows(path):
        if header is not None:
            yield line, dict(zip_longest(header, row[: len(header)], fillvalue=""))
        elif set(required) <= set(row):
            header = row
    if header is None:
        raise VfoaError(f"{path}: no header with the columns {', '.join(required)}")


def milliseconds(row: dict[str, str], column: str, where: str) -> int:
    """A cell of decimal seconds in ms.

    Raises
    ------
    VfoaError
        If it is none.
    """
    time_ns = parse_seconds(row.get(column, ""))
    if time_ns is None:
        raise VfoaError(f"{where}: {column}: found {row.get(column, '')!r}; expected seconds, such as 12.500")
    return (time_ns + 500_000) // 1_000_000
