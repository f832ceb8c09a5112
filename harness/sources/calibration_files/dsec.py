"""The rectified pair in DSEC's ``cam_to_cam.yaml``: 1 and 2 are its cameras of frames, 0 and 3 those of events.

intrinsics: camRect1          of each camera after rectification camera_matrix [fx, fy, cx, cy], resolution [w, h]
disparity_to_depth: cams_12   OpenCV's Q (4, 4) of the pair, metres

Its images are rectified, so that the cameras before it (``cam1``, ``R_rect1``) are not read.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.sources.calibration import Calibration, from_projections
from harness.sources.calibration_files.documents import Document, expect_names, numbers
from vfoa.errors import VfoaError
from vfoa.types import Float

PROGRAM = "DSEC"
FRAMES = (1, 2)
"""The left and the right camera of frames."""


def is_dsec(document: Document) -> bool:
    """Whether a document is of this kind."""
    return document.keys() >= {"intrinsics", "disparity_to_depth"}


def dsec_pair(document: Document, cameras: tuple[int, int], where: str) -> Calibration:
    """Return the rectified pair of two cameras, left and right, by their numbers.

    Raises
    ------
    VfoaError
        If a value is missing or wrong, or the file has no Q of the two cameras, such as of one of each kind.
    """

    def of(table: str, name: str) -> Any:
        values = document[table] if isinstance(document[table], Mapping) else {}
        expect_names(values, (name,), f"{where}: {table}", f"the calibration of {PROGRAM}")
        return values[name]

    def matrix(number: int) -> tuple[Float, tuple[int, int]]:
        name = f"camRect{number}"
        camera = camera if isinstance(camera := of("intrinsics", name), Mapping) else {}
        expect_names(camera, ("camera_matrix", "resolution"), f"{where}: {name}", f"the calibration of {PROGRAM}")
        fx, fy, cx, cy = numbers(camera["camera_matrix"], f"{where}: {name}: camera_matrix", 4)
        width, height = numbers(camera["resolution"], f"{where}: {name}: resolution", 2)
        return np.array([[fx, 0, cx, 0], [0, fy, cy, 0], [0, 0, 1, 0]]), (int(width), int(height))

    left, right = cameras
    (p_left, size_px), (p_right, _) = matrix(left), matrix(right)
    name = f"cams_{left}{right}"
    per_baseline = numbers(of("disparity_to_depth", name), f"{where}: {name}", 16)[14]
    if per_baseline <= 0:
        raise VfoaError(f"{where}: {name}: found {per_baseline:g} for 1 / baseline; expected a positive number")
    p_right[0, 3] = -p_right[0, 0] / per_baseline
    return from_projections(p_left, p_right, f"{where}: camRect{left} and camRect{right}", size_px=size_px)
