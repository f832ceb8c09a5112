"""When the rows of a table hold: times and numbers of frames in its cells, units that are probably others, onsets."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from harness.files.dialects import Row, is_missing, number_hint
from harness.files.tables import whole_number
from harness.labels.formats.exchange import MS, Exchange
from harness.labels.formats.spans import Span
from harness.labels.labels import Timeline, format_seconds
from harness.sources.media.frame_times import DATE, SINCE_1970_NS, TICKS_NS, UNIT_OF_DIGITS, date_ns
from vfoa.errors import VfoaError

Cells = tuple[str, Mapping[str, str]]
"""The place of a row, and its cells by column."""

MS_PER_UNIT = {"start_s": 1000.0, "start_ms": 1.0, "time_s": 1000.0, "time_ms": 1.0, "time_us": 1e-3}
_CLOCK = re.compile(r"(?:0 days )?(?:([0-9]{1,4}):)?([0-5]?[0-9]):([0-5]?[0-9](?:[.,][0-9]+|(?<=:..):[0-9]{3})?)")
"""A time of day; Datavyu has a colon before its milliseconds."""
_CODE = re.compile(r"([0-9]{1,4}):([0-5][0-9]):([0-5][0-9])([:;])([0-9]{2})")
"""A time code of a film's editor; a semicolon says that numbers are dropped, as with 29.97 frames per second."""
_NUMBER = re.compile(r"-?(?:[0-9]{1,16}(?:\.[0-9]*)?|\.[0-9]+)")

_STAMP = re.compile(r"([0-9]{10}|[0-9]{13}|[0-9]{16}|[0-9]{19})(?:\.[0-9]*)?")

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
    if place[0] not in ("start_s", "time_s") or all(map(_STAMP.fullmatch, cells)):
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


