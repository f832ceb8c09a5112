"""Weighted least squares: smooth a disparity map within the edges of its image (Min et al. 2014)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.types import Image, Map

CONFIDENCE_SCALE = 255.0
"""OpenCV's confidence runs from 0 to 255."""


PARTS = 2
"""OpenCV divides the image among its threads, and pixels beside a division differ by a sixteenth: it is always two."""

_in_parts = Lock()


@contextmanager
def _parts() -> Iterator[None]:
    """Let OpenCV divide an image into :data:`PARTS` in this block, whatever the number of its threads is."""
    with _in_parts:
        threads = cv2.getNumThreads()
        cv2.setNumThreads(PARTS)
        try:
            yield
        finally:
            cv2.setNumThreads(threads)


class WlsFilter:
    """OpenCV's WLS filter with its confidence: agreement of the two views' maps, and their local variance.

    The guide is the colour image: a gray one smears dark scenes. Pixels up to ``discontinuity_radius_px`` from a depth
    edge have a lower confidence.
    """

    def __init__(self, *, smoothness: float, sigma_color: float, discontinuity_radius_px: int) -> None:
        self._filter: Any = cv2.ximgproc.createDisparityWLSFilterGeneric(True)
        self._filter.setLambda(smoothness)
        self._filter.setSigmaColor(sigma_color)
        self._filter.setDepthDiscontinuityRadius(discontinuity_radius_px)

    def filter(self, left: NDArray[np.int16], right: NDArray[np.int16], guide: Image) -> tuple[NDArray[np.int16], Map]:
        """Filter the left view's map by the right view's.

        Parameters
        ----------
        left, right
            (H, W) raw disparities of both views in sixteenths of a pixel; the right view's are negative.
        guide
            (H, W, 3) the left image.

        Returns
        -------
        The filtered map in sixteenths, every pixel filled, and its confidence (H, W) in [0, 1].
        """
        height, width = left.shape
        with _parts():
            filtered = self._filter.filter(left, guide, disparity_map_right=right, ROI=(0, 0, width, height))
        return filtered, self._filter.getConfidenceMap() / np.float32(CONFIDENCE_SCALE)
