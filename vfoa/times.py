"""The times of the frames of a sequence: as they are given to a follower, and between two frames."""

from __future__ import annotations

import operator
from typing import NamedTuple

from vfoa.errors import VfoaError

FRAME_S = 0.04
"""Time between frames that have no times, or times that do not increase, seconds."""
_JITTER_S = 0.001
MIN_STEP_NS = 100_000
"""Frames that are nearer than this have times in another unit: no camera or tracker takes 10,000 frames per second."""


def time_of_frame(given: int | None, before: int | None) -> int:
    """Return the time of a frame, nanoseconds, after the frame ``before``; None: the first frame.

    Without a time it is :data:`FRAME_S` after the frame before.

    Raises
    ------
    VfoaError
        If the time is no whole number, or less than :data:`MIN_STEP_NS` after the frame before.
    """
    if given is None:
        return 0 if before is None else before + round(FRAME_S * 1e9)
    try:
        time_ns = operator.index(given)
    except TypeError:
        raise VfoaError(f"time_ns: expected whole nanoseconds, found {given!r}; round(1e9 * seconds)") from None
    if before is not None and time_ns < before + MIN_STEP_NS:
        raise VfoaError(
            f"time_ns: found {time_ns} after {before}; expected nanoseconds, each frame at least {MIN_STEP_NS} later; "
            "leave the times out if they are not known"
        )
    return time_ns


def seconds_between(before_ns: int | None, now_ns: int | None) -> float:
    """Return the time between two frames, seconds: :data:`FRAME_S` where it is unknown or not positive."""
    if before_ns is None or now_ns is None or now_ns <= before_ns:
        return FRAME_S
    return (now_ns - before_ns) / 1e9


class Gap(NamedTuple):
    """How long something has not been seen: in frames, and in seconds."""

    frames: int = 0
    seconds: float = 0.0

    def longer(self, dt_s: float) -> Gap:
        """Return the gap with one frame more, ``dt_s`` after the last one."""
        return Gap(self.frames + 1, self.seconds + dt_s)

    def is_within(self, frames: int) -> bool:
        """Whether it has no more than these frames, or at more than 25 per second no more than their time.

        What is remembered for some frames thus lasts as long at 100 frames per second as at 25.
        """
        return self.frames <= frames or self.seconds <= frames * FRAME_S + _JITTER_S


NO_GAP = Gap()
"""Of what is seen now."""
