"""A tiny clip in Sintel's layout with a person and a cup in every frame, which runs without models in no time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from scripts.measure.stage_outputs import write_coco_panoptic
from tests import graphs
from tests.disk import HEIGHT, WIDTH, sintel_scene, write_text
from vfoa.types import Instance, Instances

MANIFEST = """
name = "alley"
adapter = "sintel"
root = "{root}"
[source]
scene = "alley"
"""


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


def write_experiment(folder: Path, numbers: Iterable[int], configurations: str) -> Path:
    """Write an experiment of these configurations on the clip: masks come from files, gazes from windows of frames."""
    numbers = tuple(numbers)
    weights = Path(graphs.seven_levels(folder / "levels.onnx")).as_posix()
    return write_text(
        folder / "alley.toml",
        f"""\
clips = ["{write_clip(folder, numbers).as_posix()}"]
defaults.segmentation = {{ model = "coco_panoptic", root = "{write_masks(folder / "masks", numbers)}" }}
defaults.heads.detector = "person_mask"
defaults.head_pose.model = "none"
defaults.gaze = {{ model = "gaze360", weights = "{weights}", stride = 1 }}
{configurations}""",
    )


def write_matching(folder: Path, numbers: Iterable[int], *copies: str) -> Path:
    """Write an experiment of one configuration without models, on the clip and on copies with these names."""
    numbers = tuple(numbers)
    manifest = write_clip(folder, numbers)
    clips = [manifest, *(manifest.with_name(f"{name}.toml") for name in copies)]
    for clip in clips[1:]:
        write_text(clip, manifest.read_text().replace("alley", clip.stem, 1))
    return write_text(
        folder / "matching.toml",
        f"""\
clips = {[clip.as_posix() for clip in clips]}
[[configuration]]
name = "only"
stereo = {{ matcher = "sgbm", min_depth_m = 1.0 }}
heads.detector = "person_mask"
segmentation = {{ model = "coco_panoptic", root = "{write_masks(folder / "masks", numbers)}" }}
head_pose.model = "none"
gaze.model = "none"
""",
    )
