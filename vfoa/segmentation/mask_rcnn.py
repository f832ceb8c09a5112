"""Mask R-CNN (He et al. 2017) of torchvision (BSD-3-Clause): boxes, each with a mask.

The graph, as ``torch.onnx.export`` writes it for one image: [3, H, W] RGB in [0, 1]; boxes [N, 4], labels [N] in
COCO's own numbers (int64), scores [N], masks [N, 1, H, W] > 0.5 at the size of the input. Exporters choose the names,
not the order. Resizing, normalisation and suppression are part of the graph.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from vfoa.coco import THINGS
from vfoa.onnx import Model, OnnxSettings, Signature, blob
from vfoa.segmentation.canvas import Canvas, wanted_categories
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.segmentation.placement import pixel_box, stretched
from vfoa.types import Instances, StereoFrame

SIGNATURE = Signature(
    inputs={"image": (3, None, None)},
    outputs={"boxes": (None, 4), "labels": (None,), "scores": (None,), "masks": (None, 1, None, None)},
    integers=frozenset({"labels"}),
    by_position=True,
)


class MaskRcnn:
    """Instance segmentation of COCO's 80 things with torchvision's Mask R-CNN."""

    class Settings(OnnxSettings, KeyFrameSettings):
        """Settings of the instances to keep."""

        score_threshold: float = Field(default=0.5, gt=0, le=1)
        """Least score of an instance."""
        max_hidden: float = Field(default=0.5, ge=0, le=1)
        """Drop a mask if better ones cover a larger share of it than this."""
        labels: tuple[str, ...] = ()
        """COCO's names of the things to keep; empty keeps all."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._wanted = wanted_categories(settings.labels, THINGS)
        self._model = Model(settings.weights, SIGNATURE, settings)

    def segment(self, frame: StereoFrame) -> Instances:
        """Segment one frame. Where masks overlap the better score wins; ids are 1..n, best score first."""
        shape, (height, width) = self._model.input_shape("image"), frame.left.shape[:2]
        image, placement = stretched(frame.left, (shape[1] or height, shape[2] or width))
        outputs = self._model.run(image=blob(image, bgr=False, scale=1 / 255)[0])
        canvas = Canvas(placement.image_size, self.settings.max_hidden)
        boxes = placement.to_image(outputs["boxes"])
        for n in np.argsort(-outputs["scores"], kind="stable"):
            if outputs["scores"][n] < self.settings.score_threshold:
                break
            # The mask may extend one pixel beyond its box, which is rounded.
            window = pixel_box(boxes[n] + [-1, -1, 1, 1], placement.image_size)
            if window and int(outputs["labels"][n]) in self._wanted:
                mask = placement.inside(outputs["masks"][n, 0], window) > 0.5
                canvas.paint(mask, int(outputs["labels"][n]), outputs["scores"][n], window)
        return canvas.instances()
