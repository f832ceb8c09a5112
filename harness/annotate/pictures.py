"""The views of a frame as JPEG: left, right, disparity, and a subject's head, enlarged."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np

from harness.sources import Clip
from vfoa.stereo import MATCHERS, StereoMatcher
from vfoa.types import Disparity, Image, StereoFrame

View = Literal["left", "right", "disparity", "head"]
RegionPx = tuple[int, int, int, int]

_QUALITY = 90
_HEAD_HEIGHT_PX = 360
_HEAD_MARGIN = 0.35
"""Margin around a head box, as a share of its side."""


class DisparityView:
    """A clip's disparity: measured, else the true one, else by semi-global matching."""

    def __init__(self, clip: Clip) -> None:
        self._clip = clip
        self._matcher: StereoMatcher | None = None

    def at(self, frame: StereoFrame) -> Disparity:
        """The disparity of a frame."""
        if frame.depth_m is not None:
            return self._match(frame, "sensor")
        known = self._clip.truth(frame.index).disparity
        return known if known is not None else self._match(frame, "sgbm")

    def _match(self, frame: StereoFrame, name: str) -> Disparity:
        if self._matcher is None:
            matcher = MATCHERS.load(name)
            self._matcher = matcher(matcher.Settings())
        return self._matcher.match(frame)


def jpeg(image: Image) -> bytes:
    """An image (H, W, 3) RGB as JPEG."""
    _, coded = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return coded.tobytes()


def shrunk(image: Image, region: RegionPx | None, width: int | None) -> Image:
    """Cut a region (u0, v0, u1, v1) out of an image and shrink it to at most ``width``; None: no limit."""
    if region is not None:
        u0, v0, u1, v1 = region
        image = image[max(v0, 0) : max(v1, v0 + 1), max(u0, 0) : max(u1, u0 + 1)]
    if width is None or width >= image.shape[1] or not image.size:
        return image
    size = (width, max(round(image.shape[0] * width / image.shape[1]), 1))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)


def colour(disparity: Disparity) -> Image:
    """A disparity map (H, W) in colours: near is red, far is blue, unknown is black."""
    values = disparity.disparity_px
    known = np.isfinite(values)
    if not known.any():
        return np.zeros((*values.shape, 3), np.uint8)
    low, high = np.percentile(values[known], (1, 99))
    scaled = np.clip((np.where(known, values, low) - low) / max(high - low, 1e-6), 0, 1)
    coloured = cv2.applyColorMap((255 * scaled).astype(np.uint8), cv2.COLORMAP_TURBO)
    coloured[~known] = 0
    return cv2.cvtColor(coloured, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def head(image: Image, box_px: tuple[float, float, float, float]) -> Image:
    """A head with its surroundings, enlarged to a constant height; cut at the image's edges."""
    u0, v0, u1, v1 = box_px
    margin_u, margin_v = _HEAD_MARGIN * (u1 - u0), _HEAD_MARGIN * (v1 - v0)
    rows = slice(max(round(v0 - margin_v), 0), max(round(v1 + margin_v), 1))
    columns = slice(max(round(u0 - margin_u), 0), max(round(u1 + margin_u), 1))
    crop = image[rows, columns]
    if crop.size == 0:
        return np.zeros((_HEAD_HEIGHT_PX, _HEAD_HEIGHT_PX, 3), np.uint8)
    scale = _HEAD_HEIGHT_PX / crop.shape[0]
    size = (max(round(crop.shape[1] * scale), 1), _HEAD_HEIGHT_PX)
    return cv2.resize(crop, size, interpolation=cv2.INTER_CUBIC).astype(np.uint8, copy=False)
