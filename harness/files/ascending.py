"""Places in ascending sequences of numbers."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence


def place_in(ascending: Sequence[int], number: int) -> int | None:
    """The place of a number in an ascending sequence; None if it is not there. An hour of video has 90,000 frames."""
    place = bisect_left(ascending, number)
    return place if place < len(ascending) and ascending[place] == number else None
