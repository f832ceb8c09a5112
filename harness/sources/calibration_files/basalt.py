"""The cameras in a calibration of Basalt (JSON).

value0: T_imu_cam    of each camera px, py, pz (metres) and the quaternion qx, qy, qz, qw of imu_from_camera
intrinsics   of each camera camera_type and its numbers
resolution   of each camera [width, height]
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.sources.calibration_files.documents import Document, expect_names, named_numbers, numbers
from harness.sources.rectification import Model, RawCalibration, RawCamera, motion_of, rectify_pose
from vfoa.errors import VfoaError, check_known
from vfoa.geometry import rotation_of
from vfoa.types import Float

PROGRAM = "Basalt"
_EXPECTED = f"the calibration of {PROGRAM}"
_MODELS: Mapping[str, tuple[Model, tuple[str, ...]]] = {
    "pinhole": ("plumb_bob", ()),
    "pinhole-radtan8": ("plumb_bob", ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")),
    "kb4": ("equidistant", ("k1", "k2", "k3", "k4")),
}
_KEYS = ("T_imu_cam", "intrinsics", "resolution")


def is_basalt(document: Document) -> bool:
    """Whether a document is of this kind."""
    value = document.get("value0")
    return isinstance(value, Mapping) and "T_imu_cam" in value


def basalt_pair(document: Document, cameras: tuple[int, int], where: str) -> RawCalibration:
    """Return two cameras, left and right, by their numbers.

    Raises
    ------
    VfoaError
        If a camera or a value is missing or wrong, or a camera's model is not one that OpenCV has.
    """
    values = document["value0"]
    expect_names(values, _KEYS, where, _EXPECTED)
    count = min(len(values[key]) if isinstance(values[key], list) else 0 for key in _KEYS)
    if unknown := [number for number in cameras if not 0 <= number < count]:
        raise VfoaError(f"{where}: no camera {unknown[0]}; found {count} cameras, from 0")
    left, right = (_camera(values, number, f"{where}: camera {number}") for number in cameras)
    imu_from_left, imu_from_right = (_pose(values["T_imu_cam"][number], where) for number in cameras)
    right_from_left = np.linalg.inv(imu_from_right) @ imu_from_left
    return rectify_pose(left, right, right_from_left[:3, :3], right_from_left[:3, 3], where)


def _camera(values: Mapping[str, Any], number: int, where: str) -> RawCamera:
    of_camera = values["intrinsics"][number]
    of_camera = of_camera if isinstance(of_camera, Mapping) else {}
    expect_names(of_camera, ("camera_type", "intrinsics"), where, _EXPECTED)
    kind, intrinsics = str(of_camera["camera_type"]), of_camera["intrinsics"]
    check_known(kind, [*_MODELS], f"{where}: camera_type: no")
    model, coefficients = _MODELS[kind]
    fx, fy, cx, cy = named_numbers(intrinsics, ("fx", "fy", "cx", "cy"), where, _EXPECTED)
    width, height = numbers(values["resolution"][number], f"{where}: resolution", 2)
    return RawCamera(
        size_px=(int(width), int(height)),
        k=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        d=np.array(named_numbers(intrinsics, coefficients, where, _EXPECTED)),
        model=model,
    )


def _pose(value: Any, where: str) -> Float:
    """imu_from_camera (4, 4)."""
    where = f"{where}: T_imu_cam"
    quaternion = named_numbers(value, ("qx", "qy", "qz", "qw"), where, _EXPECTED)
    if not any(quaternion):
        raise VfoaError(f"{where}: found a quaternion of zeros; expected a rotation")
    return motion_of(rotation_of(quaternion), named_numbers(value, ("px", "py", "pz"), where, _EXPECTED))
