"""A generated clip of any length, with labels, the outputs of its stages, and an experiment of four configurations.

A person looks at one of three objects after the other. Images have 160 x 120 pixels, at 25 Hz.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from scripts.measure.stage_outputs import write_coco_panoptic, write_gazes, write_heads
from vfoa.types import Gaze, Head, Instance, Instances

WIDTH, HEIGHT, SHIFT_PX = 160, 120, 8
PERSON_PX, THINGS = (slice(10, 110), slice(62, 98)), ("cup", "book", "bottle")
FIXATION = 40
"""Frames of a look."""

_CLIP = """
name = "generated"
adapter = "stereo_folder"
root = "{root}"
source.left = "left"
source.right = "right"
source.rate_hz = 25.0
source.camera = {{ fx_px = 100.0, cx_px = 80.0, cy_px = 60.0, baseline_m = 0.1 }}
subjects.ann.category = "person"
targets.cup.category = "cup"
targets.book.category = "book"
targets.bottle.category = "bottle"
"""

_EXPERIMENT = """
clips = ["{clip}"]
[defaults]
stereo = {{ matcher = "bm", min_depth_m = 0.5 }}
segmentation = {{ model = "coco_panoptic", root = "{outputs}" }}
heads = {{ detector = "files", root = "{outputs}" }}
head_pose.model = "none"
gaze = {{ model = "files", root = "{outputs}" }}

[[configuration]]
name = "one-cone"
[[configuration]]
name = "two-cones"
attention.cones_cm = [10.0, 25.0]
[[configuration]]
name = "filtered"
gaze_filter.cues = "gaze"
[[configuration]]
name = "nearest"
attention.method = "nearest"
"""


def write_clip(root: Path, frames: int) -> Path:
    """Write the clip, its labels and the outputs of its stages; return the experiment."""
    outputs = root / "outputs"
    _write_views(root, frames)
    write_coco_panoptic(outputs, [(number, _masks()) for number in range(1, frames + 1)])
    head = Head(box_px=np.array([70.0, 12.0, 90.0, 36.0]), score=0.9, instance_id=1)
    write_heads(outputs / "heads.csv", [(number, "1", head) for number in range(1, frames + 1)])
    rng = np.random.default_rng(0)
    gazes = [(number, "1", _gaze(number, rng)) for number in range(1, frames + 1)]
    write_gazes(outputs / "gaze.csv", gazes)
    clip = root / "datasets" / "generated.toml"
    clip.parent.mkdir()
    clip.write_text(_CLIP.format(root=root.as_posix()), encoding="utf-8")
    write_labels(root, frames)
    experiment = root / "hours.toml"
    experiment.write_text(_EXPERIMENT.format(clip=clip.as_posix(), outputs=outputs.as_posix()), encoding="utf-8")
    return experiment


def write_labels(root: Path, frames: int, *, edited: int | None = None) -> None:
    """Write the person's targets, look by look; the look with the frame ``edited`` gets another target."""
    lines = ["# vfoa annotations 1", "first_frame,last_frame,subject,target,note"]
    for first in range(1, frames + 1, FIXATION):
        last = min(first + FIXATION - 1, frames)
        wrong = edited is not None and first <= edited <= last
        lines.append(f"{first},{last},ann,{THINGS[(_looked_at(first) + wrong) % len(THINGS)]},")
    path = root / "annotations" / "generated.csv"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _write_views(root: Path, frames: int) -> None:
    """A coarse texture at one depth, and a bright bar that moves, so that every frame differs."""
    rng = np.random.default_rng(1)
    coarse = rng.integers(40, 200, (HEIGHT // 3, (WIDTH + SHIFT_PX) // 3, 3), dtype=np.uint8)
    texture = cv2.resize(coarse, (WIDTH + SHIFT_PX, HEIGHT), interpolation=cv2.INTER_NEAREST)
    for side in ("left", "right"):
        (root / side).mkdir(parents=True)
    for number in range(1, frames + 1):
        scene = texture.copy()
        scene[number % HEIGHT] = 255
        cv2.imwrite(str(root / "left" / f"{number:06d}.png"), scene[:, :WIDTH])
        cv2.imwrite(str(root / "right" / f"{number:06d}.png"), scene[:, SHIFT_PX:])


def _masks() -> Instances:
    ids = np.zeros((HEIGHT, WIDTH), np.uint16)
    ids[PERSON_PX] = 1
    instances: list[Any] = [Instance(id=1, label="person", category_id=1, is_thing=True, score=0.9)]
    for place, name in enumerate(THINGS):
        ids[80:104, 8 + 18 * place : 20 + 18 * place] = 2 + place
        instances.append(Instance(id=2 + place, label=name, category_id=47 + place, is_thing=True, score=0.9))
    return Instances(ids=ids, instances=tuple(instances))


def _looked_at(number: int) -> int:
    return ((number - 1) // FIXATION) % len(THINGS)


def _gaze(number: int, rng: np.random.Generator) -> Gaze:
    """The direction from the head's middle to the object's, all at one depth, with an error of a few degrees."""
    target_px = np.array([14.0 + 18 * _looked_at(number), 92.0])
    offset = np.append((target_px - [80.0, 24.0]) / 100.0, 0.0) + rng.normal(0, 0.06, 3)
    return Gaze(direction=offset / np.linalg.norm(offset), sigma_rad=0.06)
