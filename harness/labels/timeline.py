"""The times of a clip's frames: convert times to frames and back."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.sources import AnyClip

_SECONDS = re.compile(r"(-?)([0-9]{1,10})(?:\.([0-9]{1,9}))?")
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """A clip's frame numbers and their times in ns, both ascending.

    If there are no times, they are not known. ``is_whole`` is False if only some of the clip's frames are known, such
    as those of a run with a limit.
    """

    frames: Sequence[int]
    times_ns: Sequence[int]
    is_whole: bool = True

    def between(self, start_ns: int, end_ns: int) -> tuple[int, int] | None:
        """First and last frame whose time lies in [start, end); None if there is none."""
        first, stop = bisect_left(self.times_ns, start_ns), bisect_left(self.times_ns, end_ns)
        return (self.frames[first], self.frames[stop - 1]) if first < stop else None

    def span_ns(self, first_frame: int, last_frame: int) -> tuple[int, int]:
        """The times [start, end) of a range of frames: it ends when the next frame begins.

        The last frame of the clip lasts for the median step. :meth:`between` gives the range back.
        """
        low, high = bisect_left(self.frames, first_frame), bisect_right(self.frames, last_frame) - 1
        after = bisect_right(self.times_ns, self.times_ns[high])
        end_ns = self.times_ns[after] if after < len(self.times_ns) else self.times_ns[high] + self.step_ns
        return self.times_ns[low], end_ns

    @property
    def step_ns(self) -> int:
        """The median time between two frames, ns; one second if there is only one frame."""
        return max(1, round(float(np.median(np.diff(self.times_ns))))) if len(self.times_ns) > 1 else _NS


def timeline_of(clip: AnyClip) -> Timeline:
    """Return a clip's frames and their times; no image is read."""
    return Timeline(frames=clip.frames, times_ns=[clip.time_ns(number) for number in clip.frames])


def parse_seconds(text: str) -> int | None:
    """Parse decimal seconds as ns, exactly (today's time stamps exceed a float's precision); None for other text."""
    match = _SECONDS.fullmatch(text)
    if match is None:
        return None
    sign, whole, fraction = match.groups()
    return (-1 if sign else 1) * (int(whole) * _NS + int((fraction or "").ljust(9, "0")))


def format_seconds(time_ns: int) -> str:
    """Format nanoseconds as decimal seconds, exactly, with as few digits as possible."""
    whole, fraction = divmod(abs(time_ns), _NS)
    return f"{'-' * (time_ns < 0)}{whole}.{fraction:09d}".rstrip("0").rstrip(".")
