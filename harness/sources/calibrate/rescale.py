"""Correct a calibration with a wrongly measured board: only lengths change, in proportion to the side of a square."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from harness.sources.calibration_files.documents import numbers, read_document
from vfoa.errors import VfoaError

SQUARE = "square_m"
"""The name under which ``vfoa calibrate`` stores the side of a square."""


def rescaled(path: Path, square_m: float) -> str:
    """Return the text of a file of ``vfoa calibrate`` for squares of another side in metres.

    Raises
    ------
    VfoaError
        If the file cannot be read, or does not contain the side that it was made with.
    """
    document = read_document(path)
    if SQUARE not in document:
        raise VfoaError(
            f"{path}: no {SQUARE}; expected a file of vfoa calibrate (for any other: baseline_m = in [source], or "
            "vfoa clips add PATH --baseline)"
        )
    scale = square_m / float(numbers(document[SQUARE], f"{path}: {SQUARE}", 1)[0])
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in document.items():
        if name == SQUARE:
            storage.write(name, square_m)
        elif name == "T":
            storage.write(name, np.asarray(value) * scale)
        elif name in ("P1", "P2"):
            storage.write(name, np.asarray(value) * np.array([1, 1, 1, scale]))
        else:
            storage.write(name, value)
    return str(storage.releaseAndGetString())
