"""HITNet (Tankovich et al. 2021): learned stereo matching through ONNX, at the network's own size.

The graph takes [1, 2, h, w], the left and the right view in gray from 0 to 1, and returns [1, h, w, 1], the disparity
of the left view in pixels of that input. The pair is stretched to the input, and the map back to the image.

Stretching by s in x makes fx, cx, cx' and every disparity s times as large, so that z = fx B / (d + cx' - cx) is the
same at either size: the disparity divided by s belongs to the rig of the image. Stretching in y moves rows, which a
rectified pair shares, and changes no disparity. The cost is resolution: an error of 1 px in the input is 1 / s px in
the image.

The network finds positive disparities alone. Where the right principal point is farther to the right, infinity has a
negative one: the right view is moved to the left by as many pixels.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from vfoa.errors import VfoaError
from vfoa.onnx import Model, OnnxSettings, Signature
from vfoa.stereo.cut import both_views, cut
from vfoa.stereo.region import Region
from vfoa.types import Disparity, Image, Map, StereoFrame

SIGNATURE = Signature(inputs={"pair": (1, 2, None, None)}, outputs={"disparity": (1, None, None, 1)}, by_position=True)


class HitNet:
    """Stereo matching with HITNet: dense, without confidence, without a least depth to set.

    With its input of 320 x 240, five frames each of Sintel's bandage_2 and of the rendered studio_table (1024 x 436)
    get a disparity on 92 and 96 % of their pixels, with a median error of 1.4 and 0.7 px, in depth 1.5 and 1.8 %;
    semi-global matching reaches 62 and 59 % with 0.4 and 0.2 px. It takes 0.4 s a frame on one CPU thread; its speed
    on a GPU has not been measured.
    """

    class Settings(OnnxSettings):
        """Settings of the network."""

        weights: str = "hitnet_1x240x320_model_float32.onnx"
        """Path of the network, or a file's name in the folders of weights."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._model = Model(settings.weights, SIGNATURE, settings)

    def match(self, frame: StereoFrame) -> Disparity:
        """Match one pair (see :class:`vfoa.stereo.StereoMatcher`).

        Pixels that the network places at infinity or outside the right image are unknown.
        """
        width, height = self._size()
        size = (frame.rig.width_px, frame.rig.height_px)
        left, right = both_views(frame)
        moved_px = max(math.ceil(frame.rig.cx_right_px - frame.rig.cx_px), 0)
        right = cut(right, Region(u0=moved_px, v0=0, u1=moved_px + size[0], v1=size[1]))
        pair = np.stack([_gray(image, (width, height)) for image in (left, right)])[None]
        raw = self._model.run(pair=pair)["disparity"][0, ..., 0]
        of_moved = cv2.resize(raw, size, interpolation=cv2.INTER_NEAREST_EXACT) * np.float32(size[0] / width)
        disparity: Map = of_moved - np.float32(moved_px)
        columns_right = np.arange(size[0]) - disparity
        known = (of_moved > 0) & (columns_right >= 0) & (columns_right <= size[0] - 1)
        return Disparity(disparity_px=np.where(known, disparity, np.float32(np.nan)))

    def _size(self) -> tuple[int, int]:
        _, _, height, width = self._model.input_shape("pair")
        if height is None or width is None:
            raise VfoaError(f"{self._model.path}: leaves its input size open; expected a model with a fixed size")
        return width, height


def _gray(image: Image, size: tuple[int, int]) -> Map:
    """An image in gray from 0 to 1 at a width and height; averaged where it shrinks."""
    method = cv2.INTER_AREA if size[0] < image.shape[1] else cv2.INTER_LINEAR
    gray = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size, interpolation=method)
    return gray.astype(np.float32) / np.float32(255)
