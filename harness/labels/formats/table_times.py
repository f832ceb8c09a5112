"""Times and numbers of frames in the cells of a table, and columns whose unit is probably another one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from harness.files.dialects import number_hint
from harness.files.tables import whole_number
from harness.labels.formats.exchange import Exchange
from vfoa.errors import VfoaError

Cells = tuple[str, Mapping[str, str]]
"""The place of a row, and its cells by column."""

MS_PER_UNIT = {"start_s": 1000.0, "start_ms": 1.0, "time_s": 1000.0, "time_ms": 1.0, "time_us": 1e-3}
_CLOCK = re.compile(r"(?:([0-9]{1,4}):)?([0-5]?[0-9]):([0-5]?[0-9](?:[.,][0-9]+)?)")
_NUMBER = re.compile(r"-?(?:[0-9]{1,16}(?:\.[0-9]*)?|\.[0-9]+)")

UNITS = ("s", "sec", "seconds", "ms", "us", "ns", "frame", "frames")
"""Last words of columns that name their unit."""
_LEAST_TIMES, _LEAST, _LEAST_SHARE, _MOST_SHARE = 5, 20, 0.2, 1.2


def check_unit(rows: Sequence[Cells], place: Sequence[str], exchange: Exchange, path: Path) -> None:
    """Reject seconds that are probably milliseconds, or frames: their column names no unit, and they fit as these.

    Raises
    ------
    VfoaError
        If times reach more than five times the clip's end, and in the other unit end near it.
    """
    cells = _numbers(rows, place)
    if place[0] not in ("start_s", "time_s") or not cells:
        return
    last, end_s = max(map(float, cells)), exchange.shown.times_ns[-1] / 1e9
    units = (
        ("milliseconds", 1000 * end_s, ("start_ms and end_ms", "time_ms")),
        ("frames", exchange.frames[-1], ("first_frame and last_frame", "frame")),
    )
    fit = [(unit, names) for unit, end, names in units if _LEAST_SHARE <= last / max(end, 1) <= _MOST_SHARE]
    if last > max(_LEAST_TIMES * end_s, _LEAST) and fit:
        unit, names = fit[0]
        raise VfoaError(
            f"{path}: {' and '.join(place)}: times reach {last:g} s, the clip ends at {end_s:g} s; expected seconds, "
            f"or columns called {names[len(place) == 1]} if they are {unit}"
        )


def check_milliseconds(rows: Sequence[Cells], place: Sequence[str], exchange: Exchange, path: Path) -> None:
    """Reject milliseconds with a point that are probably seconds, or whole ones with a point after the thousands.

    Raises
    ------
    VfoaError
        If there are some, and all times would end near the clip's end if they were a thousand times as long.
    """
    cells = _numbers(rows, place)
    if not (pointed := [cell for cell in cells if "." in cell]):
        return
    last, end_s = max(map(float, cells)), exchange.shown.times_ns[-1] / 1e9
    if _LEAST_SHARE <= last / max(end_s, 1) <= _MOST_SHARE:
        raise VfoaError(
            f"{path}: {' and '.join(place)}: found {pointed[0]!r}, and times that reach {last:g} ms of a clip of "
            f"{end_s:g} s; expected milliseconds without a thousands separator, or columns in seconds"
        )


def _numbers(rows: Sequence[Cells], place: Sequence[str]) -> list[str]:
    """The cells that say where rows hold, if all of them are numbers; else none."""
    found = [cells[column] for _, cells in rows for column in place]
    return found if all(map(_NUMBER.fullmatch, found)) else []


def time_ms_of(cell: str, where: str, *, unit_ms: float) -> float:
    """A time in milliseconds, of a number in a unit or ``h:mm:ss``; raises with its place."""
    if clock := _CLOCK.fullmatch(cell):
        hours, minutes, seconds = clock.groups()
        return 1000 * (3600 * int(hours or 0) + 60 * int(minutes) + float(seconds.replace(",", ".")))
    if not _NUMBER.fullmatch(cell):
        raise VfoaError(f"{where}: found {cell[:40]!r}{number_hint(cell)}; expected a time, such as 12.5 or 0:01:02.5")
    return float(cell) * unit_ms


def whole_of(cell: str, where: str, what: str = "the number of a frame") -> int:
    """A whole number; raises with its place."""
    if (number := whole_number(cell)) is None:
        raise VfoaError(f"{where}: found {cell[:40]!r}{number_hint(cell)}; expected {what}")
    return number
