"""Tables as spreadsheets, pandas, NumPy and R write them, as the rows of a plain CSV.

Read: UTF-8, or UTF-16 with or without a byte-order mark; cells separated by commas, semicolons, tabs, bars or blanks;
Excel's first line ``sep=;``; NumPy's ``#`` before the header, and comments above it, which begin with ``#``; decimal
commas where another sign separates cells; a nameless first column of row numbers (pandas' index, R's row names); blank
cells at the ends of rows; rows without any content. A cell of
:data:`MISSING` is an unknown value where a number is expected.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from harness.files.io import read_bytes
from harness.files.safe_names import composed
from vfoa.errors import VfoaError

Row = tuple[int, list[str]]
"""A line's number in the file, and its cells, stripped."""

MISSING = frozenset({"nan", "-nan", "na", "n/a", "<na>", "#n/a", "#nv", "nat", "none", "null"})
"""What programs write for a value that is missing, in lower case."""

_SEPARATORS = (",", ";", "\t", "|")
_SEPARATOR_LINE = re.compile(r'"?sep=([,;|\t])"?[ ,;]*(\r\n|\n|\r)', re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?[0-9]*,[0-9]+([eE][+-]?[0-9]+)?")
_DECIMAL_POINT = re.compile(r"[+-]?[0-9]*\.[0-9]+([eE][+-]?[0-9]+)?")
_ROW_NUMBER = re.compile(r"[0-9]{1,18}")
_BOOLEANS = frozenset({"true", "false"})
_MOST_SHARED = 100_000
"""Most different cells of a table that are remembered, so that numbers with all digits do not fill the memory."""
_WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
_ENCODINGS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


def is_missing(cell: str) -> bool:
    """Whether a cell holds no value: it is blank, or one of :data:`MISSING`."""
    return not cell or cell.lower() in MISSING


def are_booleans(cells: Iterable[str]) -> bool:
    """Whether cells hold True and False, and nothing else but blanks."""
    words = {cell.lower() for cell in cells if not is_missing(cell)}
    return bool(words) and words <= _BOOLEANS


def with_decimal_point(cell: str) -> str:
    """A number with a decimal comma with a point; any other cell as it is."""
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def number_hint(cell: str) -> str:
    """What a program did to a cell that is not the expected number, and its option; "" if that is not known."""
    if _DECIMAL_COMMA.fullmatch(cell):
        return ' (a comma in a number; expected a decimal point: decimal="." in pandas, dec = "." in R)'
    if re.fullmatch(r"[+-]?[0-9]+(\.[0-9]+)?[eE]\+?[0-9]+", cell):
        return " (digits were cut off: format the column as a number without decimals; no float_format in pandas)"
    return ""


def table_rows(path: Path) -> list[Row]:
    """Return line and cells of each row that has any content, the header first.

    Raises
    ------
    VfoaError
        If the file cannot be read or is not a table (with the line), if numbers have decimal commas and decimal points,
        or a column with content has no name.
    """
    text = table_text(path)
    if stated := _SEPARATOR_LINE.match(text):
        text, above, separator = text[stated.end() :], 1, stated[1]
    else:
        text, above = _without_comments(text)
        separator = separator_of(text, _SEPARATORS, " ")
    lines = csv_lines(text, path, above, separator, skips_blanks=separator != " ")
    shared: dict[str, str] = {}
    rows = [(line, _shared(stripped, shared)) for line, cells in lines if any(stripped := [*map(str.strip, cells)])]
    if rows:
        (line, header), *below = rows
        rows = [(line, _drop_columns(path, line, _names(header, below, separator), below)), *below]
        if separator != ",":
            _read_decimal_commas(path, below)
    return rows


def _shared(cells: list[str], known: dict[str, str]) -> list[str]:
    """The cells, as one string where they are equal: a long table has the same names and sizes in each of its rows."""
    share = known.setdefault if len(known) < _MOST_SHARED else known.get
    return [*map(share, cells, cells)]


def _without_comments(text: str) -> tuple[str, int]:
    """The text from its header on, and the number of lines above it, which begin with ``#``.

    The last of these is itself the header if it has as many cells as the line below it: NumPy writes it so.
    """
    if not text.lstrip("\r\n").startswith("#"):
        return text, 0
    lines = text.splitlines(keepends=True)
    n_above = next((place for place, line in enumerate(lines) if line.strip("\r\n") and line[0] != "#"), 0)
    if n_above == 0:
        return text, 0
    separator = separator_of(lines[n_above], _SEPARATORS, " ")
    last, below = (
        line.strip("# \r\n").split(None if separator == " " else separator) for line in lines[n_above - 1 : n_above + 1]
    )
    n_above -= len(last) == len(below)
    return "".join(lines[n_above:]), n_above


def check_width(cells: Sequence[str], header: Sequence[str], where: str, hint: str = "") -> None:
    """Raise a :class:`VfoaError`, which ends with ``hint``, if a row is not as long as the header."""
    if len(cells) != len(header):
        raise VfoaError(f"{where}: found {len(cells)} cells; expected {len(header)}, as in the header{hint}")


def plain_name(name: str) -> str:
    """The name of a column in small letters and digits, with ``_`` for everything between them; micro's sign is u."""
    return re.sub(r"[^a-z0-9]+", "_", re.sub("[\u00b5\u03bc]", "u", name.lower())).strip("_")


def table_text(path: Path) -> str:
    """The text of a table, decoded.

    Raises
    ------
    VfoaError
        If the file cannot be read, is a workbook, or is not text.
    """
    content = read_bytes(path)
    if content.startswith(_WORKBOOKS):
        raise VfoaError(f"{path}: a workbook of a spreadsheet program; expected CSV: 'CSV UTF-8' in Excel's Save As")
    encoding = next((name for mark, name in _ENCODINGS if content.startswith(mark)), "utf-8-sig")
    if encoding == "utf-8-sig" and len(content) > 1 and (content[0] == 0) != (content[1] == 0):
        encoding = "utf-16-be" if content[0] == 0 else "utf-16-le"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        found = f"not {encoding.removesuffix('-sig').upper()} text: found byte {error.object[error.start]:#04x}"
        raise VfoaError(
            f"{path}:{line}: {found}; expected UTF-8: 'CSV UTF-8' in Excel's Save As, encoding=\"utf-8\" in Python, "
            'fileEncoding = "UTF-8" in R'
        ) from None


def separator_of(text: str, known: Sequence[str], otherwise: str) -> str:
    """The sign that separates the cells of a text's first line: the most frequent of the ``known`` ones."""
    header = text.lstrip("\r\n").partition("\n")[0]
    most = max(known, key=header.count)
    return most if most in header else otherwise


def csv_lines(
    text: str, path: Path, above: int, separator: str, *, skips_blanks: bool = False
) -> Iterator[tuple[int, list[str]]]:
    """Line and cells of every line of a text that is not blank; ``above`` lines of the file precede it.

    Accents are in their letters (:func:`harness.files.safe_names.composed`): cells are names.
    ``skips_blanks``: blanks after a separator belong to no cell. A :class:`VfoaError` says what is not CSV.
    """
    reader = csv.reader(
        io.StringIO(composed(text), newline=""), delimiter=separator, skipinitialspace=skips_blanks, strict=True
    )
    try:
        for cells in reader:
            if cells:
                yield reader.line_num + above, cells
    except csv.Error as error:
        raise VfoaError(f"{path}:{reader.line_num + above}: not CSV: {error}") from None


def _names(header: list[str], rows: list[Row], separator: str) -> list[str]:
    """The names of the columns, "" for one without a name."""
    if header[0].startswith("#"):  # NumPy
        header = [name for name in (header[0].lstrip("# "), *header[1:]) if name]
    names = ["" if name.startswith("Unnamed: ") else name for name in header]  # pandas, of a table that it read
    # R names no column for the names of rows; with commas, a decimal comma makes rows longer, too
    is_longer = separator != "," and all(len(cells) == len(names) + 1 and cells[-1] for _, cells in rows)
    return ["", *names] if rows and is_longer else names


def _drop_columns(path: Path, line: int, names: list[str], rows: list[Row]) -> list[str]:
    """Drop row numbers and blank columns, which have no name, from the rows in place; return the names."""
    width = len(names)
    dropped = [place for place, name in enumerate(names) if not name]
    for place in dropped:
        is_index = place == 0 and all(_ROW_NUMBER.fullmatch(cells[0]) for _, cells in rows)
        content = ((number, cells[place]) for number, cells in rows if place < len(cells) and cells[place])
        if not is_index and (found := next(content, None)):
            raise VfoaError(
                f"{path}:{found[0]}: column {place + 1}: found {found[1]!r}, without a name in line {line}; "
                "expected a name, or no such column (index=False in pandas, row.names = FALSE in R)"
            )
    for _, cells in rows:
        while len(cells) > width and not cells[-1]:
            cells.pop()
        for place in reversed(dropped):
            del cells[place : place + 1]
    return [name for name in names if name]


def _read_decimal_commas(path: Path, rows: list[Row]) -> None:
    """Write numbers with a decimal comma with a point, in place."""
    commas = [(row, place) for row in rows for place, cell in enumerate(row[1]) if _DECIMAL_COMMA.fullmatch(cell)]
    if not commas:
        return
    for line, cells in rows:
        for cell in filter(_DECIMAL_POINT.fullmatch, cells):
            (first, first_cells), place = commas[0]
            raise VfoaError(
                f"{path}:{line}: found {cell!r}, and {first_cells[place]!r} in line {first}; expected one decimal "
                "separator in all numbers, and none between thousands"
            )
    for (_, cells), place in commas:
        cells[place] = with_decimal_point(cells[place])
