"""The calibration of a single camera, in the formats of depth data sets and drivers."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.io import read_text
from harness.files.parsing import parse_json
from harness.sources.calibration import check_size
from harness.sources.calibration_files.documents import Document, numbers, read_document, ros_camera
from harness.sources.calibration_files.texts import camera_matrix, floats
from harness.sources.depth_optics import pinhole, without_distortion
from harness.sources.rectification import MODELS, RawCamera
from vfoa.errors import VfoaError

FORMATS = "ROS's camera_info (YAML), Open3D's intrinsics or RealSense's fx fy ppx ppy (JSON), or K as 3 x 3 numbers"

_PLACES = (("fx",), ("fy",), ("cx", "ppx"), ("cy", "ppy"))
_COEFFICIENTS, _MODEL = ("coeffs", "distortion"), ("model", "distortion_model")
_OF_LENS = re.compile(r"[kp]_?[1-6]|dist|.*(?:distort|coef).*", re.IGNORECASE)
"""A name of the distortion of a lens."""


def read_one_camera(path: Path, size_px: tuple[int, int], *, rectified: bool = False) -> RawCamera:
    """Return the camera of images of this (width, height).

    - YAML of ROS (``camera_matrix``, ``distortion_coefficients``)
    - JSON of Open3D: ``intrinsic_matrix``, nine numbers by columns
    - JSON of a RealSense's intrinsics by their names in librealsense: ``fx``, ``fy``, ``ppx``, ``ppy`` (or ``cx``,
      ``cy``), ``model``, ``coeffs``, ``width``, ``height``; the last four may be missing
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
            document = parse_json(read_text(path), path)
            is_named = isinstance(document, dict) and "fx" in document
            camera = (_named_camera if is_named else _open3d_camera)(path, document, size_px)
        case _:
            lines = [line.partition("#")[0] for line in read_text(path).splitlines()]
            values = floats(" ".join(lines)) or []
            if len(values) != 9:
                raise VfoaError(f"{path}: found {len(values)} numbers; expected nine (K): {FORMATS}")
            camera = pinhole(camera_matrix(values, path), size_px)
    check_size(size_px, camera.size_px, f"{path}: images")
    return without_distortion(camera) if rectified else camera


def _named_camera(path: Path, document: Document, size_px: tuple[int, int]) -> RawCamera:
    """A camera by names, with the distortion of its lens if the file has it."""

    def known(names: tuple[str, ...], default: Any = None) -> tuple[str, Any]:
        found = [name for name in names if name in document]
        if len(found) > 1 or (not found and default is None):
            what = " and ".join(found) or f"no {' or '.join(names)}"
            raise VfoaError(f"{path}: found {what}; expected one of them: fx, fy, ppx, ppy")
        return (found[0], document[found[0]]) if found else (names[0], default)

    def number(names: tuple[str, ...], default: int | None = None) -> float:
        name, value = known(names, default)
        return float(numbers(value, f"{path}: {name}", 1)[0])

    fx, fy, cx, cy = (number(names) for names in _PLACES)
    width, height = (int(number((name,), size)) for name, size in zip(("width", "height"), size_px, strict=True))
    camera = pinhole(camera_matrix([fx, 0, cx, 0, fy, cy, 0, 0, 1], path), (width, height))
    name, values = known(_COEFFICIENTS, [0.0] * 5)
    d = numbers(values, f"{path}: {name}")
    for other in document.keys() - {*_COEFFICIENTS, *_MODEL}:
        if _OF_LENS.fullmatch(other) and numbers(document[other], f"{path}: {other}").any():
            raise VfoaError(f"{path}: {other}: expected the distortion of the lens as {' or '.join(_COEFFICIENTS)}")
    if not d.any():
        return camera
    name, given = known(_MODEL, "")
    # str() of pyrealsense2's enumeration is distortion.inverse_brown_conrady
    model = str(given) if str(given) in MODELS else str(given).removeprefix("distortion.").replace("_", " ").title()
    if model not in MODELS or d.size not in (4, 5):
        raise VfoaError(
            f"{path}: {name}: found {given!r} with {d.size} coefficients; expected 4 or 5, and a model of RealSense "
            "or ROS, such as brown_conrady"
        )
    return replace(camera, d=d[:4] if MODELS[model] == "equidistant" else d, model=MODELS[model])


def _open3d_camera(path: Path, document: Any, size_px: tuple[int, int]) -> RawCamera:
    try:
        size = (int(document.get("width", size_px[0])), int(document.get("height", size_px[1])))
        by_columns = np.array(document["intrinsic_matrix"], np.float64).reshape(3, 3)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        raise VfoaError(f"{path}: no intrinsic_matrix of nine numbers; expected {FORMATS}") from None
    return pinhole(camera_matrix(by_columns.T, path), size)
