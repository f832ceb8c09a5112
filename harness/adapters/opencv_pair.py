"""OpenCV's file of an unrectified pair (what ``vfoa calibrate`` writes), with all that rectifies it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from harness.adapters.rectification import RawCalibration, RawCamera
from harness.files import read_bytes
from vfoa.errors import VfoaError
from vfoa.types import Float

_MATRICES = tuple(f"{kind}{side}" for kind in "KDRP" for side in "12")


def read_opencv_pair(path: Path) -> RawCalibration | None:
    """The pair before rectification (K1 D1 R1 P1, K2 D2 R2 P2, image size); None where the file does not hold all.

    Raises
    ------
    VfoaError
        If the file cannot be read, or its matrices describe no pair.
    """
    read_bytes(path)  # OpenCV says nothing of a file that is not there
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        try:
            found = {name: storage.getNode(name).mat() for name in _MATRICES}
            width, height = (int(storage.getNode(name).real()) for name in ("image_width", "image_height"))
        finally:
            storage.release()
    except (cv2.error, SystemError):  # OpenCV's binding raises the latter where parsing failed
        raise VfoaError(f"{path}: cannot be parsed; expected YAML or XML as OpenCV's FileStorage writes it") from None
    matrices = {name: np.asarray(matrix, dtype=np.float64) for name, matrix in found.items() if matrix is not None}
    if len(matrices) < len(_MATRICES) or width <= 0 or height <= 0:
        return None
    left, right = (_camera(matrices, side, (width, height)) for side in "12")
    return RawCalibration(left=left, right=right, where=str(path))


def _camera(matrices: dict[str, Float], side: str, size_px: tuple[int, int]) -> RawCamera:
    return RawCamera(
        size_px=size_px,
        k=matrices[f"K{side}"],
        d=matrices[f"D{side}"].ravel(),
        r=matrices[f"R{side}"],
        p=matrices[f"P{side}"],
    )
