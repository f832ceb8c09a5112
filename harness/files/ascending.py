"""Ascending order: of names with numbers in them, and places in sequences of numbers."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Sequence


def place_in(ascending: Sequence[int], number: int) -> int | None:
    """The place of a number in an ascending sequence; None if it is not there. An hour of video has 90,000 frames."""
    place = bisect_left(ascending, number)
    return place if place < len(ascending) and ascending[place] == number else None


def natural_order(name: str) -> list[tuple[int, str]]:
    """The key of an order in which ``mug 2`` comes before ``mug 10``."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]
