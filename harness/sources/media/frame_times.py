"""The times of frames: numbers that are times, times beside the numbers of frames, joined times, rates."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from harness.files.ascending import usual_step
from harness.sources.media.frame_files import DIGITS, with_decimals
from vfoa.times import FRAME_S

StampUnit = Literal["s", "ms", "us", "ns"]
TICKS_NS: dict[StampUnit, int] = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
UNIT_OF_DIGITS: Mapping[int, StampUnit] = {10: "s", 13: "ms", 16: "us", 19: "ns"}
"""The unit of a time since 1970, by the digits before its decimals: of the years 2001 to 2286."""
SINCE_1970_NS = 10**18
"""The least of such times; smaller ones count from another beginning."""
DATE = re.compile(
    r"([0-9]{4}-[0-9]{2}-[0-9]{2}[T ][0-9]{2}:[0-9]{2}:[0-9]{2})(?:[.,]([0-9]{1,9}))? ?(Z|[+-][0-9]{2}:?[0-9]{2})?"
)
"""Date and time of day, and how far that clock is ahead of UTC."""


def date_ns(text: str) -> int | None:
    """The time since 1970 of a :data:`DATE`, which is of UTC without a zone; None of any other text.

    Raises
    ------
    ValueError
        If the calendar or the clock has no such date or time.
    """
    if (date := DATE.fullmatch(text)) is None:
        return None
    whole_s = datetime.fromisoformat(date[1] + (date[3] or "Z")).timestamp()
    return int(whole_s) * 10**9 + int((date[2] or "").ljust(9, "0"))


def stamp_unit(numbers: Iterable[int]) -> StampUnit | None:
    """The unit of numbers that are times since 1970: today's have 10 digits in s, 13 in ms, 16 in us, 19 in ns.

    Ten digits are seconds if they are few apart: a camera's microseconds since it was started may have as many.
    """
    ascending = sorted(set(numbers))
    lengths = {len(str(number)) for number in ascending}
    unit = UNIT_OF_DIGITS.get(lengths.pop()) if len(lengths) == 1 else None
    if unit == "s" and not (ascending[-1] < _END_OF_SECONDS and usual_step(ascending) < _FEWEST_TICKS):
        return None
    return unit


def times_beside(files: Mapping[int, Path]) -> dict[int, int] | None:
    """The times since 1970 in ns that stand beside the numbers of frames in their names; None if there are none.

    ``frame_000001_1718000000123.png``: one number (seconds with their decimals) ascends with the frames and has a unit.
    """
    first = next(iter(files.values())).stem
    if len(files) < 2 or max(map(len, DIGITS.findall(first)), default=0) < _SHORTEST_STAMP:
        return None
    rows = [DIGITS.findall(path.stem) for path in files.values()]
    if len({*map(len, rows)}) != 1:
        return None
    columns = [[*map(int, column)] for column in with_decimals(first, list(zip(*rows, strict=True)))]
    stamps = [
        (column, unit)
        for column in columns
        if (unit := stamp_unit(column)) and all(before < after for before, after in pairwise(column))
    ]
    if len(stamps) != 1 or stamps[0][0] == list(files):
        return None
    ((column, unit),) = stamps
    return {number: stamp * TICKS_NS[unit] for number, stamp in zip(files, column, strict=True)}


_SHORTEST_STAMP = 10
_END_OF_SECONDS = 2**31
"""Seconds since 1970 are less until 2038."""
_FEWEST_TICKS = 1000
"""Least step of numbers that count no frames: a second in ms."""
HIGHEST_HZ = 1000.0
"""More frames per second than any camera of people takes: their times are in another unit."""
UNTIMED_HZ = 1 / FRAME_S
"""Numbers of frames in a second where neither files nor the manifest say it."""


def number_time_ns(number: int, rate_hz: float | None) -> int:
    """The time of an image without one: its number over the numbers of a second, :data:`UNTIMED_HZ` if not known."""
    return round(number * 1e9 / (rate_hz or UNTIMED_HZ))


def untimed_note(frames: Sequence[int]) -> tuple[str, ...]:
    """A note on several frames without times and a rate, ascending: what their times are, or that the numbers are."""
    if len(frames) < 2:
        return ()
    step = usual_step(frames)
    if step < _FEWEST_TICKS:
        return (
            f"frames without times count as {UNTIMED_HZ:g} numbers a second, as in a film: say rate_hz in [source] if "
            "they are not (the posterior and the logit depend on it)",
        )
    return (
        f"the frames have no times, and their numbers are {step:g} apart (median): if the numbers are times, say "
        'stamps = "ns" (or "us", "ms") in [source]',
    )


def numbered_apart(one: Collection[int], other: Collection[int]) -> int:
    """By how much the numbers of two sides with as many images, without a gap, differ; 0 of all others.

    Probably their n-th images belong together: one program counts from 0, another one, such as ffmpeg, from 1.
    """
    is_whole = all(max(side) - min(side) + 1 == len(side) for side in (one, other))
    return min(other) - min(one) if is_whole and len(one) == len(other) > 1 else 0


def join_times(left: Sequence[int], right: Sequence[int], tolerance: int) -> list[tuple[int, int]]:
    """Pair the places of two ascending sequences of times, each used once, at most ``tolerance`` apart.

    A time stays without a pair if its neighbour fits the other side better.
    """
    pairs: list[tuple[int, int]] = []
    i = j = 0
    while i < len(left) and j < len(right):
        apart = abs(left[i] - right[j])
        if j + 1 < len(right) and abs(left[i] - right[j + 1]) < apart:
            j += 1
        elif i + 1 < len(left) and abs(left[i + 1] - right[j]) < apart:
            i += 1
        else:
            if apart <= tolerance:
                pairs.append((i, j))
            i, j = i + 1, j + 1
    return pairs


def join_nearest(left: Sequence[int], right: Sequence[int]) -> list[tuple[int, int]]:
    """Pair the places of two ascending sequences of times, at most half a step of the left ones apart."""
    return join_times(left, right, int(np.median(np.diff(left))) // 2 if len(left) > 1 else 0)


def rate_of(times_ns: Iterable[int]) -> float | None:
    """Frames per second of ascending times by :func:`usual_step_ns`, from 1 Hz on to 0.001 Hz; None for one frame."""
    step_ns = usual_step_ns(times_ns)
    if step_ns is None:
        return None
    rate_hz = 1e9 / step_ns
    return round(rate_hz, 3) if rate_hz >= 1 else rate_hz


def usual_step_ns(times_ns: Iterable[int]) -> float | None:
    """The usual step of ascending times: their median step; None for a single time.

    Of times in whole milliseconds it is the mean of the steps within 1 ms of the median: those of 30 Hz are 33 and 34.
    """
    times = np.fromiter(times_ns, np.int64)
    steps = times[1:] - times[:-1]
    if not steps.size:
        return None
    median = float(np.median(steps))
    near = steps[np.abs(steps - median) <= TICKS_NS["ms"]]
    is_rounded = not (steps % TICKS_NS["ms"]).any()
    return float(near.mean()) if is_rounded and near.size else median


def nearest_apart(left: Sequence[int], right: Sequence[int]) -> float:
    """How far the first times are from the nearest one of the other side: the median."""
    others = np.array(right, dtype=np.int64)
    return float(np.median([np.abs(others - time).min() for time in left[:100]]))
