"""ELAN's tab-delimited text, also as CSV: a row for each annotation, with its tier, its times and its value.

Without column headers, a row has the tier, the participant, the times and the value. With a column for each tier, there
are column headers, ``Begin Time - hh:mm:ss.ms`` in ELAN's language, and a row has the values of the tiers at its times.
Of each unit of time, the columns are begin, end and duration. Lines ``"#ADDRESS -- offset: MS"`` name the films. The
forms are those of ELAN's own writer (``ExportTabdelimited``; read, not used).
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from harness.files.dialects import Row, table_text
from vfoa.errors import VfoaError

_TO_TICK = "in ELAN's export, tick Begin Time and End Time as hh:mm:ss.ms"
_FILM = re.compile(r'"?#.* -- offset: (-?[0-9]+)"?')
_CLOCK = re.compile(r"([0-9]{1,4}):([0-5][0-9]):([0-5][0-9](?:\.[0-9]{1,3})?)")
_DECIMAL = re.compile(r"[0-9]{1,9}\.[0-9]{1,6}")
_WHOLE = re.compile(r"[0-9]{1,12}")
_ROUNDED_MS = 2


class TextAnnotation(NamedTuple):
    """An annotation of a tier between two times, ms."""

    tier: str
    start_ms: int
    end_ms: int
    value: str


def _clock_ms(cell: str) -> int | None:
    found = _CLOCK.fullmatch(cell)
    return found and round(1000 * (3600 * int(found[1]) + 60 * int(found[2]) + float(found[3])))


def _seconds_ms(cell: str) -> int | None:
    return round(1000 * float(cell)) if _DECIMAL.fullmatch(cell) else None


def _whole_ms(cell: str) -> int | None:
    return int(cell) if _WHOLE.fullmatch(cell) else None


_UNITS: dict[str, Callable[[str], int | None]] = {
    " - hh:mm:ss.ms": _clock_ms,
    " - ss.msec": _seconds_ms,
    " - msec": _whole_ms,
}
"""The ends of the names of columns of times, in every language and in the order of ELAN."""


def is_elan_text(head: bytes) -> bool:
    """Whether a file that begins with these bytes may be ELAN's text, and not a document (XML)."""
    head = head.replace(b"\0", b"")  # UTF-16
    is_xml = head.lstrip(b"\xef\xbb\xbf\xff\xfe \r\n\t").startswith(b"<")
    return not is_xml and (b"\t" in head or any(unit.encode() in head for unit in _UNITS))


def read_elan_text(path: Path, *, has_offset: bool) -> list[TextAnnotation]:
    """Return all annotations, in order; ``has_offset``: the user says where the clip begins in their times.

    Raises
    ------
    VfoaError
        If it has no begin and end of annotations, or no tiers, or a film has an offset, which the times may include.
    """
    lines = table_text(path).splitlines()
    first = next((line for line in lines if line.strip() and not line.lstrip('"').startswith("#")), "")
    reader = csv.reader(lines, delimiter="\t", quoting=csv.QUOTE_NONE) if "\t" in first else csv.reader(lines)
    rows: list[Row] = []
    try:
        for cells in reader:
            line = lines[reader.line_num - 1]
            if film := _FILM.fullmatch(line.strip()):
                if int(film[1]) and not has_offset:
                    raise VfoaError(
                        f"{path}:{reader.line_num}: a film with an offset of {film[1]} ms, which the times may hold; "
                        "expected --offset SECONDS, where the clip begins in them, or the .eaf document"
                    )
            elif any(cell.strip() for cell in cells) and not line.lstrip('"').startswith("#"):
                rows.append((reader.line_num, [cell.strip() for cell in cells]))
    except csv.Error as error:
        raise VfoaError(f"{path}:{reader.line_num}: not CSV: {error}") from None
    if not rows:
        return []
    names = rows[0][1]
    if any(name.endswith(tuple(_UNITS)) for name in names):
        return _with_headers(path, names, rows[1:])
    return _without_headers(path, rows)


def _with_headers(path: Path, names: Sequence[str], rows: Sequence[Row]) -> list[TextAnnotation]:
    by_unit = {unit: [place for place, name in enumerate(names) if name.endswith(unit)] for unit in _UNITS}
    unit, columns = next(((unit, places) for unit, places in by_unit.items() if len(places) > 1), ("", []))
    if not columns or names[columns[1]].startswith("Duration"):
        raise VfoaError(f"{path}: columns {', '.join(map(repr, names))}; expected begin and end: {_TO_TICK}")
    tiers = {place: name for place, name in enumerate(names) if name and " - " not in name}
    times = _times(path, rows, columns, _UNITS[unit])
    return [
        TextAnnotation(tier, *time, cells[place])
        for (_, cells), time in zip(rows, times, strict=True)
        for place, tier in tiers.items()
        if place < len(cells) and cells[place]
    ]


def _without_headers(path: Path, rows: Sequence[Row]) -> list[TextAnnotation]:
    narrowest = min(len(cells) for _, cells in rows)
    for parse in _UNITS.values():
        columns = [place for place in range(narrowest) if all(parse(cells[place]) is not None for _, cells in rows)]
        if len(columns) > 1:
            break
    else:
        raise VfoaError(f"{path}: no two columns of times; expected begin and end: {_TO_TICK}")
    if columns[0] == 0:
        raise VfoaError(f"{path}: no column of tiers before the times; expected it: clear Exclude tier names")
    units = columns[1] - columns[0]  # the begin in each unit, then the end, then the duration
    columns = [place for place in (columns[0] + kind * units for kind in range(3)) if place in columns]
    value = columns[-1] + units
    times = _times(path, rows, columns, parse)
    return [
        TextAnnotation(cells[0], *time, cells[value] if value < len(cells) else "")
        for (_, cells), time in zip(rows, times, strict=True)
    ]


def _times(
    path: Path, rows: Sequence[Row], columns: Sequence[int], parse: Callable[[str], int | None]
) -> list[tuple[int, int]]:
    """Begin and end of each row, ms; if there is a third column, it is the duration."""
    times = []
    for line, cells in rows:
        found = [parse(cells[place]) if place < len(cells) else None for place in columns[:3]]
        start, end = found[:2]
        if start is None or end is None:
            raise VfoaError(f"{path}:{line}: found {cells[:6]}; expected begin and end: {_TO_TICK}")
        duration = found[2] if len(found) > 2 else None
        if end < start or (duration is not None and abs(end - start - duration) > _ROUNDED_MS):
            raise VfoaError(f"{path}:{line}: times {found} ms; expected begin, end and duration: {_TO_TICK}")
        times.append((start, end))
    return times
