"""Dates and times in the names of images: ``2023-05-01_12-30-45-123``, ``20230501_123045_123456``."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

_TIME_OF_DAY = (
    r"[^0-9]{0,3}(?P<hour>\d\d)[-_.:]?(?P<minute>\d\d)[-_.:]?(?P<second>\d\d)"
    r"(?:(?P<mark>[-_.,])?(?P<decimals>\d{1,9})|(?![-_.,]?\d))(?!\d|[-_ ]?[ap]m\b)"
)
_DATES = tuple(
    re.compile(rf"(?<!\d){date}{_TIME_OF_DAY}", re.IGNORECASE)
    for date in (
        r"(?P<year>20\d\d)([-_.]?)(?P<month>\d\d)\2(?P<day>\d\d)",  # the two marks of a date are the same
        r"(?P<day>\d\d)([-_.])?(?P<month>\d\d)(?(2)\2)(?P<year>20\d\d)(?(2)(?!\d))",
        r"(?P<month>\d\d)([-_.])?(?P<day>\d\d)(?(2)\2)(?P<year>20\d\d)(?(2)(?!\d))",
    )
)
_RUN = re.compile(r"\d+")
_CLOCK_DIGITS = (3, 6, 9)
"""Numbers of decimals of a time in ms, us or ns."""


class Dates(NamedTuple):
    """The time of each name since 1970, as a clock at UTC would have it, and which runs of digits it takes up.

    Times are in ms, or in us or ns if there are decimals of these.
    """

    times: list[int]
    runs: range


def find_dates(names: Sequence[str]) -> Dates | None:
    """The dates with times of day in names; None if one has none, or all have the same one.

    A number after the second is its decimals, unless it is an index, which grows from each second to the next, or one
    that counts the images of each second, as Motion's (``20230501123045-00``): these are then evenly apart in it.
    Beside one second alone, it is its ms, us or ns, unless it counts by one. Of several readings (a day and a month may
    be exchanged) the one counts with which the names are least apart.
    """
    readings = [dates for pattern in _DATES if (dates := _dates(names, pattern)) is not None]
    return min(readings, key=lambda dates: _seconds(max(dates.times)) - _seconds(min(dates.times)), default=None)


def _seconds(time: int) -> float:
    return float(f"{str(time)[:10]}.{str(time)[10:]}")


def _dates(names: Sequence[str], pattern: re.Pattern[str]) -> Dates | None:
    found = [match for match in map(pattern.search, names) if match]
    seconds = [second for match in found if (second := _second_of(match)) is not None]
    decimals = [match["decimals"] or "" for match in found]
    if len(seconds) < len(names) or len(set(map(len, decimals))) > 1:
        return None
    if len(set(seconds)) == 1:
        if len(decimals[0]) not in _CLOCK_DIGITS or counts_by_one(decimals):
            return None
    elif decimals[0]:
        numbers = [*map(int, decimals)]
        numbered = sorted(zip(seconds, numbers, strict=True))
        if found[0]["mark"] and _is_index(numbered):
            decimals = [""] * len(found)
        elif _count_in_second(numbered, 10 ** len(decimals[0])):
            first, count = min(numbers), max(numbers) - min(numbers) + 1
            decimals = [f"{1000 * (number - first) // count:03d}" for number in numbers]
    end = "decimals" if decimals[0] else "second"
    runs = {(_runs_to(match, match.start()), _runs_to(match, match.end(end))) for match in found}
    if len(runs) > 1:
        return None
    width = max(3, math.ceil(len(decimals[0]) / 3) * 3)
    times = [int(f"{second}{digits.ljust(width, '0')}") for second, digits in zip(seconds, decimals, strict=True)]
    return Dates(times, range(*runs.pop()))


def counts_by_one(digits: Iterable[str]) -> bool:
    """Whether numbers are those of frames in turn, some of which may be lost."""
    return float(np.median(np.diff(sorted(map(int, digits))))) <= 1


def _second_of(match: re.Match[str]) -> int | None:
    """The second since 1970; None if there is no such day, hour, minute or second."""
    year, month, day, hour, minute, second = (
        match[part] for part in ("year", "month", "day", "hour", "minute", "second")
    )
    try:
        return int(np.datetime64(f"{year}-{month}-{day}T{hour}:{minute}:{second}", "s").astype(np.int64))
    except ValueError:
        return None


def _is_index(numbered: Sequence[tuple[int, int]]) -> bool:
    """Whether numbers beside ascending seconds always grow, where decimals would begin again with the next second."""
    steps = list(pairwise(numbered))
    return all(number < later for (_, number), (_, later) in steps) and any(a == b for (a, _), (b, _) in steps)


def _count_in_second(numbered: Sequence[tuple[int, int]], whole: int) -> bool:
    """Whether numbers beside ascending seconds count by one, and begin again before they reach a ``whole`` second."""
    steps = [(later - second, after - number) for (second, number), (later, after) in pairwise(numbered)]
    within, across = ([step for seconds, step in steps if seconds == apart] for apart in (0, 1))
    return bool(within and across) and bool(np.median(within) == 1 and np.median(across) + whole > 1)


def _runs_to(match: re.Match[str], place: int) -> int:
    return len(_RUN.findall(match.string[:place]))
