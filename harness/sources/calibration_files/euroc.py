"""EuRoC's ``sensor.yaml``: one file per camera; ``T_BS`` transforms points from the camera to the body, metres."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.sources.calibration_files.documents import numbers
from harness.sources.calibration_files.pose import Lens, rectify_pose
from harness.sources.rectification import Model, RawCalibration
from vfoa.errors import VfoaError
from vfoa.types import Float

_KEYS = ("T_BS", "camera_model", "intrinsics", "distortion_model", "distortion_coefficients", "resolution")
_MODELS: dict[str, Model] = {
    "radial-tangential": "plumb_bob",
    "radtan": "plumb_bob",
    "equidistant": "equidistant",
}


def is_sensor(document: Mapping[str, Any]) -> bool:
    """Whether a document is one camera of EuRoC."""
    return "T_BS" in document and "camera_model" in document


def pair(left: Mapping[str, Any], right: Mapping[str, Any], where: tuple[str, str]) -> RawCalibration:
    """Return the two cameras of a recording; ``where`` are their files.

    Raises
    ------
    VfoaError
        If a key is missing or wrong, the sizes differ, or a camera is no pinhole with a known distortion.
    """
    both = " and ".join(where)
    first, second = (_lens(document, place) for document, place in zip((left, right), where, strict=True))
    sizes = [_size(document, place) for document, place in zip((left, right), where, strict=True)]
    if sizes[0] != sizes[1]:
        raise VfoaError(f"{both}: found {sizes[0]} and {sizes[1]} pixels; expected the same")
    body_from_left, body_from_right = (
        numbers(document["T_BS"], f"{place}: T_BS", 16).reshape(4, 4)
        for document, place in zip((left, right), where, strict=True)
    )
    right_from_left = np.linalg.inv(body_from_right) @ body_from_left
    return rectify_pose(first, second, right_from_left[:3, :3], right_from_left[:3, 3], sizes[0], both)


def _lens(document: Mapping[str, Any], where: str) -> Lens:
    for name in _KEYS:
        if name not in document:
            raise VfoaError(f"{where}: no {name}; expected EuRoC's sensor.yaml")
    camera, distortion = str(document["camera_model"]), str(document["distortion_model"])
    if camera != "pinhole" or distortion not in _MODELS:
        raise VfoaError(f"{where}: model {camera}, {distortion}; expected pinhole with one of {', '.join(_MODELS)}")
    fx, fy, cx, cy = numbers(document["intrinsics"], f"{where}: intrinsics", 4)
    k: Float = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    d = numbers(document["distortion_coefficients"], f"{where}: distortion_coefficients")
    return Lens(k=k, d=d, model=_MODELS[distortion])


def _size(document: Mapping[str, Any], where: str) -> tuple[int, int]:
    width, height = numbers(document["resolution"], f"{where}: resolution", 2)
    return int(width), int(height)
