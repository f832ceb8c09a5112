"""The position of an image in a network's input, and of the network's masks in the image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vfoa.types import Float, Image, Map

PixelBox = tuple[int, int, int, int]
"""Pixels of the image: first column, first row, and the column and row after the last ones."""

Size = tuple[int, int]
"""Height and width in pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """An image placed in a network's input of ``input_size``: scaled by (su, sv), then moved by (left, top) pixels."""

    input_size: Size
    image_size: Size
    scale: tuple[float, float]
    offset: tuple[int, int] = (0, 0)

    def to_image(self, boxes: ArrayLike) -> Float:
        """Convert boxes (N, 4), as edges, from the input to the image. Edges lie half a pixel before centres."""
        edges = np.asarray(boxes, dtype=np.float64).reshape(-1, 4)
        return (edges - np.array(self.offset * 2)) / np.array(self.scale * 2)

    def whole(self, grid: Map) -> Map:
        """Resample a grid (h, w) over the whole input to a map (H, W) of the image."""
        height, width = self.image_size
        return self.inside(grid, (0, 0, width, height))

    def inside(self, grid: Map, window: PixelBox) -> Map:
        """Resample a grid (h, w) over the whole input to the image's pixels in a window."""
        height, width = self.input_size
        return resample(grid, self.to_image([0, 0, width, height])[0], window)


def stretched(image: Image, size: Size) -> tuple[Image, Placement]:
    """Resize the image to a size; its aspect ratio may change."""
    height, width = image.shape[:2]
    placement = Placement(input_size=size, image_size=(height, width), scale=(size[1] / width, size[0] / height))
    return _resized(image, (size[1], size[0])), placement


def letterboxed(
    image: Image, size: Size, *, fill: tuple[int, int, int], centered: bool = False
) -> tuple[Image, Placement]:
    """Scale the image into a size with its aspect ratio kept, at the upper left or centred, and fill the rest."""
    height, width = image.shape[:2]
    scale = min(size[0] / height, size[1] / width)
    inner = max(1, round(width * scale)), max(1, round(height * scale))
    left, top = ((size[1] - inner[0]) // 2, (size[0] - inner[1]) // 2) if centered else (0, 0)
    canvas = np.full((*size, 3), fill, np.uint8)
    canvas[top : top + inner[1], left : left + inner[0]] = _resized(image, inner)
    placement = Placement(
        input_size=size,
        image_size=(height, width),
        scale=(inner[0] / width, inner[1] / height),
        offset=(left, top),
    )
    return canvas, placement


def pixel_box(box: ArrayLike, size: Size) -> PixelBox | None:
    """Return the pixels of the image in a box (4,) of edges; None if there are none."""
    limit = np.array([size[1], size[0]] * 2)
    u0, v0, u1, v1 = np.clip(np.rint(np.asarray(box)), 0, limit).astype(int).tolist()
    return (u0, v0, u1, v1) if u0 < u1 and v0 < v1 else None


def resample(grid: Map, extent: ArrayLike, window: PixelBox) -> Map:
    """Resample a grid (h, w), which covers a box (4,) of edges in the image, at the pixels of a window of the image.

    Interpolation is linear between the centres of the cells; the border is repeated beyond the outermost centres.
    Resample logits before comparing them with a threshold, so that outlines are smooth.
    """
    left, top, right, bottom = np.asarray(extent, dtype=np.float64)
    u0, v0, u1, v1 = window
    per_u, per_v = grid.shape[1] / (right - left), grid.shape[0] / (bottom - top)
    first = (u0 + 0.5 - left) * per_u - 0.5, (v0 + 0.5 - top) * per_v - 0.5
    resampled: Map = cv2.warpAffine(
        np.asarray(grid, dtype=np.float32),
        np.array([[per_u, 0, first[0]], [0, per_v, first[1]]]),
        (u1 - u0, v1 - v0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return resampled


def _resized(image: Image, size: tuple[int, int]) -> Image:
    """Resize the image to a width and height; pixels are averaged where it shrinks."""
    method = cv2.INTER_AREA if size[0] < image.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(image, size, interpolation=method), dtype=np.uint8)
