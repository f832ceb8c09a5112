"""A tiny clip in Sintel's layout with a person and a cup in every frame, which runs without models in no time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from scripts.measure.stage_outputs import write_coco_panoptic
from tests.disk import HEIGHT, WIDTH, sintel_scene, write_text
from vfoa.types import Instance, Instances

MANIFEST = """
name = "alley"
adapter = "sintel"
root = "{root}"
[source]
scene = "alley"
"""

STAGES = """
defaults.segmentation = {{ model = "coco_panoptic", root = "{masks}" }}
defaults.heads.detector = "person_mask"
defaults.head_pose.model = "none"
defaults.gaze = {{ model = "gaze360", weights = "{weights}", stride = 1 }}
"""
"""Stages of every configuration of an experiment on the clip, to be filled in: ``masks`` and ``weights`` are files."""


def write_clip(folder: Path, numbers: Iterable[int]) -> Path:
    """Write the clip's images and its manifest, which is returned."""
    root = sintel_scene(folder / "data", frames=tuple(numbers))
    return write_text(folder / "datasets" / "alley.toml", MANIFEST.format(root=root.as_posix()))


def write_masks(folder: Path, numbers: Iterable[int]) -> str:
    """Write the same masks for each frame; return the folder as an experiment names it."""
    person = Instance(id=1, label="person", category_id=1, is_thing=True, score=0.9)
    cup = Instance(id=2, label="cup", category_id=47, is_thing=True, score=0.9)
    ids = np.zeros((HEIGHT, WIDTH), np.uint16)
    ids[10:, 8:28], ids[20:35, 40:55] = 1, 2
    masks = Instances(ids=ids, instances=(person, cup))
    write_coco_panoptic(folder, [(number, masks) for number in numbers])
    return folder.as_posix()
