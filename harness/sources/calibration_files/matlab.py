"""Calibrations of MATLAB's Stereo Camera Calibrator: its struct in JSON, or its matrices in a file of OpenCV or MATLAB.

``jsonencode(toStruct(stereoParams))`` has, in a table of its own or not::

    {"CameraParameters1": {"RadialDistortion": [k1, k2], "TangentialDistortion": [p1, p2], "ImageSize": [720, 1280],
      "WorldUnits": "millimeters", "IntrinsicMatrix": [[fx, 0, 0], [s, fy, 0], [cx, cy, 1]]},
     "CameraParameters2": {...}, "RotationOfCamera2": [[...]], "TranslationOfCamera2": [-119.9, 1.1, -0.7]}

Scripts that write the matrices alone number them: ``IntrinsicMatrix1``, ``RadialDistortion1``. MATLAB multiplies rows
by matrices, x_camera2 = x_camera1 R + t, so R and the intrinsic matrix are OpenCV's, transposed; K, in newer versions,
is not. The middle of the first pixel is 1, 1.

Bouguet's Camera Calibration Toolbox saves ``Calib_Results_stereo.mat`` with ``fc_left``, ``cc_left``, ``kc_left`` ...
and ``R``, ``T``, in OpenCV's conventions and mm, as its board is.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.sources.calibration_files.documents import Document, expect_names, numbers
from harness.sources.rectification import ImageSize, RawCalibration, RawCamera, rectify_pose
from vfoa.errors import VfoaError

PROGRAM = "MATLAB"

_POSE = ("RotationOfCamera2", "TranslationOfCamera2")
_LENS = ("RadialDistortion", "TangentialDistortion")
_MATRICES = ("IntrinsicMatrix", "K")
_TOOLBOX = (*(f"{name}_{side}" for side in ("left", "right") for name in ("fc", "cc", "kc")), "R", "T")
_UNITS_M = {
    **dict.fromkeys(("millimeters", "mm"), 0.001),
    **dict.fromkeys(("centimeters", "cm"), 0.01),
    **dict.fromkeys(("meters", "m"), 1.0),
    **dict.fromkeys(("inches", "in"), 0.0254),
}


def is_matlab(document: Document) -> bool:
    """Whether a document holds a pair of MATLAB, whose lens distortion is split into radial and tangential."""
    values = _inner(document)
    return "CameraParameters1" in values or "RadialDistortion1" in values or values.keys() >= {*_TOOLBOX}


def matlab_pair(document: Document, size: ImageSize, where: str, *, has_unit: bool) -> RawCalibration:
    """Return the pair, metres; in the file's own unit if ``has_unit`` (the user gives it) or the file has none.

    Raises
    ------
    VfoaError
        If a name is missing, a matrix is of no camera, or a camera has a skew.
    """
    values = _inner(document)
    if values.keys() >= {*_TOOLBOX}:
        return _toolbox_pair(values, size, where, unit_m=1.0 if has_unit else 0.001)
    expect_names(values, _POSE, where, f"MATLAB's jsonencode(toStruct(stereoParams)) with {' and '.join(_POSE)}")
    first, second = (_camera_values(values, number, where) for number in "12")
    rotation = numbers(values["RotationOfCamera2"], f"{where}: RotationOfCamera2", 9).reshape(3, 3).T
    translation = numbers(values["TranslationOfCamera2"], f"{where}: TranslationOfCamera2", 3)
    unit_m = 1.0 if has_unit else _UNITS_M.get(str(first.get("WorldUnits", "")).lower(), 1.0)
    left, right = (
        _camera(camera, size, f"{where}: camera {number}") for number, camera in enumerate((first, second), start=1)
    )
    return rectify_pose(left, right, rotation, unit_m * translation, where)


def _toolbox_pair(values: Document, size: ImageSize, where: str, *, unit_m: float) -> RawCalibration:
    """The pair of Bouguet's toolbox."""

    def camera(side: str) -> RawCamera:
        focal, centre = (numbers(values[f"{name}_{side}"], f"{where}: {name}_{side}", 2) for name in ("fc", "cc"))
        (skew,) = numbers(values.get(f"alpha_c_{side}", 0.0), f"{where}: alpha_c_{side}", 1)
        width, height = (values.get(name) for name in ("nx", "ny"))
        is_sized = width is not None and height is not None
        return RawCamera(
            size_px=(int(numbers(width, where, 1)[0]), int(numbers(height, where, 1)[0])) if is_sized else size(),
            k=np.array([[focal[0], skew * focal[0], centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]),
            d=numbers(values[f"kc_{side}"], f"{where}: kc_{side}", 5),
        )

    rotation = numbers(values["R"], f"{where}: R", 9).reshape(3, 3)
    translation = numbers(values["T"], f"{where}: T", 3)
    return rectify_pose(camera("left"), camera("right"), rotation, unit_m * translation, where)


def _inner(document: Document) -> Document:
    """The values of a document, or those of its only table: ``{"stereoParams": {...}}``."""
    tables = [value for value in document.values() if isinstance(value, Mapping) and "CameraParameters1" in value]
    return tables[0] if len(tables) == 1 else document


def _camera_values(values: Document, number: str, where: str) -> Document:
    """The values of a camera, under MATLAB's names without a number."""
    if "CameraParameters1" in values:
        expect_names(values, (f"CameraParameters{number}",), where, "MATLAB's two cameras")
        camera: Any = values[f"CameraParameters{number}"]
        if not isinstance(camera, Mapping):
            raise VfoaError(f"{where}: CameraParameters{number}: found {camera!r}; expected a table")
        return camera
    shared = {name: values[name] for name in ("ImageSize", "WorldUnits") if name in values}
    own = (*_LENS, *_MATRICES, "ImageSize", "WorldUnits")
    return shared | {name: values[f"{name}{number}"] for name in own if f"{name}{number}" in values}


def _camera(camera: Document, size: ImageSize, where: str) -> RawCamera:
    if "K" in camera:
        k = numbers(camera["K"], f"{where}: K", 9).reshape(3, 3)
    else:
        expect_names(camera, ("IntrinsicMatrix",), where, "MATLAB's IntrinsicMatrix or K")
        k = numbers(camera["IntrinsicMatrix"], f"{where}: IntrinsicMatrix", 9).reshape(3, 3).T
    k = k - np.outer([1, 1, 0], [0, 0, 1])
    expect_names(camera, _LENS, where, "MATLAB's lens distortion")
    radial, tangential = (numbers(camera[name], f"{where}: {name}") for name in _LENS)
    if radial.size not in (2, 3) or tangential.size != 2:
        found = f"{radial.size} radial and {tangential.size} tangential coefficients"
        raise VfoaError(f"{where}: {' and '.join(_LENS)}: found {found}; expected 2 or 3 radial and 2 tangential ones")
    given = numbers(camera.get("ImageSize", []), f"{where}: ImageSize")
    return RawCamera(
        size_px=(int(given[1]), int(given[0])) if given.size == 2 else size(),
        k=k,
        d=np.concatenate([radial[:2], tangential, radial[2:]]),
    )
