"""Middlebury's ``calib.txt`` (2014, 2021; ETH3D's two-view set has the same): rectified images, baseline in mm.

Lines such as ``cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]``, ``cam1=...``, ``baseline=193.001``,
``width=2964``, ``height=1988``. The principal points' columns may differ (``doffs``).
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from harness.sources.calibration import Calibration, from_projections
from vfoa.errors import VfoaError
from vfoa.types import Float

_LINE = re.compile(r"^[ \t]*(\w+)[ \t]*=[ \t]*(.*?)[ \t]*$", re.MULTILINE)


def is_middlebury(text: str) -> bool:
    """Whether a text holds a camera in Middlebury's format."""
    return any(match[1] == "cam0" for match in _LINE.finditer(text))


def read(path: Path, text: str) -> Calibration:
    """Return the rectified pair.

    Raises
    ------
    VfoaError
        If a key is missing, a value is no number or matrix, or the two cameras are no rectified pair.
    """
    values = {match[1]: match[2] for match in _LINE.finditer(text)}
    k_left, k_right = (_matrix(values, name, path) for name in ("cam0", "cam1"))
    baseline_m = _number(values, "baseline", path) / 1000
    size_px = (round(_number(values, "width", path)), round(_number(values, "height", path)))
    left, right = (np.hstack([k, np.zeros((3, 1))]) for k in (k_left, k_right))
    right[0, 3] = -right[0, 0] * baseline_m
    return from_projections(left, right, f"{path}: cam0 and cam1", size_px=size_px)


def _matrix(values: dict[str, str], name: str, path: Path) -> Float:
    words = _value(values, name, path).strip("[]").replace(";", " ").replace(",", " ").split()
    try:
        found = np.array([float(word) for word in words])
    except ValueError:
        found = np.empty(0)
    if found.size != 9 or not np.isfinite(found).all():
        raise VfoaError(f"{path}: {name}: found {values[name][:60]!r}; expected a matrix of 3 x 3 numbers")
    return found.reshape(3, 3)


def _number(values: dict[str, str], name: str, path: Path) -> float:
    try:
        found = float(_value(values, name, path))
    except ValueError:
        found = math.nan
    if not (math.isfinite(found) and found > 0):
        raise VfoaError(f"{path}: {name}: found {values[name][:60]!r}; expected a positive number")
    return found


def _value(values: dict[str, str], name: str, path: Path) -> str:
    if name not in values:
        raise VfoaError(f"{path}: no {name}; expected Middlebury's calib.txt: cam0, cam1, baseline (mm), width, height")
    return values[name]
