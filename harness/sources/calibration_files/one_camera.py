"""The calibration of a single camera, in the formats of depth data sets and drivers."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.io import read_text
from harness.sources.calibration import check_size
from harness.sources.calibration_files.camera_tables import (
    images_camera,
    is_camera,
    lifted,
    realsense_cameras,
    with_camera_table,
)
from harness.sources.calibration_files.documents import Document, document_suffix, numbers, read_document, ros_camera
from harness.sources.calibration_files.image_size import image_size
from harness.sources.calibration_files.opencv import opencv_camera, says_fisheye
from harness.sources.calibration_files.opencv_names import role_alone
from harness.sources.calibration_files.ros_text import is_ros_text, read_ros_camera
from harness.sources.calibration_files.texts import bare_numbers, camera_matrix, named_numbers
from harness.sources.depth_optics import pinhole, without_distortion
from harness.sources.rectification import MODELS, RawCamera, check_lens
from vfoa.errors import VfoaError, listed

FORMATS = (
    "ROS's camera_info, OpenCV's camera_matrix and dist_coeffs, Open3D's intrinsic_matrix, RealSense's fx fy ppx ppy, "
    "or K as 3 x 3 numbers"
)

_PLACES = (("fx",), ("fy",), ("cx", "ppx"), ("cy", "ppy"))
_COEFFICIENTS, _MODEL = "coeffs", ("model", "distortion_model")
_OF_LENS = re.compile(r"[kp]_?[1-6]|dist|.*(?:distort|coef).*", re.IGNORECASE)
"""A name of the distortion of a lens."""


def read_one_camera(path: Path, size_px: tuple[int, int], *, rectified: bool = False) -> RawCamera:
    """Return the camera of images of this (width, height).

    - ROS (``camera_matrix``, ``projection_matrix`` ...): YAML, also as printed, and the ``.ini`` of its calibrator
    - OpenCV's calibrateCamera: ``camera_matrix``, ``dist_coeffs`` and names like these, in YAML, XML, JSON, ``.npz``
    - Open3D: ``intrinsic_matrix``, nine numbers by columns, in JSON
    - a RealSense's intrinsics by their names in librealsense: ``fx``, ``fy``, ``ppx``, ``ppy`` (or ``cx``, ``cy``),
      ``model``, ``coeffs``, ``width``, ``height``, in JSON or YAML; OpenCV's names of the last four are read,
      too, and they may be missing; all in a table (``intrinsics``), if it is the only one of a camera, that of
      colour beside depth, or of left beside right
    - text: K, nine numbers by rows; ``fx fy cx cy``; or a RealSense's names, each with its number (``fx: 615.2``) in a
      line

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
    if document_suffix(path):
        camera = _of_document(path, with_camera_table(read_document(path), size_px), size_px, rectified=rectified)
    elif is_ros_text(text := read_text(path)):
        camera = read_ros_camera(path, text)
    elif named := named_numbers(text):
        camera = _of_document(path, named, size_px, rectified=rectified)
    else:
        values = bare_numbers(text, lambda: size_px)
        if len(values) != 9 or not np.isfinite(values).all():
            raise VfoaError(f"{path}: found {len(values)} numbers; expected nine (K), or fx fy cx cy: {FORMATS}")
        camera = pinhole(camera_matrix(values, path), size_px)
    check_lens(camera, str(path))
    check_size(size_px, camera.size_px, f"{path}: images")
    return without_distortion(camera) if rectified else camera


def camera_note(path: Path, size_px: tuple[int, int]) -> tuple[str, ...]:
    """A note on the camera of a file with those of several sensors, which decides every direction."""
    top = lifted(read_document(path)) if document_suffix(path) else {}
    name, others = images_camera(top, size_px), [name for name, value in top.items() if is_camera(value)]
    if name is None or len(others) == 1:
        return ()
    return (f"{path.name}: of {listed(others, 4)} the images' camera is {name}: expected depth aligned with it",)


def _of_document(path: Path, document: Document, size_px: tuple[int, int], *, rectified: bool) -> RawCamera:
    if "projection_matrix" in document:
        return ros_camera(document, str(path))
    if "fx" in document:
        return _named_camera(path, document, size_px)
    if isinstance(by_columns := document.get("intrinsic_matrix"), list) and len(by_columns) == 9:
        k = numbers(by_columns, f"{path}: intrinsic_matrix", 9).reshape(3, 3).T
        document = {**document, "intrinsic_matrix": k}
    camera = opencv_camera(document, size_px, str(path), rectified=rectified)
    if camera is None:
        cameras = realsense_cameras(document)
        found = f"the cameras {', '.join(cameras)}" if cameras else listed([str(name) for name in document], 8)
        alone = "that of the images alone, with its values at the top: " if cameras else ""
        raise VfoaError(f"{path}: found {found}; expected {alone}{FORMATS}")
    camera_matrix(camera.k, path)
    _check_lens_is_read(path, document, [name for name in document if role_alone(name) == "D"])
    return camera if camera.d.any() else pinhole(camera.k, camera.size_px)


def _check_lens_is_read(path: Path, document: Document, read: Iterable[str]) -> None:
    """Raise a :class:`VfoaError` for the distortion of a lens under another name than those that are ``read``."""
    for name in document.keys() - {*read, *_MODEL}:
        if _OF_LENS.fullmatch(name) and numbers(document[name], f"{path}: {name}").any():
            raise VfoaError(f"{path}: {name}: expected the distortion of the lens as coeffs or dist_coeffs")


def _named_camera(path: Path, document: Document, size_px: tuple[int, int]) -> RawCamera:
    """A camera by names, with the distortion of its lens if the file has it."""

    def known(names: tuple[str, ...], default: Any = None) -> tuple[str, Any]:
        found = [name for name in names if name in document]
        if len(found) > 1 or (not found and default is None):
            what = " and ".join(found) or f"no {' or '.join(names)}"
            raise VfoaError(f"{path}: found {what}; expected one of them: fx, fy, ppx, ppy")
        return (found[0], document[found[0]]) if found else (names[0], default)

    def number(names: tuple[str, ...]) -> float:
        name, value = known(names)
        return float(numbers(value, f"{path}: {name}", 1)[0])

    fx, fy, cx, cy = (number(names) for names in _PLACES)
    k = camera_matrix([fx, 0, cx, 0, fy, cy, 0, 0, 1], path)
    camera = pinhole(k, image_size(document, k, str(path)) or size_px)
    of_lens = [name for name in document if name == _COEFFICIENTS or role_alone(name) == "D"]
    if len(of_lens) > 1:
        raise VfoaError(f"{path}: found {' and '.join(of_lens)}; expected one of them")
    d = numbers(document[of_lens[0]], f"{path}: {of_lens[0]}") if of_lens else np.zeros(0)
    _check_lens_is_read(path, document, of_lens)
    if not d.any():
        return camera
    name, given = known(_MODEL, "fisheye" if says_fisheye(document) else "")
    # str() of pyrealsense2's enumeration is distortion.inverse_brown_conrady
    model = str(given) if str(given) in MODELS else str(given).removeprefix("distortion.").replace("_", " ").title()
    if model not in MODELS or d.size not in (4, 5):
        raise VfoaError(
            f"{path}: {name}: found {given!r} with {d.size} coefficients; expected 4 or 5, and a model of RealSense "
            "or ROS, such as brown_conrady"
        )
    return replace(camera, d=d[:4] if MODELS[model] == "equidistant" else d, model=MODELS[model])
