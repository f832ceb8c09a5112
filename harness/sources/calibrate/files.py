"""The calibration as a file: OpenCV's YAML, which ``harness.sources.calibration_files`` reads."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2

from harness.files.io import atomic_write
from harness.sources.calibrate.rescale import SQUARE
from harness.sources.calibrate.solve import StereoCalibration
from harness.sources.calibration_files.read import read_cameras
from harness.sources.rectification import Optics, optics
from vfoa.errors import VfoaError
from vfoa.types import Image

_MATRICES = ("K1", "D1", "K2", "D2", "R", "T", "R1", "R2", "P1", "P2")


def format_calibration(calibration: StereoCalibration, square_m: float) -> str:
    """Return a file's text: size, intrinsics, distortion, pose, rectification, and the side of a square in metres."""
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in zip(("image_width", "image_height"), calibration.size_px, strict=True):
        storage.write(name, value)
    for name in _MATRICES:
        storage.write(name, getattr(calibration, name))
    storage.write(SQUARE, square_m)
    return str(storage.releaseAndGetString())


def read_back(text: str, size_px: tuple[int, int]) -> Optics:
    """Parse a file's text before it is written, and return its optics.

    Raises
    ------
    VfoaError
        If the cameras do not stand side by side, left before right.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "stereo.yml"
        atomic_write(path, text)
        try:
            return optics(read_cameras([path], lambda: size_px))
        except VfoaError as error:
            raise VfoaError(f"calibration: {str(error).removeprefix(f'{path}: ')}; no file is written") from None


def preview_png(picture: Image) -> bytes:
    """An RGB picture as PNG."""
    _, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    return data.tobytes()
