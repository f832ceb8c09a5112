"""Clips without images, made on disk: Anna and Ben talk, a robot stands at the origin, a cup moves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from harness.sources import ADAPTERS, MeasuredClip
from vfoa.geometry import unit

ANNA, BEN, ROBOT = (np.array(place) for place in ([-0.4, 0.0, 1.2], [0.4, 0.05, 1.0], [0.0, 0.0, 0.0]))
PEOPLE_HEADER = (
    "frame,time_ns,person,x_m,y_m,z_m,head_x,head_y,head_z,head_sigma_deg,gaze_x,gaze_y,gaze_z,gaze_sigma_deg"
)
OBJECTS_HEADER = "frame,object,category,x_m,y_m,z_m,size_x_m,size_y_m,size_z_m"
EXPERIMENT = """\
clips = ["talk"]
preset = "measured"
[[configuration]]
name = "cones"
attention.cones_cm = [25]
[[configuration]]
name = "forward"
attention.method = "bayes"
attention.smoothing = "forward"
"""
"""An experiment on a clip ``talk`` of :func:`measured_tables`."""
LABELS_HEADER = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"
START_NS, STEP_NS = 1_700_000_000_000_000_000, 40_000_000


def measured_tables(folder: Path, frames: Sequence[int] = range(1, 13)) -> Path:
    """Both look at each other in the first half, and at the robot in the second; Ben's eyes are not measured."""
    people, objects = [PEOPLE_HEADER], [OBJECTS_HEADER, f",robot,robot,{_cells(ROBOT)},0.3,0.3,0.3"]
    for place, number in enumerate(frames):
        looks = {"anna": BEN, "ben": ANNA} if place < len(frames) / 2 else dict.fromkeys(("anna", "ben"), ROBOT)
        for name, eyes in (("anna", ANNA), ("ben", BEN)):
            towards = _cells(unit(looks[name] - eyes))
            gaze = f"{towards},8" if name == "anna" else ",,,"
            people.append(f"{number},{START_NS + number * STEP_NS},{name},{_cells(eyes)},{towards},5,{gaze}")
        objects.append(f"{number},cup,cup,{0.05 * place},0.4,0.9,,,")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "people.csv").write_text("\n".join(people) + "\n")
    (folder / "objects.csv").write_text("\n".join(objects) + "\n")
    return folder


def true_labels(count: int = 12) -> str:
    """The labels of :func:`measured_tables` with so many frames from 1 on."""
    half = count // 2
    rows = [
        f"{first},{last},{subject},{target},\n"
        for subject, other in (("anna", "ben"), ("ben", "anna"))
        for first, last, target in ((1, half, other), (half + 1, count, "robot"))
    ]
    return LABELS_HEADER + "".join(rows)


def idiap_file(folder: Path, count: int = 6) -> Path:
    """Lines as Idiap's tracker writes them: both look into the camera."""
    lines = [
        f"{START_NS + frame * STEP_NS},{person},10,20,30,40,0,{_cells(eyes)},0,0,0,Robot,0.9,Unfocused,0.1"
        for frame in range(count)
        for person, eyes in ((1, ANNA), (2, BEN))
    ]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "tracker.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def open_measured(adapter: str, root: Path, **source: object) -> MeasuredClip:
    """A clip as a manifest opens it."""
    kind = ADAPTERS.load(adapter)
    clip: MeasuredClip = kind(kind.Settings.model_validate(source), root)
    return clip


def _cells(vector: np.ndarray) -> str:
    return ",".join(repr(float(value)) for value in vector)
