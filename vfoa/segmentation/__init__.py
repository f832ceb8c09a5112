"""Panoptic segmentation: the pixels of the left view that belong to each object."""

from __future__ import annotations

from typing import Protocol

from vfoa.registry import Registry
from vfoa.types import Instances, StereoFrame


class Segmenter(Protocol):
    """Finds the instances in the left view. Built as ``Class(settings)``, with ``Class.Settings``."""

    def segment(self, frame: StereoFrame) -> Instances:
        """Return the instances of one frame, with ids (H, W) at the resolution of the image."""
        ...


SEGMENTERS = Registry(
    kind="segmentation.model",
    builtin={
        "rf_detr_seg": "vfoa.segmentation.rf_detr_seg:RfDetrSeg",
        "yolo_seg": "vfoa.segmentation.yolo_seg:YoloSeg",
        "mask_rcnn": "vfoa.segmentation.mask_rcnn:MaskRcnn",
        "mask_classification": "vfoa.segmentation.mask_classification:MaskClassification",
        "panoptic_fpn": "vfoa.segmentation.panoptic_fpn:PanopticFpn",
    },
    group="vfoa.segmentation",
)
