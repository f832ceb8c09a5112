"""Match points of the left image in the right one."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.types import Float, Image

MATCHED_SIDE_PX = 2048
"""Larger images are reduced before matching: an 8K pair would need 8 GB."""


def matched_offsets_px(left: Image, right: Image) -> Float:
    """Offsets of points found in both images, (N, 2): columns (their disparity) and rows, left minus right.

    The rows are 0 in a perfectly rectified pair. SIFT features; a match must be mutual and clearly better than the
    second best (Lowe's ratio). Both images have the same size.
    """
    factor = math.ceil(max(left.shape) / MATCHED_SIDE_PX)
    detector = cv2.SIFT.create(nfeatures=2000)
    grays = [_shrunk(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), factor) for image in (left, right)]
    (points_left, found_left), (points_right, found_right) = (detector.detectAndCompute(gray, None) for gray in grays)
    if found_left is None or found_right is None or len(found_left) < 2 or len(found_right) < 2:
        return np.empty((0, 2))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    back = {match.queryIdx: match.trainIdx for (match,) in matcher.knnMatch(found_right, found_left, k=1)}
    pairs = [
        (points_left[best.queryIdx].pt, points_right[best.trainIdx].pt)
        for best, second in matcher.knnMatch(found_left, found_right, k=2)
        if best.distance < 0.7 * second.distance and back[best.trainIdx] == best.queryIdx
    ]
    points = np.array(pairs, dtype=np.float64).reshape(-1, 2, 2)
    return factor * (points[:, 0] - points[:, 1])


def _shrunk(gray: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    """The image with each square of ``factor`` pixels averaged; incomplete squares at the edges are dropped."""
    height, width = (size // factor for size in gray.shape)
    whole = gray[: height * factor, : width * factor]
    return gray if factor == 1 else np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))
