"""Width of a board's edges in a picture: motion blur and defocus displace corners measured to a fraction of a pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from harness.sources.calibrate.boards import Seen
from vfoa.types import Float, Image

REACH = 0.4
"""Length of a profile to each side, in sides of a square: long enough to reach plain black and plain white.

A marker inside the white square adds edges that are as wide as the square's own.
"""

STEP_PX = 0.5


def edge_width_px(image: Image, seen: Seen, corner_columns: int) -> float:
    """Width of the edges between neighbouring corners, pixels: the step's height over its greatest slope.

    The result is the greater of the medians along the two directions of the grid, since motion blurs only one. A sharp
    edge is 1 to 2 pixels wide; under a Gaussian blur, sqrt(2 pi) sigmas. NaN if no two corners are neighbours.
    """
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    places = {int(id_): pixel for id_, pixel in zip(seen.ids, seen.pixels, strict=True)}
    along = [(i, i + 1) for i in places if i + 1 in places and (i + 1) % corner_columns]
    across = [(i, i + corner_columns) for i in places if i + corner_columns in places]
    widths = [
        float(np.median(_widths(gray, np.array([[places[i], places[j]] for i, j in pairs]))))
        for pairs in (along, across)
        if pairs
    ]
    return max(widths, default=float("nan"))


def _widths(gray: NDArray[np.float32], ends: Float) -> Float:
    """Widths of the edges (N, 2, 2) between two corners each, at their middles."""
    direction = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(direction, axis=1)
    normal = np.stack([-direction[:, 1], direction[:, 0]], axis=1) / length[:, None]
    reach = REACH * length
    steps = int(np.ceil(2 * reach.max() / STEP_PX)) + 1
    offsets = np.linspace(-1, 1, steps)[None, :, None] * reach[:, None, None]
    at = (ends.mean(axis=1)[:, None] + offsets * normal[:, None]).astype(np.float32)
    profiles = cv2.remap(gray, at[..., 0], at[..., 1], cv2.INTER_LINEAR).astype(np.float64)
    slope = np.abs(np.diff(profiles, axis=1)).max(axis=1) / (2 * reach / (steps - 1))
    height = profiles.max(axis=1) - profiles.min(axis=1)
    return np.asarray(height / np.maximum(slope, 1e-6))
