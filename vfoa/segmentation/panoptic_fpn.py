"""Panoptic FPN (Kirillov et al. 2019) as mmdeploy exports MMDetection's (Apache-2.0): what the vfoa paper used.

The graph: ``input`` [1, 3, H, W] RGB by ImageNet's mean and deviation, sides multiples of 32, the image at the upper
left; ``dets`` [1, n, 5] = box in input pixels and score, ``labels`` [1, n] of the 80 things (int64), ``masks``
[1, n, h, w] probabilities inside the boxes, ``semseg`` [1, 54, H', W'] logits of 53 kinds of stuff and, last, of all
things (first in detectron2's own head). The two are merged outside the graph by detectron2's rule: things by score,
unless better ones cover most of them, then stuff on the remaining pixels, if it is large enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vfoa.coco import STUFF, STUFF_IDS, THING_IDS, THINGS
from vfoa.onnx import IMAGENET_MEAN, IMAGENET_SCALE, Model, OnnxSettings, Signature, blob
from vfoa.segmentation.canvas import Canvas, wanted_categories
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.segmentation.placement import Placement, Size, letterboxed, pixel_box, resample
from vfoa.types import Instances, Map, StereoFrame

SIGNATURE = Signature(
    inputs={"input": (1, 3, None, None)},
    outputs={
        "dets": (1, None, 5),
        "labels": (1, None),
        "masks": (1, None, None, None),
        "semseg": (1, len(STUFF_IDS) + 1, None, None),
    },
    integers=frozenset({"labels"}),
)
_MEAN = (124, 116, 104)  # becomes 0 by normalisation: MMDetection pads with 0 after it


class PanopticFpn:
    """Panoptic segmentation of COCO's 80 things and 53 kinds of stuff with MMDetection's Panoptic FPN."""

    class Settings(OnnxSettings, KeyFrameSettings):
        """Settings of the segments to keep, as in detectron2.

        If the graph leaves its size open, the image is scaled to a short side of ``short_side_px``, unless its long
        side would exceed ``long_side_px``, and padded to the next multiple of 32.
        """

        score_threshold: float = Field(default=0.5, gt=0, le=1)
        """Least score of an instance."""
        max_hidden: float = Field(default=0.5, ge=0, le=1)
        """Drop a mask if better ones cover a larger share of it than this."""
        min_stuff_px: int = Field(default=4096, ge=1)
        """Least area of stuff in the image, pixels."""
        labels: tuple[str, ...] = ()
        """COCO's names of the things and stuff to keep; empty keeps all."""
        short_side_px: int = Field(default=800, ge=32)
        """Short side of the network's input, if the graph leaves it open."""
        long_side_px: int = Field(default=1333, ge=32)
        """Greatest long side of the network's input; a longer image gets a smaller short side."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._wanted = wanted_categories(settings.labels, {**THINGS, **STUFF})
        self._model = Model(settings.weights, SIGNATURE, settings)

    def segment(self, frame: StereoFrame) -> Instances:
        """Segment one frame. Ids are 1..n: things, best score first, then stuff, whose score is 1."""
        shape, wished = self._model.input_shape("input"), self._open_size(frame.left.shape[:2])
        image, placement = letterboxed(frame.left, (shape[2] or wished[0], shape[3] or wished[1]), fill=_MEAN)
        outputs = self._model.run(input=blob(image, bgr=False, mean=IMAGENET_MEAN, scale=IMAGENET_SCALE))
        canvas = Canvas(placement.image_size, self.settings.max_hidden)
        self._paint_things(canvas, placement, outputs["dets"][0], outputs["labels"][0], outputs["masks"][0])
        self._paint_stuff(canvas, _argmax(outputs["semseg"][0], placement))
        return canvas.instances()

    def _open_size(self, image_size: tuple[int, ...]) -> Size:
        short, long = sorted(image_size[:2])
        scale = min(self.settings.short_side_px / short, self.settings.long_side_px / long)
        height, width = (32 * max(1, -(-round(side * scale) // 32)) for side in image_size[:2])
        return height, width

    def _paint_things(
        self, canvas: Canvas, placement: Placement, dets: Map, labels: NDArray[np.int64], masks: Map
    ) -> None:
        boxes, scores = placement.to_image(dets[:, :4]), dets[:, 4]
        for n in np.argsort(-scores, kind="stable"):
            if scores[n] < self.settings.score_threshold:
                break
            window, category = pixel_box(boxes[n], placement.image_size), THING_IDS[labels[n]]
            if window and category in self._wanted:
                canvas.paint(resample(masks[n], boxes[n], window) >= 0.5, category, scores[n], window)

    def _paint_stuff(self, canvas: Canvas, classes: NDArray[np.intp]) -> None:
        for n, category in enumerate(STUFF_IDS):
            mask = (classes == n) & canvas.free
            if category in self._wanted and np.count_nonzero(mask) >= self.settings.min_stuff_px:
                canvas.paint(mask, category, 1.0)


def _argmax(logits: Map, placement: Placement) -> NDArray[np.intp]:
    """Return the class (H, W) of each pixel of the image. Works on one channel at a time, to save memory."""
    greatest = placement.whole(logits[0])
    classes = np.zeros(greatest.shape, np.intp)
    for n in range(1, len(logits)):
        upsampled = placement.whole(logits[n])
        better = upsampled > greatest
        classes[better], greatest[better] = n, upsampled[better]
    return classes
