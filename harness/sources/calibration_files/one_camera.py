"""The calibration of a single camera, in the formats of depth data sets and drivers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.files.io import read_text
from harness.files.parsing import parse_json
from harness.sources.calibration import check_size
from harness.sources.calibration_files.documents import read_document, ros_camera
from harness.sources.calibration_files.texts import camera_matrix, floats
from harness.sources.depth_optics import pinhole, without_distortion
from harness.sources.rectification import RawCamera
from vfoa.errors import VfoaError

FORMATS = "ROS's camera_info (YAML), Open3D's intrinsics (JSON), or K as 3 x 3 numbers"


def read_one_camera(path: Path, size_px: tuple[int, int], *, rectified: bool = False) -> RawCamera:
    """Return the camera of images of this (width, height).

    - YAML of ROS (``camera_matrix``, ``distortion_coefficients``)
    - JSON of Open3D: ``intrinsic_matrix``, nine numbers by columns
    - text: K, nine numbers by rows

    Parameters
    ----------
    path, size_px
        The file, and the size of the images that it is for.
    rectified
        The images have no distortion, whatever the file says of the lens.

    Raises
    ------
    VfoaError
        If the file is of none of these kinds, or of a camera of another size.
    """
    match path.suffix.lower():
        case ".yaml" | ".yml":
            camera = ros_camera(read_document(path), str(path))
        case ".json":
            camera = _open3d_camera(path, size_px)
        case _:
            lines = [line.partition("#")[0] for line in read_text(path).splitlines()]
            values = floats(" ".join(lines)) or []
            if len(values) != 9:
                raise VfoaError(f"{path}: found {len(values)} numbers; expected nine (K): {FORMATS}")
            camera = pinhole(camera_matrix(values, path), size_px)
    check_size(size_px, camera.size_px, f"{path}: images")
    return without_distortion(camera) if rectified else camera


def _open3d_camera(path: Path, size_px: tuple[int, int]) -> RawCamera:
    document = parse_json(read_text(path), path)
    try:
        size = (int(document.get("width", size_px[0])), int(document.get("height", size_px[1])))
        by_columns = np.array(document["intrinsic_matrix"], np.float64).reshape(3, 3)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise VfoaError(f"{path}: no intrinsic_matrix of nine numbers; expected {FORMATS}") from None
    return pinhole(camera_matrix(by_columns.T, path), size)
