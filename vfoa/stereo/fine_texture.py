"""Areas of an image with texture that is too fine to be matched at half the resolution."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.stereo.cut import averaged
from vfoa.stereo.region import Region
from vfoa.types import Mask

TILE_PX = 32
"""Rows and columns of a tile."""

FOUND_SHARE = 0.1
"""A tile with a greater share of matched pixels needs no search of the whole range."""

LEAST_GRADIENT = 8.0
"""Mean horizontal gradient, in gray levels a pixel, above which a tile has texture rather than noise."""

LOST_GRADIENT = 0.75
"""Texture is too fine if half the resolution leaves less than this share of its gradient per pixel.

An edge or a ramp keeps all of it or gains; pixel noise keeps half.
"""


def too_fine_areas(image: NDArray[np.uint8], matched: Mask) -> list[Region]:
    """Return rectangles of an image (H, W) around tiles with fine texture and few ``matched`` pixels (H, W).

    They bound groups of adjacent tiles, so two of them can overlap.
    """
    full = averaged(_gradient(image), TILE_PX).astype(np.float32)
    half = averaged(_gradient(averaged(image, 2)), TILE_PX // 2)
    too_fine = (full > LEAST_GRADIENT) & (half < LOST_GRADIENT * full)
    if not too_fine.any():
        return []
    too_fine &= averaged(matched.astype(np.uint8) * np.uint8(255), TILE_PX) <= FOUND_SHARE * 255
    height, width = image.shape
    _, _, boxes, _ = cv2.connectedComponentsWithStats(too_fine.astype(np.uint8))
    return [
        Region(
            u0=int(u) * TILE_PX,
            v0=int(v) * TILE_PX,
            u1=min(int(u + columns) * TILE_PX, width),
            v1=min(int(v + rows) * TILE_PX, height),
        )
        for u, v, columns, rows, _ in boxes[1:]
    ]


def _gradient(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Difference of each pixel (H, W) from the next one in its row; 0 in the last column."""
    gradient = np.zeros_like(image)
    gradient[:, :-1] = cv2.absdiff(image[:, 1:], image[:, :-1]).reshape(image.shape[0], -1)
    return gradient