def check_minutes(rows: Sequence[Cells], place: Sequence[str], exchange: Exchange, path: Path) -> None:
    """Reject hours and minutes that are probably minutes and seconds, as a spreadsheet takes ``1:30`` for 1:30:00.

    Raises
    ------
    VfoaError
        If all seconds are 0, and times reach beyond the clip's end, and near it if they were a 60th as long.
    """
    cells = [cells[column] for _, cells in rows for column in place]
    clocks = [_CLOCK.fullmatch(cell) for cell in cells]
    if place[0] not in ("start_s", "time_s") or not all(clock and clock[1] and clock[3] == "00" for clock in clocks):
        return
    times_s = [time_ms_of(cell, "", unit_ms=1, fps=None) / 1000 for cell in cells]
    last, end_s = max(times_s, default=0.0), exchange.shown.times_ns[-1] / 1e9
    if last > _LEAST_TIMES * end_s and _LEAST_SHARE <= last / 60 / max(end_s, 1) <= _MOST_SHARE:
        raise VfoaError(
            f"{path}: {' and '.join(place)}: times reach {cells[times_s.index(last)]}, the clip ends at {end_s:g} s; "
            "expected h:mm:ss: a spreadsheet takes 1:30 for hours and minutes; type 0:01:30"
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


def time_ms_of(cell: str, where: str, *, unit_ms: float, fps: float | None) -> float:
    """Milliseconds, of a number in a unit or ``h:mm:ss`` (of pandas, ``0 days h:mm:ss``); raises with its place.

    Those since 1970 may be a date, which is of UTC without a zone, and in place of seconds have any unit.
    ``fps`` is the rate of time codes (``hh:mm:ss:ff``), each of which is the time at which its frame begins.
    """
    if (since_1970 := _since_1970_ms(cell, unit_ms)) is not None:
        return since_1970
    if code := _CODE.fullmatch(cell):
        return _code_ms(code, where, fps)
    if clock := _CLOCK.fullmatch(cell):
        hours, minutes, seconds = clock.groups()
        return 1000 * (3600 * int(hours or 0) + 60 * int(minutes) + float(re.sub("[,:]", ".", seconds)))
    if not _NUMBER.fullmatch(cell):
        raise VfoaError(f"{where}: found {cell[:40]!r}{number_hint(cell)}; expected a time, such as 12.5 or 0:01:02.5")
    return float(cell) * unit_ms


def _since_1970_ms(cell: str, unit_ms: float) -> float | None:
    """A time since 1970; None of any other. A column of seconds may name no unit, and be of any."""
    with suppress(ValueError):
        if (date := date_ns(cell)) is not None:
            return date / MS
    if not (stamp := _STAMP.fullmatch(cell)):
        return None
    of_digits = TICKS_NS[UNIT_OF_DIGITS[len(stamp[1])]] / MS
    return float(cell) * of_digits if unit_ms in (of_digits, MS_PER_UNIT["time_s"]) else None


def on_own_clock(rows: Sequence[Row], meant: Sequence[str | None], exchange: Exchange) -> Exchange:
    """The clip at its own times, if these and the times of a table, whose columns are ``meant``, are since 1970.

    A given offset counts as it is.
    """
    at = next((at for at, name in enumerate(meant) if name in MS_PER_UNIT), None)
    first_ns = next(iter(exchange.timeline.times_ns), 0)
    if at is None or exchange.offset is not None or first_ns < SINCE_1970_NS:
        return exchange
    unit_ms = MS_PER_UNIT[meant[at] or ""]
    cells = [cells[at] for _, cells in rows[1:] if not is_missing(cells[at])]
    is_stamped = all(_since_1970_ms(cell, unit_ms) is not None for cell in cells)
    return replace(exchange, offset=first_ns / 1e9) if is_stamped else exchange


def clock_notes(times_ns: Sequence[int], timeline: Timeline, exchange: Exchange, path: Path) -> Iterator[str]:
    """A note if times that count from the clip's first frame on could as well be of the clip's own clock.

    Parameters
    ----------
    times_ns
        When the rows of a table begin and end, or hold.
    timeline
        The clip's frames at the times of the rows.
    """
    own = exchange.timeline
    if not times_ns or not own.times_ns or exchange.offset is not None or exchange.fps is not None or exchange.films:
        return
    (begin_ns, end_ns), half_ns = own.span_ns(own.frames[0], own.frames[-1]), own.step_ns / 2
    apart_ns, begin_s = abs(begin_ns - timeline.times_ns[0]), format_seconds(begin_ns)
    is_numbered = exchange.has_images and apart_ns <= own.step_ns + MS  # images from 1 on have no clock
    is_inside = begin_ns - half_ns < min(times_ns) and max(times_ns) < end_ns + half_ns
    if apart_ns > half_ns and not is_numbered and is_inside:
        yield (
            f"{path}: times are read as since the clip's first frame, which is at {begin_s} s on the clip's own "
            f"clock; if they are of this clock: --offset {begin_s}."
        )


def _code_ms(code: re.Match[str], where: str, fps: float | None) -> int:
    if fps is None:
        raise VfoaError(f"{where}: found the time code {code[0]!r}; expected --fps RATE, that of the film, with it")
    hours, minutes, seconds, frame = (int(code[part]) for part in (1, 2, 3, 5))
    rate, minutes = math.ceil(fps), 60 * hours + minutes
    if frame >= rate:
        raise VfoaError(f"{where}: found {code[0]!r}; expected frames of a second below {rate} (--fps {fps:g})")
    drops = code[4] == ";" and rate % 30 == 0 and fps < rate
    dropped = rate // 15 * (minutes - minutes // 10) if drops else 0
    return math.floor((rate * (60 * minutes + seconds) + frame - dropped) * 1000 / fps)


def to_last_pictures(
    spans: Sequence[Span], ends: Iterable[str], fps: float | None, path: Path
) -> tuple[Sequence[Span], tuple[str, ...]]:
    """Spans of time codes to the end of the last picture where their ``ends`` are the codes of it, with a note.

    They are in INTERACT: a row begins one picture after another one ends, or ends where it begins, and none begins
    where another one ends.
    """
    if fps is None or not all(map(_CODE.fullmatch, ends)):
        return spans, ()
    picture_ms = 1000 / fps
    begins = [(span.subject, span.start_ms) for span in spans]
    after = {(subject, round(begin_ms / picture_ms)) for subject, begin_ms in begins}
    last = [(span.subject, round(span.end_ms / picture_ms)) for span in spans if span.start_ms < span.end_ms]
    is_next = len(last) < len(spans) or any((subject, number + 1) in after for subject, number in last)
    if not is_next or not after.isdisjoint(last):
        return spans, ()
    note = (
        f"{path}: rows end with the picture of their time code, since others begin one picture later (as of INTERACT)."
    )
    return [replace(span, end_ms=round(span.end_ms + picture_ms)) for span in spans], (note,)


def whole_of(cell: str, where: str, what: str = "the number of a frame") -> int:
    """A whole number; raises with its place."""
    if (number := frame_number(cell)) is None:
        raise VfoaError(f"{where}: found {cell[:40]!r}{number_hint(cell)}; expected {what}")
    return number


def frame_number(cell: str) -> int | None:
    """A whole number, which pandas may have as ``12.0``."""
    return whole_number(cell.removesuffix(".0"))


# Frames with times beside them, which scripts save


_PLACES_OF_FRAMES = (("first_frame", "last_frame"), ("frame",), ("first_frame",))
_BEGINNINGS = ("start_s", "start_ms", "start_ns", "time_s", "time_ms", "time_us", "time_ns")
_TIMES = ("_s", "_ms", "_us", "_ns")
"""Ends of the names of columns of times."""


def is_time(column: str | None) -> bool:
    """Whether a column, or None, is one of times."""
    return column is not None and column.endswith(_TIMES)


def without_times(
    columns: Mapping[str, int], lines: Sequence[tuple[int, Sequence[str]]], exchange: Exchange, path: Path
) -> tuple[dict[str, int], list[int]]:
    """The columns without those of times beside frames, which say the same, and the places of these.

    The clock of the times may be another one than the clip's; times that cannot be read do not count. Times with an end
    beside a frame without one are kept.

    Raises
    ------
    VfoaError
        If rows are at other times than their frames are in the clip.
    """
    place = next((place for place in _PLACES_OF_FRAMES if columns.keys() >= {*place}), None)
    times = [name for name in columns if is_time(name)]
    begin = next((name for name in _BEGINNINGS if name in times), None)
    if place is None or begin is None or (len(place) == 1 < len(times)):
        return dict(columns), []
    clip_ns = _times_of_frames(exchange, is_ns=begin.endswith("_ns"))
    try:
        apart = [
            (line, cells[columns[place[0]]], _ns(cells[columns[begin]], begin, exchange.fps) - clip_ns[number])
            for line, cells in lines
            if (number := frame_number(cells[columns[place[0]]])) in clip_ns and _is_clock(cells[columns[begin]])
        ]
    except VfoaError:
        apart = []
    if apart:
        _check_apart(apart, (place[0], begin), clip_ns, path)
    return {name: at for name, at in columns.items() if name not in times}, [columns[name] for name in times]


def _is_clock(cell: str) -> bool:
    """Whether a cell beside a frame is its time; a date may be when it was labelled."""
    return not (is_missing(cell) or DATE.fullmatch(cell))


def _times_of_frames(exchange: Exchange, *, is_ns: bool) -> Mapping[int | None, float]:
    """The time of each frame in the other program, ns, by the number that a table has for it; empty without a rate.

    ``is_ns``: nanoseconds are of the clip's own clock, if no offset says another.
    """
    if exchange.fps is not None:
        return {number: number * 1e9 / exchange.fps for number in range(len(exchange.frames))}
    if exchange.rate_hz is None:
        return {}
    times_ns = exchange.timeline.times_ns
    own_ns = 0.0 if is_ns and exchange.offset is None else 1e9 * (exchange.offset or 0.0) - next(iter(times_ns), 0)
    return dict(zip(exchange.frames, (own_ns + time_ns for time_ns in times_ns), strict=False))


def _ns(cell: str, column: str, fps: float | None) -> float:
    if column.endswith("_ns"):
        return whole_of(cell, column)
    return MS * time_ms_of(cell, column, unit_ms=MS_PER_UNIT[column], fps=fps)


def _check_apart(
    apart: Sequence[tuple[int, str, float]], names: tuple[str, str], clip_ns: Mapping[int | None, float], path: Path
) -> None:
    """Reject rows whose frames are further apart in the clip than in time, or all of them at a slightly other time."""
    times_ns = [*clip_ns.values()]
    step_ns = statistics.median(after - before for before, after in pairwise(times_ns)) if len(times_ns) > 1 else 1e9
    usual = statistics.median(off for *_, off in apart)
    line, frame, off = max(apart, key=lambda each: abs(each[2] - usual))
    both = f"{path}:{line}: {' and '.join(names)}"
    if abs(off - usual) > step_ns:
        raise VfoaError(
            f"{both}: frame {frame} is {abs(off - usual) / 1e9:.3g} s {'later' if off > usual else 'earlier'} in time "
            "than in the clip, beside the other rows; expected one of the two columns"
        )
    if step_ns / 2 < abs(usual) <= times_ns[-1] - times_ns[0] + step_ns:  # else of another clock
        raise VfoaError(
            f"{both}: rows are {abs(usual) / 1e9:.3g} s {'later' if usual > 0 else 'earlier'} in time than their "
            "frames in the clip (median); expected one of the two columns (frames of another program, from 0: --fps "
            "RATE; another beginning: --offset)"
        )


# Rows that have a beginning alone: each holds until the next one of its person


def until_next(
    given: Sequence[Cells], known: Sequence[Cells], column: str, exchange: Exchange, timeline: Timeline | None
) -> tuple[list[Cells], tuple[str, str]]:
    """Rows that hold until the next one of their person, the last one until the clip ends; the columns of both ends.

    ``known`` are the given rows that are labels; the others only end the one before. ``timeline`` has the clip's frames
    at the times of the column; None: it has the clip's own frame numbers.

    Raises
    ------
    VfoaError
        If a cell is no time or number, or two targets of a person begin at once.
    """
    is_frames, is_ns = column in ("frame", "first_frame"), column.endswith("_ns")
    place = ("first_frame", "last_frame") if is_frames else ("start_ns", "end_ns") if is_ns else ("start_ms", "end_ms")
    end: float = exchange.frames[-1] + 1
    if timeline is not None:
        _, end_ns = timeline.span_ns(timeline.frames[0], timeline.frames[-1])
        end = math.ceil(end_ns / 1e9 * (exchange.fps or 1.0)) if is_frames else end_ns if is_ns else end_ns / MS
    labels, onsets = {id(row) for row in known}, dict[str, dict[float, list[Cells]]]()
    for row in given:
        where, cells = row
        if id(row) in labels or not is_missing(cells[column]):
            cell = cells[column], f"{where}: {column}"
            onset = (
                whole_of(*cell)
                if is_frames or is_ns
                else time_ms_of(*cell, unit_ms=MS_PER_UNIT[column], fps=exchange.fps)
            )
            person = exchange.names.translate(cells.get("subject", ""))
            onsets.setdefault(person, {}).setdefault(onset, []).append(row)
    rows = list[Cells]()
    for by_onset in onsets.values():
        states = [(onset, _state([row for row in by_onset[onset] if id(row) in labels])) for onset in sorted(by_onset)]
        changes = [state for before, state in pairwise([(0, None), *states]) if not _are_same(before[1], state[1])]
        for (onset, state), (after, _) in pairwise([*changes, (math.inf, None)]):
            stop = max(onset + is_frames, min(after, end))
            if state is not None:
                ends = dict(zip(place, (_cell(onset), _cell(stop - is_frames)), strict=True))
                rows.append((state[0], {**state[1], **ends}))
    return rows, place


def _state(rows: Sequence[Cells]) -> Cells | None:
    """The only one of the rows of a person that begin at the same time; None if there is none: nothing is known then.

    Raises
    ------
    VfoaError
        If they have several targets.
    """
    for where, cells in rows[1:]:
        if cells["target"] != rows[0][1]["target"]:
            both = f"{rows[0][1]['target']!r} ({rows[0][0]}) and {cells['target']!r}"
            raise VfoaError(f"{where}: {cells.get('subject', '')!r} begins to look at {both} at once; expected one")
    return next(iter(rows), None)


def _are_same(before: Cells | None, after: Cells | None) -> bool:
    """Whether a row goes on with the one before: it has the same target and note."""
    if before is None or after is None:
        return before is after
    return all(before[1].get(column) == after[1].get(column) for column in ("target", "note"))


def _cell(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:.3f}"
