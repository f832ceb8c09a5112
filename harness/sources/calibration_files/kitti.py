"""KITTI's calibration text: ``P2: 12 numbers`` (object and odometry sets) or ``P_rect_02:`` (raw recordings)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.sources.calibration import Calibration, from_projections
from vfoa.errors import VfoaError
from vfoa.types import Float


def read(path: Path, text: str, cameras: tuple[int, int]) -> Calibration:
    """Return the rectified pair of two cameras in a file's text: (2, 3) is the colour pair, (0, 1) the gray one.

    Raises
    ------
    VfoaError
        If a line is missing or has a wrong form, or the two are no rectified pair.
    """
    lines = _lines(text)
    matrices = []
    for camera in cameras:
        key = next((key for key in (f"P{camera}", f"P_rect_{camera:02d}") if key in lines), None)
        if key is None:
            raise VfoaError(
                f"{path}: no line P{camera}: or P_rect_{camera:02d}:; expected the calibration of KITTI (those lines), "
                "Middlebury (cam0=[...]) or a camera matrix of 3 x 3 numbers"
            )
        matrices.append(_numbers(path, *lines[key], 12).reshape(3, 4))
    size_key = f"S_rect_{cameras[0]:02d}"
    size = _numbers(path, *lines[size_key], 2).tolist() if size_key in lines else None
    where = f"{path}: P{cameras[0]} and P{cameras[1]}"
    left, right = matrices
    return from_projections(left, right, where, size_px=None if size is None else (int(size[0]), int(size[1])))


def _numbers(path: Path, line: int, text: str, expected: int) -> Float:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise VfoaError(f"{path}:{line}: {error}; expected {expected} numbers") from None
    if values.size != expected:
        raise VfoaError(f"{path}:{line}: found {values.size} numbers; expected {expected}")
    return values


def _lines(text: str) -> dict[str, tuple[int, str]]:
    parts = [(number, *line.partition(":")) for number, line in enumerate(text.splitlines(), start=1)]
    return {key.strip(): (number, rest) for number, key, colon, rest in parts if colon}
