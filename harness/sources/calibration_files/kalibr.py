"""Kalibr's camera chain: ``T_cn_cnm1`` transforms points of the preceding camera into this camera's frame, metres."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.sources.calibration_files.documents import numbers
from harness.sources.calibration_files.pose import Lens, rectify_pose
from harness.sources.rectification import Model, RawCalibration
from vfoa.errors import VfoaError
from vfoa.types import Float

_CAMERA = re.compile(r"cam\d+")
_MODELS: dict[str, tuple[Model, int]] = {
    "radtan": ("plumb_bob", 4),
    "equidistant": ("equidistant", 4),
    "none": ("plumb_bob", 0),
}


def is_camchain(document: Mapping[str, Any]) -> bool:
    """Whether a document holds cameras of Kalibr."""
    return any(_CAMERA.fullmatch(str(name)) and isinstance(value, Mapping) for name, value in document.items())


def pair(document: Mapping[str, Any], cameras: tuple[int, int], where: str) -> RawCalibration:
    """Return two cameras of the chain, left and right, by their numbers.

    Raises
    ------
    VfoaError
        If a camera or a key is missing, or a camera's model is not pinhole with radtan, equidistant or none.
    """
    (left, left_size), (right, right_size) = (_lens(document, number, where) for number in cameras)
    if left_size != right_size:
        raise VfoaError(
            f"{where}: cam{cameras[0]} is {left_size} pixels, cam{cameras[1]} {right_size}; expected the same"
        )
    first, last = sorted(cameras)
    last_from_first: Float = np.eye(4)
    for number in range(first + 1, last + 1):
        step = numbers(_get(document, number, "T_cn_cnm1", where), f"{where}: cam{number}: T_cn_cnm1", 16)
        last_from_first = step.reshape(4, 4) @ last_from_first
    if cameras[0] != first:
        last_from_first = np.asarray(np.linalg.inv(last_from_first), dtype=np.float64)
    rotation, translation = last_from_first[:3, :3], last_from_first[:3, 3]
    return rectify_pose(left, right, rotation, translation, left_size, where)


def _lens(document: Mapping[str, Any], number: int, where: str) -> tuple[Lens, tuple[int, int]]:
    here = f"{where}: cam{number}"
    camera, distortion = (str(_get(document, number, f"{kind}_model", where)) for kind in ("camera", "distortion"))
    if camera != "pinhole" or distortion not in _MODELS:
        raise VfoaError(f"{here}: model {camera}-{distortion}; expected pinhole with one of {', '.join(_MODELS)}")
    model, count = _MODELS[distortion]
    fx, fy, cx, cy = numbers(_get(document, number, "intrinsics", where), f"{here}: intrinsics", 4)
    k: Float = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    coefficients = _get(document, number, "distortion_coeffs", where) if count else []
    d = numbers(coefficients, f"{here}: distortion_coeffs", count)
    width, height = numbers(_get(document, number, "resolution", where), f"{here}: resolution", 2)
    return Lens(k=k, d=d, model=model), (int(width), int(height))


def _get(document: Mapping[str, Any], number: int, key: str, where: str) -> Any:
    camera = document.get(f"cam{number}")
    if not isinstance(camera, Mapping):
        there = ", ".join(sorted(name for name in map(str, document) if _CAMERA.fullmatch(name)))
        raise VfoaError(f"{where}: no cam{number}; expected one of {there}")
    if key not in camera:
        raise VfoaError(f"{where}: cam{number}: no {key}; expected Kalibr's camera chain")
    return camera[key]
