"""Mask classification (Cheng et al. 2021, MaskFormer; Kerssies et al. 2025, EoMT): queries for both things and stuff.

The graph, in the names of ``transformers`` and its exporters: ``pixel_values`` [1, 3, H, W] RGB by ImageNet's mean and
deviation; ``class_queries_logits`` [1, Q, 134] over 80 things, 53 kinds of stuff and "no object",
``masks_queries_logits`` [1, Q, h, w]. Each pixel belongs to the query with the greatest class probability x mask
probability (MaskFormer, section 3.4). A query that loses most of its pixels to others is dropped. Several queries of
the same stuff are one segment.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.coco import STUFF, STUFF_IDS, THING_IDS, THINGS
from vfoa.onnx import IMAGENET_MEAN, IMAGENET_SCALE, Model, OnnxSettings, Signature, blob
from vfoa.segmentation.canvas import Canvas, wanted_categories
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.segmentation.placement import Placement, letterboxed, stretched
from vfoa.types import Float, Instances, Map, Mask, StereoFrame

CATEGORY_IDS = (*THING_IDS, *STUFF_IDS)
"""COCO's own number of the i-th class."""

SIGNATURE = Signature(
    inputs={"pixel_values": (1, 3, None, None)},
    outputs={
        "class_queries_logits": (1, None, len(CATEGORY_IDS) + 1),
        "masks_queries_logits": (1, None, None, None),
    },
)
_BLACK = (0, 0, 0)


class MaskClassification:
    """Panoptic segmentation of COCO's 80 things and 53 kinds of stuff with MaskFormer, EoMT or a relative."""

    class Settings(OnnxSettings, KeyFrameSettings):
        """Settings of the segments to keep. The defaults are those that the models' authors publish."""

        score_threshold: float = Field(default=0.8, gt=0, lt=1)
        """Least score of a query that is kept."""
        min_visible: float = Field(default=0.8, ge=0, lt=1)
        """Least share of its pixels that a query must keep against better ones."""
        labels: tuple[str, ...] = ()
        """COCO's names of the things and stuff to keep; empty keeps all."""
        fit: Literal["pad", "stretch"] = "pad"
        """``pad`` keeps the aspect ratio and pads with black (EoMT), ``stretch`` changes the ratio (MaskFormer)."""
        input_size_px: int = Field(default=640, ge=32, multiple_of=32)
        """Side of the network's input, if the graph leaves it open."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._wanted = wanted_categories(settings.labels, {**THINGS, **STUFF})
        self._model = Model(settings.weights, SIGNATURE, settings)

    def segment(self, frame: StereoFrame) -> Instances:
        """Segment one frame. Each pixel belongs to one query; ids are 1..n, best score first."""
        shape = self._model.input_shape("pixel_values")
        size = (shape[2] or self.settings.input_size_px, shape[3] or self.settings.input_size_px)
        padded = self.settings.fit == "pad"
        image, placement = letterboxed(frame.left, size, fill=_BLACK) if padded else stretched(frame.left, size)
        outputs = self._model.run(pixel_values=blob(image, bgr=False, mean=IMAGENET_MEAN, scale=IMAGENET_SCALE))
        classes = _softmax(outputs["class_queries_logits"][0])
        best, scores = classes.argmax(axis=1), classes.max(axis=1)
        kept = np.flatnonzero((best < len(CATEGORY_IDS)) & (scores > self.settings.score_threshold))
        kept = kept[np.argsort(-scores[kept], kind="stable")]
        masks = self._masks(outputs["masks_queries_logits"][0, kept], scores[kept], placement)
        return self._paint(masks, [CATEGORY_IDS[n] for n in best[kept]], scores[kept], placement)

    def _masks(self, logits: Map, scores: Float, placement: Placement) -> list[Mask]:
        """The pixels that each query keeps: it claims the pixel, and has the greatest score x probability there."""
        from scipy.special import (
            expit,  # not above: it takes as long as NumPy, and every stage is imported to list settings
        )

        height, width = placement.image_size
        owner, greatest = np.full((height, width), -1), np.zeros((height, width), np.float32)
        claims = []
        for n, score in enumerate(scores):
            upsampled = placement.whole(logits[n])
            weighted = np.float32(score) * expit(upsampled)
            better = weighted > greatest
            owner[better], greatest[better] = n, weighted[better]
            claims.append(upsampled >= 0)
        return [self._visible(claim, owner == n) for n, claim in enumerate(claims)]

    def _visible(self, claim: Mask, owned: Mask) -> Mask:
        kept = claim & owned
        enough = np.count_nonzero(kept) > self.settings.min_visible * np.count_nonzero(claim)
        return kept if enough else np.zeros_like(kept)

    def _paint(self, masks: list[Mask], categories: list[int], scores: Float, placement: Placement) -> Instances:
        canvas = Canvas(placement.image_size, max_hidden=1)
        for n, (mask, category) in enumerate(zip(masks, categories, strict=True)):
            if category not in self._wanted or (category in STUFF and category in categories[:n]):
                continue
            same = [same_mask for same_mask, other in zip(masks, categories, strict=True) if other == category]
            canvas.paint(np.any(same, axis=0) if category in STUFF else mask, category, scores[n])
        return canvas.instances()


def _softmax(logits: Map) -> Float:
    """Probabilities (Q, C) of logits (Q, C)."""
    powers = np.exp(logits.astype(np.float64) - logits.max(axis=1, keepdims=True))
    return powers / powers.sum(axis=1, keepdims=True)
