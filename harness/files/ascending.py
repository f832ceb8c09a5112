"""Ascending order: of names with numbers in them, places in sequences of numbers, and their steps."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Sequence
from itertools import pairwise
from statistics import median

from vfoa.times import FRAME_S


def place_in(ascending: Sequence[int], number: int) -> int | None:
    """The place of a number in an ascending sequence; None if it is not there. An hour of video has 90,000 frames."""
    place = bisect_left(ascending, number)
    return place if place < len(ascending) and ascending[place] == number else None


def natural_order(name: str) -> list[tuple[int, str]]:
    """The key of an order in which ``mug 2`` comes before ``mug 10``."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def numbers_per_second(frames: Sequence[int], rate_hz: float | None) -> float:
    """How many numbers of frames a second has: the rate where they count, a billion where they are nanoseconds.

    ``rate_hz`` is that of the frames, of which every Nth may be there. None: their numbers are their times, one each
    :data:`vfoa.times.FRAME_S`, or there is one frame.
    """
    return 1 / FRAME_S if rate_hz is None else rate_hz * usual_step(frames)


def usual_step(ascending: Sequence[int]) -> float:
    """The median difference of two numbers that follow each other; 1 for a single number."""
    return median([later - earlier for earlier, later in pairwise(ascending)] or [1])
