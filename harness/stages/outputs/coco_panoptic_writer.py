"""Write segmentations in COCO's panoptic format, as :mod:`harness.stages.outputs.coco_panoptic` reads it."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from harness.files.io import atomic_write
from vfoa.errors import VfoaError
from vfoa.types import Instances, Mask


def write_coco_panoptic(root: Path, frames: Iterable[tuple[int, Instances]]) -> None:
    """Write frame numbers with their instances, one frame at a time. See :class:`CocoPanopticWriter`."""
    writer = CocoPanopticWriter(root)
    for number, instances in frames:
        writer.add(number, instances)
    writer.finish()


class CocoPanopticWriter:
    """Writes ``root/panoptic.json`` and ``root/png/frame_<number>.png``, one per frame: id = R + 256 G + 65536 B.

    Each segment has its ``score`` beside COCO's own fields, and its ``name`` if a person drew it. Instances without a
    pixel are left out. The JSON is written last, so that all files that it names exist.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._images: dict[int, dict[str, Any]] = {}
        self._annotations: dict[int, dict[str, Any]] = {}
        self._categories: dict[int, dict[str, Any]] = {}

    def add(self, number: int, instances: Instances) -> None:
        """Write one frame's PNG.

        Raises
        ------
        VfoaError
            If the frame is added twice, or one category number has two meanings.
        """
        if number in self._annotations:
            raise VfoaError(f"{self._root}: frame {number} occurs twice; expected each frame once")
        name = f"frame_{number:04d}.png"
        atomic_write(self._root / "png" / name, _png(instances))
        height, width = instances.ids.shape
        self._images[number] = {"id": number, "file_name": name, "width": width, "height": height}
        self._annotations[number] = {"image_id": number, "file_name": name, "segments_info": _segments(instances)}
        _gather(self._categories, instances, self._root)

    def finish(self) -> None:
        """Write the JSON."""
        tables = {"images": self._images, "annotations": self._annotations, "categories": self._categories}
        content = {name: [table[key] for key in sorted(table)] for name, table in tables.items()}
        atomic_write(self._root / "panoptic.json", json.dumps(content, ensure_ascii=False) + "\n")


def _png(instances: Instances) -> bytes:
    ids = instances.ids
    bgr = np.stack([np.zeros_like(ids), ids >> 8, ids & 255], axis=-1).astype(np.uint8)
    return cv2.imencode(".png", bgr)[1].tobytes()


def _segments(instances: Instances) -> list[dict[str, Any]]:
    masks = ((each, instances.mask(each.id)) for each in instances.instances)
    return [
        {
            "id": each.id,
            "category_id": each.category_id,
            "iscrowd": 0,
            "bbox": _bbox(mask),
            "area": int(np.count_nonzero(mask)),
            "score": each.score,
            **({} if each.name is None else {"name": each.name}),
        }
        for each, mask in masks
        if mask.any()
    ]


def _bbox(mask: Mask) -> list[int]:
    """First column, first row, width and height of a mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    u0, v0 = int(columns[0]), int(rows[0])
    return [u0, v0, int(columns[-1]) - u0 + 1, int(rows[-1]) - v0 + 1]


def _gather(categories: dict[int, dict[str, Any]], instances: Instances, root: Path) -> None:
    for each in instances.instances:
        category = {"id": each.category_id, "name": each.label, "isthing": int(each.is_thing)}
        known = categories.setdefault(each.category_id, category)
        if known != category:
            raise VfoaError(
                f"{root}: category {each.category_id} is {known['name']!r} and {each.label!r}; "
                "expected one meaning of each number"
            )
