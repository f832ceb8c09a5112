"""Whether both views were taken at the same time: what moves is seen to move in both, by the same frames."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from harness.clips.matching import shrunk_gray
from vfoa.types import Float, Image, StereoFrame

MOTION_SIDE_PX = 160
"""Images are shrunk by a whole number, to at least this length of the longer side."""
LEAST_AGREEMENT, LEAST_MORE = 0.8, 0.15
"""Least correlation of the motion in both views at an offset, and how much larger it is there than at none."""
LEAST_CHANGE = 0.15
"""Least relative standard deviation of the motion: noise alone is the same in every frame."""
LEAST_IN_COMMON = 24
"""Least number of frames that both views have at an offset."""


def motion(frames: Iterable[StereoFrame | None]) -> Float:
    """Mean change (2, N) of gray values from each frame to the next, left and right; NaN beside unknown frames.

    Frames follow each other without gaps; None for one that cannot be read. All pairs have both views.
    """
    changes, before = list[tuple[float, float]](), None
    for frame in frames:
        now = None
        if frame is not None and frame.right is not None:
            now = tuple(_shrunk(image) for image in (frame.left, frame.right))
        if before is not None and now is not None:
            left, right = (float(cv2.absdiff(*views).mean()) for views in zip(before, now, strict=True))
            changes.append((left, right))
        else:
            changes.append((np.nan, np.nan))
        before = now
    return np.array(changes[1:], np.float64).reshape(-1, 2).T


def right_offset(changes: Float, most: int) -> int | None:
    """By how many frames the right views are later in their film, at most ``most``; None if nothing says so.

    ``changes`` (2, N) are those of :func:`motion`. At -3, the right view of a frame shows what the left one shows 3
    frames later.
    """
    agreements = {by: _agreement(changes, by) for by in range(-most, most + 1)}
    best = max(agreements, key=lambda by: (agreements[by], -abs(by)))
    is_shown = agreements[best] >= LEAST_AGREEMENT and agreements[best] >= agreements[0] + LEAST_MORE
    return best if best and is_shown else None


def _agreement(changes: Float, by: int) -> float:
    """Correlation of the motion on the left with that on the right ``by`` frames later; 0 where too little moves."""
    left, right = changes[0, max(-by, 0) :], changes[1, max(by, 0) :]
    size = min(len(left), len(right))
    both = np.stack([left[:size], right[:size]])
    both = both[:, np.isfinite(both).all(axis=0)]
    if both.shape[1] < LEAST_IN_COMMON or (both.std(axis=1) <= LEAST_CHANGE * both.mean(axis=1)).any():
        return 0.0
    return float(np.corrcoef(*both)[0, 1])


def _shrunk(image: Image) -> Image:
    return shrunk_gray(image, max(1, max(image.shape) // MOTION_SIDE_PX))
