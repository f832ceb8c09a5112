"""YOLOv8 / YOLO11 instance segmentation: boxes with 32 mask coefficients over 32 shared prototype masks.

The graph, as Ultralytics exports it: ``images`` [1, 3, S, S] RGB in [0, 1], letterboxed on gray; ``output0``
[1, 116, P] = centre and size of P boxes in input pixels, 80 class scores, 32 coefficients; ``output1``
[1, 32, S/4, S/4] the prototypes. A mask is sigmoid(coefficients . prototypes) > 0.5 inside its box.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vfoa.coco import THING_IDS, THINGS
from vfoa.onnx import Model, OnnxSettings, Signature, blob
from vfoa.segmentation.canvas import Canvas, wanted_categories
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.segmentation.placement import Placement, letterboxed, pixel_box
from vfoa.types import Instances, Map, StereoFrame

SIGNATURE = Signature(
    inputs={"images": (1, 3, None, None)},
    outputs={"output0": (1, 4 + 80 + 32, None), "output1": (1, 32, None, None)},
)
_NMS_IOU = 0.7
"""Of two boxes of one class that overlap more (intersection over union), the weaker is dropped."""
_GRAY = (114, 114, 114)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Detections:
    """Boxes (N, 4) as edges (u0, v0, u1, v1) in the network's square, scores, classes, coefficients; best first."""

    boxes: Map
    scores: Map
    classes: NDArray[np.intp]
    coefficients: Map


class YoloSeg:
    """Instance segmentation of COCO's 80 things with a YOLO-seg network. Ultralytics' weights are AGPL-3.0."""

    class Settings(OnnxSettings, KeyFrameSettings):
        """Settings of the instances to keep."""

        score_threshold: float = Field(default=0.25, gt=0, le=1)
        """Least score of an instance."""
        max_hidden: float = Field(default=0.5, ge=0, le=1)
        """Drop a mask if better ones cover a larger share of it than this."""
        labels: tuple[str, ...] = ()
        """COCO's names of the things to keep; empty keeps all."""
        input_size_px: int = Field(default=640, ge=32, multiple_of=32)
        """Side of the network's input, if the graph leaves it open."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        wanted = wanted_categories(settings.labels, THINGS)
        self._wanted = np.array([id_ in wanted for id_ in THING_IDS])
        self._model = Model(settings.weights, SIGNATURE, settings)

    def segment(self, frame: StereoFrame) -> Instances:
        """Segment one frame. Where masks overlap the better score wins; ids are 1..n, best score first."""
        shape = self._model.input_shape("images")
        size = (shape[2] or self.settings.input_size_px, shape[3] or self.settings.input_size_px)
        image, placement = letterboxed(frame.left, size, fill=_GRAY, centered=True)
        outputs = self._model.run(images=blob(image, bgr=False, scale=1 / 255))
        return self._paint(self._detections(outputs["output0"][0]), outputs["output1"][0], placement)

    def _detections(self, output: Map) -> _Detections:
        """Keep wanted classes with enough score, then suppress boxes that overlap a better one of their class."""
        classes, scores = output[4:84].argmax(axis=0), output[4:84].max(axis=0)
        kept = np.flatnonzero(self._wanted[classes] & (scores >= self.settings.score_threshold))
        classes, scores, (cx, cy, w, h) = classes[kept], scores[kept], output[:4, kept]
        corners = np.stack([cx - w / 2, cy - h / 2, w, h], axis=-1)
        chosen = cv2.dnn.NMSBoxesBatched(
            corners.tolist(), scores.tolist(), classes.tolist(), self.settings.score_threshold, _NMS_IOU
        )
        best = np.asarray(chosen, dtype=np.intp).reshape(-1)
        best = best[np.argsort(-scores[best], kind="stable")]
        boxes = np.concatenate([corners[best, :2], corners[best, :2] + corners[best, 2:]], axis=-1)
        return _Detections(
            boxes=boxes, scores=scores[best], classes=classes[best], coefficients=output[84:, kept[best]].T
        )

    def _paint(self, detections: _Detections, prototypes: Map, placement: Placement) -> Instances:
        """Draw the masks inside their boxes at the image's size, best first. sigmoid(x) > 0.5 is x > 0."""
        logits = np.tensordot(detections.coefficients, prototypes, axes=1)
        canvas = Canvas(placement.image_size, self.settings.max_hidden)
        for n, box in enumerate(placement.to_image(detections.boxes)):
            if window := pixel_box(box, placement.image_size):
                mask = placement.inside(logits[n], window) > 0
                canvas.paint(mask, THING_IDS[detections.classes[n]], detections.scores[n], window)
        return canvas.instances()
