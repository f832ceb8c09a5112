"""Crops of heads and eyes for networks: a fixed size, upright, sampled at sub-pixel positions."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vfoa.types import Flags, Float, Image


def grow(box_px: ArrayLike, *, side: float, top: float, bottom: float) -> Float:
    """Return a box (4,) enlarged by shares of its width (``side``, left and right) and height (``top``, ``bottom``)."""
    u0, v0, u1, v1 = np.asarray(box_px, dtype=np.float64)
    width, height = u1 - u0, v1 - v0
    return np.array([u0 - side * width, v0 - top * height, u1 + side * width, v1 + bottom * height])


def head_box(face_px: ArrayLike) -> Float:
    """Return the box (4,) of a whole head from that of its face, forehead to chin."""
    return grow(face_px, side=0.15, top=0.2, bottom=0.05)


_FACE_ASPECT = 0.72
"""Width of a face's box over its height; of eight faces to the camera and turned from it, 0.63 to 0.84."""
_AT_BORDER = 0.04
"""A box that ends this near to the border of the image, as a share of its width or height, is cut by it."""


def reaches_border(box_px: ArrayLike, image: Image) -> bool:
    """Return whether a box (4,) ends at the border of an image (H, W, 3), so that it may lack a part of its face."""
    return bool(_cut_sides(np.asarray(box_px, dtype=np.float64), image).any())


def completed(face_px: ArrayLike, image: Image) -> Float:
    """Return the box (4,) of a whole face, of which the border of an image (H, W, 3) may cut off a side.

    A detector boxes the part that it sees. The box goes on beyond the border until it has the shape of a face. A box
    that is cut on two sides, or has this shape already, stays.
    """
    face = np.array(face_px, dtype=np.float64)
    cut = _cut_sides(face, image)
    if cut.sum() != 1:
        return face
    ((side,),) = np.nonzero(cut)
    width, height = face[2:] - face[:2]
    of_whole = _FACE_ASPECT * height if side % 2 == 0 else width / _FACE_ASPECT
    missing = max(0.0, of_whole - (width if side % 2 == 0 else height))
    face[side] += missing if side >= 2 else -missing
    return face


def _cut_sides(box: Float, image: Image) -> Flags:
    """Which of the sides (left, top, right, bottom) of a box (4,) end at the border of an image."""
    height, width = image.shape[:2]
    near = _AT_BORDER * np.tile(box[2:] - box[:2], 2)
    return np.concatenate([box[:2] < near[:2], box[2:] > np.array([width - 1, height - 1]) - near[2:]])


def square(center_px: ArrayLike, side_px: float, rows_per_column: float = 1.0) -> Float:
    """Return the box (4,) around a centre (2,) that is a square in the room: ``side_px`` columns wide."""
    u, v = np.asarray(center_px, dtype=np.float64)
    across, down = side_px / 2, side_px / 2 * rows_per_column
    return np.array([u - across, v - down, u + across, v + down])


def center(box_px: ArrayLike) -> Float:
    """Centre (2,) of a box (4,)."""
    u0, v0, u1, v1 = np.asarray(box_px, dtype=np.float64)
    return np.array([(u0 + u1) / 2, (v0 + v1) / 2])


def crop(
    image: Image, box_px: ArrayLike, size_px: int, *, roll_rad: float = 0.0, rows_per_column: float = 1.0
) -> Image:
    """Cut a box (4,) out of an image and resize it to (size, size, 3); a box that is not square is stretched.

    ``roll_rad`` > 0 turns the box clockwise in the room about its centre, so that a head that leans clockwise by this
    angle becomes upright; ``rows_per_column`` rows are as far as a column. Beyond the border, the image's last pixels
    are repeated. A box larger than ``size_px`` is sampled at a whole multiple of that size and averaged, to avoid
    aliasing.
    """
    u0, v0, u1, v1 = np.asarray(box_px, dtype=np.float64)
    width, height = u1 - u0, v1 - v0
    multiple = max(1, math.ceil(max(width, height) / size_px))
    samples = multiple * size_px
    cos, sin = math.cos(roll_rad), math.sin(roll_rad)
    in_room = np.array([[cos * width, -sin * height / rows_per_column], [sin * width, cos * height / rows_per_column]])
    axes = in_room * [[1.0], [rows_per_column]] / samples
    first = center(box_px) - axes @ [(samples - 1) / 2, (samples - 1) / 2]
    sampled = cv2.warpAffine(
        image,
        np.column_stack([axes, first]),
        (samples, samples),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return cv2.resize(sampled, (size_px, size_px), interpolation=cv2.INTER_AREA) if multiple > 1 else sampled
