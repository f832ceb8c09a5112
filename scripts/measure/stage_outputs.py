"""Write outputs of stages as the files that ``files`` and ``coco_panoptic`` read: for benchmarks and examples."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from harness.files.io import atomic_write
from harness.files.tables import write_rows
from harness.pipeline.configuration import STAGES, Configuration
from harness.pipeline.stage_files.directions import DIRECTION, HEAD_ANGLES
from harness.pipeline.stage_files.heads import BOX, COLUMNS, FACE, KEYS, LANDMARKS
from harness.sources import Clip
from vfoa.errors import VfoaError
from vfoa.pipeline import Stages, perceive
from vfoa.types import Float, Gaze, Head, HeadPose, Instances, Mask, Percepts


def perceive_frames(configuration: Configuration, clip: Clip, numbers: Iterable[int]) -> list[Percepts]:
    """What the stages of a configuration make of some frames, without a cache."""
    built: dict[str, Any] = {
        slot: STAGES[slot].build(choice, clip) if choice else None for slot, choice in configuration.choices.items()
    }
    stages = Stages(
        matcher=built["stereo"],
        segmenter=built["segmentation"],
        heads=built["heads"],
        head_pose=built["head_pose"],
        gaze=built["gaze"],
    )
    return [perceive(clip.frame(number), stages) for number in numbers]


def write_stage_outputs(root: Path, percepts: Sequence[Percepts]) -> None:
    """Write masks, heads, head poses and gazes of frames. The heads of a frame are numbered 1, 2, ... in their order.

    Every number reads back exactly; instances without a pixel are left out.
    """
    views = [
        (percept.index, str(place), view) for percept in percepts for place, view in enumerate(percept.views, start=1)
    ]
    write_coco_panoptic(root, [(percept.index, percept.instances) for percept in percepts])
    write_heads(root / "heads.csv", [(frame, subject, view.head) for frame, subject, view in views])
    poses = [(frame, subject, view.head_pose) for frame, subject, view in views if view.head_pose]
    write_head_poses(root / "head_pose.csv", poses)
    write_gazes(root / "gaze.csv", [(frame, subject, view.gaze) for frame, subject, view in views if view.gaze])


def write_heads(path: Path, rows: Iterable[tuple[int, str, Head]]) -> None:
    """Write heads by frame and subject."""

    def cells(values: Float | None, count: int) -> list[float] | list[None]:
        return [None] * count if values is None else values.ravel().tolist()

    table = [
        (
            *(frame, subject, *cells(head.box_px, len(BOX)), float(head.score)),
            *(*cells(head.face_box_px, len(FACE)), *cells(head.landmarks_px, len(LANDMARKS)), head.instance_id),
        )
        for frame, subject, head in rows
    ]
    write_rows(path, (*KEYS, *COLUMNS), table)


def write_head_poses(path: Path, rows: Iterable[tuple[int, str, HeadPose]]) -> None:
    """Write poses by frame and subject: direction, and angles in radians."""
    table = [
        (
            frame,
            subject,
            *pose.direction.tolist(),
            *(None if math.isnan(angle) else angle for angle in (pose.yaw_rad, pose.pitch_rad, pose.roll_rad)),
            pose.sigma_rad,
        )
        for frame, subject, pose in rows
    ]
    write_rows(path, (*KEYS, *DIRECTION, *(f"{name}_rad" for name in HEAD_ANGLES), "sigma_rad"), table)


def write_gazes(path: Path, rows: Iterable[tuple[int, str, Gaze]]) -> None:
    """Write gazes by frame and subject: direction, and sigma in radians."""
    table = [(frame, subject, *gaze.direction.tolist(), gaze.sigma_rad) for frame, subject, gaze in rows]
    write_rows(path, (*KEYS, *DIRECTION, "sigma_rad"), table)


def write_coco_panoptic(root: Path, frames: Iterable[tuple[int, Instances]]) -> None:
    """Write ``root/panoptic.json`` and ``root/png/frame_<number>.png``, one per frame: id = R + 256 G + 65536 B.

    Each segment has its ``score`` beside COCO's own fields, and its ``name`` if a person drew it.

    Raises
    ------
    VfoaError
        If one category number has two meanings. The JSON, which is written last, is then missing.
    """
    images, annotations, categories = [], [], dict[int, dict[str, Any]]()
    for number, instances in frames:
        name = f"frame_{number:04d}.png"
        ids = instances.ids
        bgr = np.stack([np.zeros_like(ids), ids >> 8, ids & 255], axis=-1).astype(np.uint8)
        atomic_write(root / "png" / name, cv2.imencode(".png", bgr)[1].tobytes())
        images.append({"id": number, "file_name": name, "width": ids.shape[1], "height": ids.shape[0]})
        annotations.append({"image_id": number, "file_name": name, "segments_info": _segments(instances)})
        for instance in instances.instances:
            category = {"id": instance.category_id, "name": instance.label, "isthing": int(instance.is_thing)}
            if categories.setdefault(instance.category_id, category) != category:
                raise VfoaError(
                    f"{root}: category {instance.category_id} is {categories[instance.category_id]['name']!r} and "
                    f"{instance.label!r}; expected one meaning of each number"
                )
    in_order = [categories[key] for key in sorted(categories)]
    content = {"images": images, "annotations": annotations, "categories": in_order}
    atomic_write(root / "panoptic.json", json.dumps(content, ensure_ascii=False) + "\n")


def _segments(instances: Instances) -> list[dict[str, Any]]:
    masks = ((instance, instances.mask(instance.id)) for instance in instances.instances)
    return [
        {
            "id": instance.id,
            "category_id": instance.category_id,
            "iscrowd": 0,
            "bbox": _bbox(mask),
            "area": int(np.count_nonzero(mask)),
            "score": instance.score,
            **({} if instance.name is None else {"name": instance.name}),
        }
        for instance, mask in masks
        if mask.any()
    ]


def _bbox(mask: Mask) -> list[int]:
    """First column, first row, width and height of a mask."""
    u0, v0, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return [u0, v0, width, height]
