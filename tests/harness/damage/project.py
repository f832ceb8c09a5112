"""A small project in which every kind of input file stands and works, to be damaged one file at a time."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np

from harness.clips.manifest import load_manifest
from harness.run.experiment import load_experiment
from tests.calibrations import write_opencv
from tests.disk import labels_text, write_image, write_text
from tests.stage_outputs import save_stage_outputs

MANIFEST = """\
name = "mine"
adapter = "stereo_folder"
root = "../images"

[source]
left = "left"
right = "right"
calibration = "stereo.yml"
rectified = true
rate_hz = 25.0

[subjects.anna]
category = "person"

[targets.mug]
category = "cup"

[targets.book]
category = "book"
"""

EXPERIMENT = """\
clips = ["mine"]

[[configuration]]
name = "only"
stereo = { matcher = "files", root = "stage_outputs", pattern = "disparity/frame_%04d.npy", partial = true }
segmentation = { model = "coco_panoptic", root = "stage_outputs", partial = true }
heads = { detector = "files", root = "stage_outputs" }
head_pose = { model = "files", root = "stage_outputs" }
gaze = { model = "files", root = "stage_outputs" }
"""

LABELS = labels_text("1,3,anna,mug,")


def build(folder: Path) -> Path:
    """Render three frames, save what every stage finds in them, and lay all of it out as somebody's own clip."""
    project = folder / "project"
    experiment = load_experiment("demo", clips=("studio_table",), overrides=("stereo.matcher=bm",))
    save_stage_outputs(project / "stage_outputs", "studio_table", experiment.configurations[0], (1, 2, 3))
    clip = load_manifest("studio_table").open()
    for number in (1, 2, 3):
        frame = clip.frame(number)
        write_image(project / "images" / "left" / f"{number:06d}.png", frame.left)
        write_image(project / "images" / "right" / f"{number:06d}.png", frame.right)
    rig = frame.rig
    k = np.array([[rig.fx_px, 0, rig.cx_px], [0, rig.fy_px, rig.cy_px], [0, 0, 1]])
    nodes = {"K1": k, "D1": np.zeros((1, 5)), "K2": k, "D2": np.zeros((1, 5)), "R": np.eye(3)}
    nodes["T"] = np.array([[-rig.baseline_m], [0], [0]])
    write_opencv(project / "images" / "stereo.yml", nodes, (rig.width_px, rig.height_px))
    write_text(project / "datasets" / "mine.toml", MANIFEST)
    write_text(project / "annotations" / "mine.csv", LABELS)
    write_text(project / "e.toml", EXPERIMENT)
    return project


def copy(project: Path, to: Path) -> Path:
    """The project once more, its files linked: whoever damages one replaces it (:func:`put`)."""
    shutil.copytree(project, to, copy_function=os.link)
    return to


def put(path: Path, data: bytes | str) -> None:
    """Give a file another content, and only this copy of it."""
    path.unlink(missing_ok=True)
    path.write_bytes(data.encode() if isinstance(data, str) else data)
