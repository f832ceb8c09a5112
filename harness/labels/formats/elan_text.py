"""ELAN's tab-delimited text, also as CSV: a row for each annotation, with its tier, its times and its value.

Without column headers, a row has the tier, the participant, the times and the value. With a column for each tier, there
are column headers, ``Begin Time - hh:mm:ss.ms`` in ELAN's language, and a row has the values of the tiers at its times.
Of each unit of time, the columns are begin, end and duration. Lines ``"#ADDRESS -- offset: MS"`` name the films, also
with ``, duration: ..., ms per sample: ...`` at the end. The forms are those of ELAN's own writer
(``ExportTabdelimited``; read, not used).

A time code (SMPTE, ``hh:mm:ss:ff``) is that of the frame at a time, at the rate that its column's header names: PAL,
PAL at 50 fps, or NTSC with dropped numbers. It is read where there is no exact time, as the begin of its frame.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from harness.files.dialects import Row, table_text
from vfoa.errors import VfoaError

_TO_TICK = "in ELAN's export, tick Begin Time and End Time as hh:mm:ss.ms"
_FILM = re.compile(r'"?#.* -- offset: (-?[0-9]+)(?:, .*)?"?')
_CLOCK = re.compile(r"([0-9]{1,4}):([0-5][0-9]):([0-5][0-9](?:\.[0-9]{1,3})?)")
_DECIMAL = re.compile(r"[0-9]{1,9}\.[0-9]{1,6}")
_CODE = re.compile(r"([0-9]{1,4}):([0-5][0-9]):([0-5][0-9])[:;]([0-9]{2})")
_WHOLE = re.compile(r"[0-9]{1,12}")
_ROUNDED_MS, _FRAME_MS = 2, 42
"""What a duration may differ from end minus begin: of exact times, and of time codes, which lose part of a frame."""


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


def _code_ms(cell: str, *, rate: float) -> int | None:
    """The time at which a time code's frame begins, at one of :data:`_RATES`; 29.97 has NTSC's dropped numbers."""
    if (found := _CODE.fullmatch(cell)) is None:
        return None
    hours, minutes, seconds, frame = map(int, found.groups())
    nominal, minutes = math.ceil(rate), 60 * hours + minutes
    dropped = 2 * (minutes - minutes // 10) if nominal == 30 else 0
    is_dropped = dropped and seconds == 0 and frame < 2 and minutes % 10
    if frame >= nominal or is_dropped:
        return None
    return math.floor((nominal * (60 * minutes + seconds) + frame - dropped) * 1000 / rate)


Parse = Callable[[str], int | None]

_EXACT: tuple[tuple[str, Parse], ...] = (
    (r" - hh:mm:ss\.ms$", _clock_ms),
    (r" - ss\.msec$", _seconds_ms),
    (r" - msec$", _whole_ms),
)
_RATES = (25.0, 50.0, 29.97)
_CODES: tuple[tuple[str, Parse], ...] = tuple(
    (rf" - [^\t,]*\b{standard}\b", partial(_code_ms, rate=rate))
    for standard, rate in zip((r"PAL(?!\W?50)", r"PAL\W?50(fps)?", "NTSC"), _RATES, strict=True)
)
_UNITS = _EXACT + _CODES
"""Patterns of the names of columns of times, in every language and in the order of ELAN, and what they hold."""


def is_elan_text(head: bytes) -> bool:
    """Whether a file that begins with these bytes may be ELAN's text, and not a document (XML)."""
    head = head.replace(b"\0", b"")  # UTF-16
    is_xml = head.lstrip(b"\xef\xbb\xbf\xff\xfe \r\n\t").startswith(b"<")
    cells = re.split(r'[,\r\n"]', head.decode(errors="replace"))
    return not is_xml and (b"\t" in head or any(map(_is_time, cells)))


def _is_time(name: str) -> bool:
    """Whether a column of this name holds times."""
    return any(re.search(unit, name) for unit, _ in _UNITS)


def read_elan_text(path: Path, *, has_offset: bool, fps: float | None) -> list[TextAnnotation]:
    """Return all annotations, in order; ``has_offset``: the user says where the clip begins in their times.

    ``fps`` is the rate of time codes without a header, frames per second.

    Raises
    ------
    VfoaError
        If it has no begin and end of annotations, or no tiers, or a film has an offset, which the times may include, or
        time codes of an unknown rate.
    """
    lines = re.split(r"\r\n?|\n", table_text(path))
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
    if any(map(_is_time, names)):
        return _with_headers(path, names, rows[1:])
    return _without_headers(path, rows, fps)


def _with_headers(path: Path, names: Sequence[str], rows: Sequence[Row]) -> list[TextAnnotation]:
    by_unit = [(parse, [place for place, name in enumerate(names) if re.search(unit, name)]) for unit, parse in _UNITS]
    parse, columns = next(((parse, places) for parse, places in by_unit if len(places) > 1), (_whole_ms, []))
    if not columns or names[columns[1]].startswith("Duration"):
        raise VfoaError(f"{path}: columns {', '.join(map(repr, names))}; expected begin and end: {_TO_TICK}")
    tiers = {place: name for place, name in enumerate(names) if name and " - " not in name}
    times = _times(path, rows, columns, parse)
    return [
        TextAnnotation(tier, *time, cells[place])
        for (_, cells), time in zip(rows, times, strict=True)
        for place, tier in tiers.items()
        if place < len(cells) and cells[place]
    ]


def _without_headers(path: Path, rows: Sequence[Row], fps: float | None) -> list[TextAnnotation]:
    narrowest = min(len(cells) for _, cells in rows)
    codes = [(rate, parse) for rate, (_, parse) in zip(_RATES, _CODES, strict=True)]
    for rate, parse in [*((None, parse) for _, parse in _EXACT), *codes]:
        columns = [place for place in range(narrowest) if all(parse(cells[place]) is not None for _, cells in rows)]
        if len(columns) > 1 and rate in (None, fps):
            break
    else:
        line, cells = rows[0]
        if sum(_CODE.fullmatch(cell) is not None for cell in cells) > 1:
            raise VfoaError(
                f"{path}:{line}: time codes (hh:mm:ss:ff) of a rate that no header states; "
                f"expected --fps 25 (PAL), 50 or 29.97 (NTSC), the rate of the film, or exact times: {_TO_TICK}"
            )
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


def _times(path: Path, rows: Sequence[Row], columns: Sequence[int], parse: Parse) -> list[tuple[int, int]]:
    """Begin and end of each row, ms; if there is a third column, it is the duration."""
    times = []
    rounded_ms = _ROUNDED_MS if parse in [exact for _, exact in _EXACT] else _FRAME_MS
    for line, cells in rows:
        found = [parse(cells[place]) if place < len(cells) else None for place in columns[:3]]
        start, end = found[:2]
        if start is None or end is None:
            raise VfoaError(f"{path}:{line}: found {cells[:6]}; expected begin and end: {_TO_TICK}")
        duration = found[2] if len(found) > 2 else None
        if end < start or (duration is not None and abs(end - start - duration) > rounded_ms):
            raise VfoaError(f"{path}:{line}: found the times {found} ms; expected begin, end and duration: {_TO_TICK}")
        times.append((start, end))
    return times
