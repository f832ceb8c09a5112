"""The times of the frames of a sequence, as they are given to a follower."""

from __future__ import annotations

import operator

from vfoa.errors import VfoaError
from vfoa.methods import FRAME_S

MIN_STEP_NS = 100_000
"""Frames that are nearer than this have times in another unit: no camera or tracker takes 10,000 frames per second."""


def time_of_frame(given: int | None, before: int | None) -> int:
    """Return the time of a frame, nanoseconds, after the frame ``before``; None: the first frame.

    Without a time it is :data:`vfoa.methods.FRAME_S` after the frame before.

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
