"""The calibration of a single camera, in the formats of depth data sets and drivers."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.io import read_bytes, read_text
from harness.files.parsing import parse_json, parse_yaml
from harness.sources.calibration_files import ros
from harness.sources.depth_optics import lens, without_distortion
from harness.sources.rectification import RawCamera
from vfoa.errors import VfoaError
from vfoa.types import Float

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
            found = _from_yaml(path)
        case ".json":
            found = _from_json(path, size_px)
        case ".npy":
            found = _from_numbers(path, _npy(path), size_px)
        case _:
            found = _from_numbers(path, _text_numbers(path), size_px)
    if found.size_px != size_px:
        raise VfoaError(f"{path}: the calibration is for {found.size_px} pixels, the images have {size_px}")
    return without_distortion(found) if rectified else found


def _from_yaml(path: Path) -> RawCamera:
    document = parse_yaml(read_text(path), path)
    if not isinstance(document, dict):
        raise VfoaError(f"{path}: expected {FORMATS}")
    return ros.camera(document, str(path))


def _from_json(path: Path, size_px: tuple[int, int]) -> RawCamera:
    document = parse_json(read_text(path), path)
    if not isinstance(document, Mapping):
        raise VfoaError(f"{path}: expected {FORMATS}")
    try:
        size = (int(document.get("width", size_px[0])), int(document.get("height", size_px[1])))
        if "intrinsic_matrix" in document:
            return lens(_matrix(path, np.array(document["intrinsic_matrix"], np.float64).reshape(3, 3).T), size)
        names = [name if name in document else {"ppx": "cx", "ppy": "cy"}[name] for name in ("ppx", "ppy")]
        values: list[Any] = [document[name] for name in ("fx", "fy", *names)]
        return lens(_k(path, np.array(values, np.float64)), size)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise VfoaError(f"{path}: found {', '.join(map(str, document))}; expected {FORMATS}") from None


def _from_numbers(path: Path, values: Float, size_px: tuple[int, int]) -> RawCamera:
    if values.size == 9:
        return lens(_matrix(path, values.reshape(3, 3)), size_px)
    if values.size == 4:
        return lens(_k(path, values), size_px)
    raise VfoaError(f"{path}: found {values.size} numbers; expected nine (K) or four (fx fy cx cy)")


def _k(path: Path, values: Float) -> Float:
    fx, fy, cx, cy = values
    return _matrix(path, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]))


def _matrix(path: Path, k: Float) -> Float:
    if not (np.isfinite(k).all() and k[0, 0] > 0 and k[1, 1] > 0 and k[2, 2] == 1):
        raise VfoaError(f"{path}: found {k.tolist()}; expected K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    return k


def _text_numbers(path: Path) -> Float:
    lines = [line.partition("#")[0] for line in read_text(path).splitlines()]
    words = " ".join(lines).replace(",", " ").replace(";", " ").replace("[", " ").replace("]", " ").split()
    try:
        return np.array([float(word) for word in words])
    except ValueError:
        raise VfoaError(f"{path}: expected {FORMATS}") from None


def _npy(path: Path) -> Float:

    try:
        return np.lib.format.read_array(io.BytesIO(read_bytes(path)), allow_pickle=False).astype(np.float64).ravel()
    except Exception as error:  # for any damaged file: the header of npy is Python
        raise VfoaError(f"{path}: not an npy file of numbers: {error}") from None
