"""The images that a matcher compares: both views, gray, cut to a region; and its maps put back in place."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.errors import VfoaError
from vfoa.stereo.region import Region
from vfoa.types import Disparity, Image, Map, StereoFrame, StereoRig


def both_views(frame: StereoFrame) -> tuple[Image, Image]:
    """The left and the right image (H, W, 3) of a frame.

    Raises
    ------
    VfoaError
        If the frame has no right image.
    """
    if frame.right is None:
        raise VfoaError(
            "stereo.matcher: found a matcher of two views, but the clip has no right images; "
            'expected stereo.matcher = "sensor", which uses the measured depth'
        )
    return frame.left, frame.right


def gray(image: Image, factor: int) -> NDArray[np.uint8]:
    """Convert an image (H, W, 3) to gray; each pixel is the mean of ``factor`` x ``factor`` pixels.

    If the size is no multiple of the factor, the last pixels are repeated.
    """
    full = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    if factor == 1:
        return full
    height, width = full.shape
    covered = cut(full, Region(u0=0, v0=0, u1=width, v1=height).shrunk(factor).times(factor))
    size = (covered.shape[1] // factor, covered.shape[0] // factor)
    return np.asarray(cv2.resize(covered, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def cut(image: NDArray[np.uint8], region: Region) -> NDArray[np.uint8]:
    """Cut a region out of an image. Beyond the edges of the image, its last pixels are repeated."""
    height, width = image.shape[:2]
    inside = Region(u0=max(region.u0, 0), v0=max(region.v0, 0), u1=min(region.u1, width), v1=min(region.v1, height))
    beyond = (inside.v0 - region.v0, region.v1 - inside.v1, inside.u0 - region.u0, region.u1 - inside.u1)
    part = image[inside.window]
    return np.asarray(cv2.copyMakeBorder(part, *beyond, cv2.BORDER_REPLICATE) if any(beyond) else part)


def cropped(values: NDArray[Any], origin: Region, region: Region) -> NDArray[Any]:
    """Return the region's part of a map whose first pixel is the first one of ``origin``."""
    rows = slice(region.v0 - origin.v0, region.v1 - origin.v0)
    return values[rows, region.u0 - origin.u0 : region.u1 - origin.u0]


def enlarged(disparities: NDArray[np.int16], factor: int) -> NDArray[np.int16]:
    """Enlarge disparities to ``factor`` times the rows and columns: each is repeated and multiplied by ``factor``."""
    if factor == 1:
        return disparities
    size = (disparities.shape[1] * factor, disparities.shape[0] * factor)
    return np.asarray(cv2.resize(disparities * np.int16(factor), size, interpolation=cv2.INTER_NEAREST), dtype=np.int16)


def in_frame(disparities: Map, confidence: Map | None, region: Region, rig: StereoRig) -> Disparity:
    """Put a region's disparities in a map of the whole image; outside, they are unknown with confidence 0."""
    size = (rig.height_px, rig.width_px)
    if disparities.shape == size:
        return Disparity(disparity_px=disparities, confidence=confidence)
    disparity = np.full(size, np.nan, np.float32)
    disparity[region.window] = disparities
    if confidence is None:
        return Disparity(disparity_px=disparity)
    everywhere = np.zeros(size, np.float32)
    everywhere[region.window] = confidence
    return Disparity(disparity_px=disparity, confidence=everywhere)
