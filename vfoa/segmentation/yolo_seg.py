"""YOLOv8 / YOLO11 instance segmentation: boxes with 32 mask coefficients over 32 shared prototype masks.

The graph, as its makers export it: ``images`` [1, 3, S, S] RGB in [0, 1], letterboxed on gray; ``output0``
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
from vfoa.errors import VfoaError, did_you_mean
from vfoa.onnx import Model, OnnxSettings, Signature, blob
from vfoa.types import Image, Instance, Instances, Map, Mask, StereoFrame

SIGNATURE = Signature(
    inputs={"images": (1, 3, None, None)},
    outputs={"output0": (1, 4 + 80 + 32, None), "output1": (1, 32, None, None)},
)
_GRAY = 114


@dataclass(frozen=True, slots=True, kw_only=True)
class _Letterbox:
    """How an image lies in the network's square: scaled by (su, sv), then moved by whole pixels (left, top)."""

    scale: tuple[float, float]
    offset: tuple[int, int]

    @classmethod
    def fit(cls, image: Image, size: tuple[int, int]) -> tuple[Image, _Letterbox]:
        height, width = image.shape[:2]
        scale = min(size[0] / height, size[1] / width)
        inner = max(1, round(width * scale)), max(1, round(height * scale))
        offset = (size[1] - inner[0]) // 2, (size[0] - inner[1]) // 2
        canvas = np.full((*size, 3), _GRAY, np.uint8)
        method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        canvas[offset[1] : offset[1] + inner[1], offset[0] : offset[0] + inner[0]] = cv2.resize(
            image, inner, interpolation=method
        )
        return canvas, cls(scale=(inner[0] / width, inner[1] / height), offset=offset)

    def to_image(self, boxes: Map) -> Map:
        """Boxes (N, 4), as edges, from the network's square to the image."""
        offset: Map = np.array(self.offset * 2, np.float32)
        scale: Map = np.array(self.scale * 2, np.float32)
        return (boxes - offset) / scale


@dataclass(frozen=True, slots=True, kw_only=True)
class _Detections:
    """Best first: boxes (N, 4) as edges (u0, v0, u1, v1) in the network's square, scores, classes, coefficients."""

    boxes: Map
    scores: Map
    classes: NDArray[np.intp]
    coefficients: Map


