"""The calibration as a file: OpenCV's YAML, which ``harness.adapters.calibration_files`` reads."""

from __future__ import annotations

from pathlib import Path

import cv2

from harness.calibration.solve import StereoCalibration
from harness.files import atomic_write
from vfoa.types import Image

_MATRICES = ("K1", "D1", "K2", "D2", "R", "T", "R1", "R2", "P1", "P2")


def write_calibration(path: Path, calibration: StereoCalibration) -> None:
    """Write size, intrinsics, distortion, pose and rectification, whole or not at all."""
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in zip(("image_width", "image_height"), calibration.size_px, strict=True):
        storage.write(name, value)
    for name in _MATRICES:
        storage.write(name, getattr(calibration, name))
    atomic_write(path, storage.releaseAndGetString())


def write_preview(path: Path, picture: Image) -> None:
    """Write an RGB picture as PNG."""
    _, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    atomic_write(path, data.tobytes())
