"""Crops of heads and eyes for networks: a fixed size, upright, sampled at sub-pixel positions."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vfoa.types import Float, Image


def grow(box_px: ArrayLike, *, side: float, top: float, bottom: float) -> Float:
    """Return a box (4,) enlarged by shares of its width (``side``, left and right) and height (``top``, ``bottom``)."""
    u0, v0, u1, v1 = np.asarray(box_px, dtype=np.float64)
    width, height = u1 - u0, v1 - v0
    return np.array([u0 - side * width, v0 - top * height, u1 + side * width, v1 + bottom * height])


def head_box(face_px: ArrayLike) -> Float:
    """Return the box (4,) of a whole head from that of its face, forehead to chin."""
    return grow(face_px, side=0.15, top=0.2, bottom=0.05)


def square(center_px: ArrayLike, side_px: float) -> Float:
    """Return the square box (4,) around a centre (2,)."""
    u, v = np.asarray(center_px, dtype=np.float64)
    return np.array([u - side_px / 2, v - side_px / 2, u + side_px / 2, v + side_px / 2])


def center(box_px: ArrayLike) -> Float:
    """Centre (2,) of a box (4,)."""
    u0, v0, u1, v1 = np.asarray(box_px, dtype=np.float64)
    return np.array([(u0 + u1) / 2, (v0 + v1) / 2])


def crop(image: Image, box_px: ArrayLike, size_px: int, *, roll_rad: float = 0.0) -> Image:
    """Cut a box (4,) out of an image and resize it to (size, size, 3); a box that is not square is stretched.

    ``roll_rad`` > 0 turns the box clockwise in the image about its centre, so that a head that leans clockwise by this
    angle becomes upright. Beyond the border, the image's last pixels are repeated. A box larger than ``size_px`` is
    sampled at a whole multiple of that size and averaged, to avoid aliasing.
    """
    u0, v0, u1, v1 = np.asarray(box_px, dtype=np.float64)
    width, height = u1 - u0, v1 - v0
    multiple = max(1, math.ceil(max(width, height) / size_px))
    samples = multiple * size_px
    cos, sin = math.cos(roll_rad), math.sin(roll_rad)
    axes = np.array([[cos * width, -sin * height], [sin * width, cos * height]]) / samples
    first = center(box_px) - axes @ [(samples - 1) / 2, (samples - 1) / 2]
    sampled = cv2.warpAffine(
        image,
        np.column_stack([axes, first]),
        (samples, samples),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return cv2.resize(sampled, (size_px, size_px), interpolation=cv2.INTER_AREA) if multiple > 1 else sampled
