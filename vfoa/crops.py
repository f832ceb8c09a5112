"""Crops of heads and eyes for networks: as a camera sees them that looks at them, of a fixed size."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfoa.geometry import back_project, left_from_crop, length_of, unit
from vfoa.types import Flags, Float, Head, Image, StereoFrame, StereoRig


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
_HEAD_ASPECT = 0.75
"""Width of a head's box over its height: that of :func:`head_box` of a face of this shape."""
_AT_BORDER = 0.04
"""A box that ends this near to the border of the image, as a share of its width or height, is cut by it."""


def reaches_border(box_px: ArrayLike, image: Image) -> bool:
    """Return whether a box (4,) ends at the border of an image (H, W, 3), so that it may lack a part of its face."""
    return bool(_cut_sides(np.asarray(box_px, dtype=np.float64), image).any())


def completed(face_px: ArrayLike, image: Image) -> Float:
    """Return the box (4,) of a whole face, of which the border of an image (H, W, 3) may cut off a side.

    A detector boxes the part that it sees. The box goes on beyond the border until it has the shape of a face.
    """
    return _completed(face_px, image, _FACE_ASPECT)


def whole_head(head: Head, image: NDArray[Any]) -> Float:
    """Return the box (4,) of a whole head, of which the border of an image (H, W, ...) may cut off a side.

    The part that is missing is that of the face (:func:`completed`); of a head without one, that of its own box.
    """
    if head.face_box_px is None:
        return _completed(head.box_px, image, _HEAD_ASPECT)
    return head.box_px + head_box(completed(head.face_box_px, image)) - head_box(head.face_box_px)


def _completed(box_px: ArrayLike, image: NDArray[Any], aspect: float) -> Float:
    """The box (4,), moved out on the side that is cut until its width is ``aspect`` of its height.

    A box that has this shape, or is longer in the direction that is cut, stays; so does one that is cut on two sides.
    """
    box = np.array(box_px, dtype=np.float64)
    cut = _cut_sides(box, image)
    if cut.sum() != 1:
        return box
    ((side,),) = np.nonzero(cut)
    width, height = box[2:] - box[:2]
    of_whole = aspect * height if side % 2 == 0 else width / aspect
    missing = max(0.0, of_whole - (width if side % 2 == 0 else height))
    box[side] += missing if side >= 2 else -missing
    return box


def _cut_sides(box: Float, image: NDArray[Any]) -> Flags:
    """Which of the sides (left, top, right, bottom) of a box (4,) end at the border of an image."""
    height, width = image.shape[:2]
    near = _AT_BORDER * np.tile(box[2:] - box[:2], 2)
    return np.concatenate([box[:2] < near[:2], box[2:] > np.array([width - 1, height - 1]) - near[2:]])


def center(box_px: ArrayLike) -> Float:
    """Centre (2,) of a box (4,)."""
    u0, v0, u1, v1 = np.asarray(box_px, dtype=np.float64)
    return np.array([(u0 + u1) / 2, (v0 + v1) / 2])


@dataclass(frozen=True, slots=True, kw_only=True)
class CropCamera:
    """A camera in the place of the left one, turned to a head or an eye: its image is the crop that a network gets.

    A part of the left image is not what such a camera sees: 40 degrees beside the axis a face is a third wider than
    high, and leans. A network takes that for a turn of the head, by 5 degrees on average there, and 7 to 11 at 50
    (3DDFA_V2 on photographs seen so; 2 by this camera). So it is usual in gaze estimation to turn the camera by
    software: Sugano et al. 2014, Learning-by-synthesis; Zhang et al. 2018, Revisiting data normalization.

    ``left_from_crop`` (3, 3) turns directions in the crop's axes (:mod:`vfoa.geometry`) to the left camera's. The image
    reaches from -``half`` to ``half`` (2,): the tangents of the angles to its right and lower sides.
    """

    left_from_crop: Float
    half: Float

    @classmethod
    def at(cls, box_px: ArrayLike, rig: StereoRig) -> Self:
        """Return the camera that looks at the middle of a box (4,) and sees as much as it."""
        u0, v0, u1, v1 = np.asarray(box_px, dtype=np.float64)
        sides = back_project([u0, u1, (u0 + u1) / 2, (u0 + u1) / 2], [(v0 + v1) / 2, (v0 + v1) / 2, v0, v1], 1, rig)
        axes = left_from_crop(unit(sides).sum(axis=0))
        seen = sides @ axes
        (left, _), (right, _), (_, top), (_, bottom) = seen[:, :2] / seen[:, 2:]
        return cls(left_from_crop=axes, half=np.array([right - left, bottom - top]) / 2)

    @classmethod
    def towards(cls, ray_left: Float, half: float) -> Self:
        """Return the camera with a square image that looks along a ray (3,)."""
        return cls(left_from_crop=left_from_crop(ray_left), half=np.array([half, half]))

    @property
    def ray_left(self) -> Float:
        """Unit ray (3,) in the middle of the image, in the left camera's axes."""
        return self.left_from_crop[:, 2]

    def image(self, frame: StereoFrame, size_px: int, *, roll_rad: float = 0.0) -> Image:
        """Return what it sees as (size, size, 3): sides of other lengths are stretched.

        ``roll_rad`` > 0 turns the camera clockwise, so that a head that leans clockwise by this angle becomes upright.
        Beyond the border, the left image's last pixels are repeated. What is larger than ``size_px`` in the left image
        is sampled at a whole multiple of that size and averaged, to avoid aliasing.
        """
        cos, sin = math.cos(roll_rad), math.sin(roll_rad)
        rolled = self.left_from_crop @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        left_from_square = frame.rig.camera_matrix @ rolled @ np.diag([*self.half, 1])
        ends = left_from_square @ np.array([[-1, 0, 1], [1, 0, 1], [0, -1, 1], [0, 1, 1]]).T
        (left, right, top, bottom) = (ends[:2] / ends[2]).T
        extent_px = max(float(length_of(right - left)), float(length_of(bottom - top)))
        multiple = max(1, math.ceil(extent_px / size_px - 0.01))
        samples = multiple * size_px
        first, step = 1 / samples - 1, 2 / samples
        sampled = cv2.warpPerspective(
            frame.left,
            left_from_square @ np.array([[step, 0, first], [0, step, first], [0, 0, 1]]),
            (samples, samples),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return cv2.resize(sampled, (size_px, size_px), interpolation=cv2.INTER_AREA) if multiple > 1 else sampled
