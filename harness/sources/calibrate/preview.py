"""A picture of one rectified pair for visual inspection: the same object must be on the same line on both sides."""

from __future__ import annotations

import cv2
import numpy as np

from harness.sources.rectification import Optics
from vfoa.types import Image

LINES = 16


def rectified_preview(optics: Optics, left: Image, right: Image) -> Image:
    """The rectified pair side by side (H, 2 W, 3) RGB, with evenly spaced green rows."""
    picture = np.hstack(optics.rectify(left, right))
    for row in np.linspace(0, picture.shape[0] - 1, LINES + 2)[1:-1].astype(int):
        cv2.line(picture, (0, int(row)), (picture.shape[1] - 1, int(row)), (0, 255, 0), 1)
    return picture
