"""RF-DETR-Seg (Roboflow, Apache-2.0): a transformer with one mask of the whole image per query.

The graph, as Roboflow exports it: ``input`` [1, 3, S, S] RGB by ImageNet's mean and deviation, the image stretched;
``dets`` [1, Q, 4] boxes (unused: masks are finer), ``labels`` [1, Q, 91] logits whose index is COCO's own number,
``masks`` [1, Q, S/4, S/4] logits. A score is sigmoid(logit), a mask logit > 0. No suppression is needed.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from vfoa.coco import THINGS
from vfoa.onnx import IMAGENET_MEAN, IMAGENET_SCALE, Model, OnnxSettings, Signature, blob
from vfoa.segmentation.canvas import Canvas, wanted_categories
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.segmentation.placement import stretched
from vfoa.types import Instances, StereoFrame

SIGNATURE = Signature(
    inputs={"input": (1, 3, None, None)},
    outputs={"dets": (1, None, 4), "labels": (1, None, 91), "masks": (1, None, None, None)},
)


class RfDetrSeg:
    """Instance segmentation of COCO's 80 things with RF-DETR-Seg: the default model."""

    class Settings(OnnxSettings, KeyFrameSettings):
        """Settings of the instances to keep."""

        weights: str = "rfdetr-seg-medium.onnx"
        """Path of the network, or a file's name in the folders of weights."""
        score_threshold: float = Field(default=0.5, gt=0, lt=1)
        """Least score of an instance."""
        max_hidden: float = Field(default=0.5, ge=0, le=1)
        """Drop a mask if better ones cover a larger share of it than this."""
        labels: tuple[str, ...] = ()
        """COCO's names of the things to keep; empty keeps all."""
        input_size_px: int = Field(default=432, ge=24, multiple_of=24)
        """Side of the network's input, if the graph leaves it open."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._wanted = np.array(sorted(wanted_categories(settings.labels, THINGS)))
        self._model = Model(settings.weights, SIGNATURE, settings)

    def segment(self, frame: StereoFrame) -> Instances:
        """Segment one frame. Where masks overlap the better score wins; ids are 1..n, best score first."""
        shape = self._model.input_shape("input")
        size = (shape[2] or self.settings.input_size_px, shape[3] or self.settings.input_size_px)
        image, placement = stretched(frame.left, size)
        outputs = self._model.run(input=blob(image, bgr=False, mean=IMAGENET_MEAN, scale=IMAGENET_SCALE))
        scores = 1 / (1 + np.exp(-outputs["labels"][0][:, self._wanted].astype(np.float64)))
        best, categories = scores.max(axis=1), self._wanted[scores.argmax(axis=1)]
        canvas = Canvas(placement.image_size, self.settings.max_hidden)
        for query in np.argsort(-best, kind="stable"):
            if best[query] < self.settings.score_threshold:
                break
            canvas.paint(placement.whole(outputs["masks"][0, query]) > 0, int(categories[query]), best[query])
        return canvas.instances()
