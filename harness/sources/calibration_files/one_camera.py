"""The calibration of a single camera, in the formats of depth data sets and drivers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from harness.files.io import read_text
from harness.files.parsing import parse_json
from harness.sources.calibration_files.documents import read_document, ros_camera
from harness.sources.calibration_files.texts import floats
from harness.sources.depth_optics import lens, without_distortion
from harness.sources.media.maps import read_npy
from harness.sources.rectification import RawCamera
from vfoa.errors import VfoaError

FORMATS = "ROS camera_info YAML, Open3D's or RealSense's intrinsics JSON, K as 3 x 3 numbers, or fx fy cx cy"


def read_one_camera(path: Path, size_px: tuple[int, int], *, rectified: bool = False) -> RawCamera:
    """Return the camera of images of this (width, height).

    - YAML of ROS (``camera_matrix``, ``distortion_coefficients``)
    - JSON: ``intrinsic_matrix`` of Open3D (nine numbers by columns), or ``fx fy ppx ppy`` of RealSense
    - ``.npy`` and text: nine numbers are K by rows, four are fx, fy, cx, cy (GFIE's ``CameraKinect.npy``)

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
            found = ros_camera(read_document(path), str(path))
        case ".json":
            found = _from_json(path, size_px)
        case ".npy":
            found = _from_numbers(path, read_npy(path).ravel(), size_px)
        case _:
            lines = [line.partition("#")[0] for line in read_text(path).splitlines()]
            found = _from_numbers(path, floats(" ".join(lines)), size_px)
    if found.size_px != size_px:
        raise VfoaError(f"{path}: the calibration is for {found.size_px} pixels, the images have {size_px}")
    return without_distortion(found) if rectified else found


def _from_json(path: Path, size_px: tuple[int, int]) -> RawCamera:
    document = parse_json(read_text(path), path)
    if not isinstance(document, Mapping):
        raise VfoaError(f"{path}: expected {FORMATS}")
    try:
        size = (int(document.get("width", size_px[0])), int(document.get("height", size_px[1])))
        if "intrinsic_matrix" in document:
            matrix = np.array(document["intrinsic_matrix"], np.float64).reshape(3, 3).T
            return _from_numbers(path, matrix.ravel(), size)
        names = ["fx", "fy", *(("ppx", "ppy") if "ppx" in document else ("cx", "cy"))]
        return _from_numbers(path, [document[name] for name in names], size)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise VfoaError(f"{path}: found {', '.join(map(str, document))}; expected {FORMATS}") from None


def _from_numbers(path: Path, values: ArrayLike | None, size_px: tuple[int, int]) -> RawCamera:
    """The camera of nine numbers (K by rows) or four (fx, fy, cx, cy)."""
    try:
        found = np.asarray([] if values is None else values, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    if found.size not in (4, 9):
        raise VfoaError(f"{path}: found {found.size} numbers; expected nine (K) or four (fx fy cx cy): {FORMATS}")
    if found.size == 4:
        fx, fy, cx, cy = found
        found = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1])
    k = found.reshape(3, 3)
    if not (np.isfinite(k).all() and k[0, 0] > 0 and k[1, 1] > 0 and k[2, 2] == 1):
        raise VfoaError(f"{path}: found {k.tolist()}; expected K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    return lens(k, size_px)