class YoloSeg:
    """Instance segmentation of COCO's 80 things with a YOLO-seg network. The weights of its makers are AGPL-3.0."""

    class Settings(OnnxSettings):
        """What to keep. ``labels`` are COCO's names of things; none given: all of them.

        ``max_hidden`` drops a mask of which better ones cover a larger share: a second find of the same thing
        (the fusion rule of Kirillov et al. 2019, Panoptic FPN). ``input_size_px`` counts only where the graph leaves
        its size open.
        """

        score_threshold: float = Field(default=0.25, gt=0, le=1)
        nms_iou: float = Field(default=0.7, gt=0, le=1)
        max_hidden: float = Field(default=0.5, ge=0, le=1)
        labels: tuple[str, ...] = ()
        input_size_px: int = Field(default=640, ge=32, multiple_of=32)

    def __init__(self, settings: Settings) -> None:
        for label in settings.labels:
            if label not in THINGS.values():
                raise VfoaError(f"labels: no thing {label!r} in COCO; {did_you_mean(label, THINGS.values())}")
        self.settings = settings
        self._wanted = np.array([THINGS[id_] in (settings.labels or THINGS.values()) for id_ in THING_IDS])
        self._model = Model(settings.weights, SIGNATURE, settings)

    def segment(self, frame: StereoFrame) -> Instances:
        """Segment one frame. Where masks overlap the better score wins; ids are 1..n, best score first."""
        shape = self._model.input_shape("images")
        size = (shape[2] or self.settings.input_size_px, shape[3] or self.settings.input_size_px)
        image, letterbox = _Letterbox.fit(frame.left, size)
        found = self._model.run(images=blob(image, bgr=False, scale=1 / 255))
        return self._paint(
            self._detections(found["output0"][0]), found["output1"][0], letterbox, size, frame.left.shape[:2]
        )

    def _detections(self, output: Map) -> _Detections:
        """Keep what is wanted and scores enough, then suppress what overlaps a better one of its class."""
        classes, scores = output[4:84].argmax(axis=0), output[4:84].max(axis=0)
        kept = np.flatnonzero(self._wanted[classes] & (scores >= self.settings.score_threshold))
        classes, scores, (cx, cy, w, h) = classes[kept], scores[kept], output[:4, kept]
        corners = np.stack([cx - w / 2, cy - h / 2, w, h], axis=-1)
        chosen = cv2.dnn.NMSBoxesBatched(
            corners.tolist(), scores.tolist(), classes.tolist(), self.settings.score_threshold, self.settings.nms_iou
        )
        best = np.asarray(chosen, dtype=np.intp).reshape(-1)
        best = best[np.argsort(-scores[best], kind="stable")]
        boxes = np.concatenate([corners[best, :2], corners[best, :2] + corners[best, 2:]], axis=-1)
        return _Detections(
            boxes=boxes, scores=scores[best], classes=classes[best], coefficients=output[84:, kept[best]].T
        )

    def _paint(
        self,
        detections: _Detections,
        prototypes: Map,
        letterbox: _Letterbox,
        size: tuple[int, int],
        shape: tuple[int, int],
    ) -> Instances:
        """Draw the masks at the image's size, best first, each on what is free; skip what is mostly hidden."""
        logits = np.tensordot(detections.coefficients, prototypes, axes=1)
        stride = size[1] / prototypes.shape[2], size[0] / prototypes.shape[1]
        ids = np.zeros(shape, np.uint16)
        instances: list[Instance] = []
        for n, box in enumerate(letterbox.to_image(detections.boxes)):
            u0, v0, u1, v1 = _pixels(box, shape)
            if u0 >= u1 or v0 >= v1:
                continue
            mask = _mask(logits[n], (u0, v0, u1, v1), letterbox, stride)
            free = mask & (ids[v0:v1, u0:u1] == 0)
            if not free.any() or free.sum() < (1 - self.settings.max_hidden) * mask.sum():
                continue
            category_id = THING_IDS[detections.classes[n]]
            instances.append(
                Instance(
                    id=len(instances) + 1,
                    label=THINGS[category_id],
                    category_id=category_id,
                    is_thing=True,
                    score=float(detections.scores[n]),
                )
            )
            ids[v0:v1, u0:u1][free] = len(instances)
        return Instances(ids=ids, instances=tuple(instances))


def _pixels(box: Map, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """First pixel in the box and first after it, per axis, within the image; the box is given as edges."""
    limit = np.array([shape[1], shape[0]] * 2)
    u0, v0, u1, v1 = np.clip(np.rint(box), 0, limit).astype(int).tolist()
    return u0, v0, u1, v1


def _mask(logits: Map, box: tuple[int, int, int, int], letterbox: _Letterbox, stride: tuple[float, float]) -> Mask:
    """The mask (v1 - v0, u1 - u0) inside one box, from logits (h, w) in the prototypes' grid.

    Interpolated before the threshold, so that outlines are smooth; sigmoid(x) > 0.5 is x > 0.
    """
    u0, v0, u1, v1 = box
    per_u, per_v = letterbox.scale[0] / stride[0], letterbox.scale[1] / stride[1]
    first_u = (u0 + 0.5) * per_u + letterbox.offset[0] / stride[0] - 0.5
    first_v = (v0 + 0.5) * per_v + letterbox.offset[1] / stride[1] - 0.5
    inside: Map = cv2.warpAffine(
        logits,
        np.array([[per_u, 0, first_u], [0, per_v, first_v]]),
        (u1 - u0, v1 - v0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return inside > 0
