"""MPI Sintel's own kinds of files: cameras, segmentations, masks of hidden pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.files.io import read_bytes
from harness.sources.media.images import read_raw
from vfoa.errors import VfoaError
from vfoa.types import Float, Mask

_CAMERA_TAG = np.float32(202021.25)


def read_camera(path: Path) -> Float:
    """Read the intrinsics M (3, 3), pixels, of a Sintel ``.cam``: float32 tag, float64[9] M, float64[12] N.

    Raises
    ------
    VfoaError
        If the file is not one.
    """
    data = read_bytes(path)
    if len(data) != 4 + 21 * 8 or np.frombuffer(data, "<f4", 1)[0] != _CAMERA_TAG:
        raise VfoaError(f"{path}: not a Sintel camera: expected {4 + 21 * 8} bytes with the tag {_CAMERA_TAG}")
    matrix = np.frombuffer(data, "<f8", 9, offset=4).reshape(3, 3).astype(np.float64)
    if not (np.isfinite(matrix).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise VfoaError(f"{path}: expected finite intrinsics with positive focal lengths, found {matrix.tolist()}")
    return matrix


def read_segments(path: Path) -> NDArray[np.uint32]:
    """Read the ids (H, W) of a segmentation PNG: id = (R 256 + G) 256 + B; VfoaError for another file."""
    image = read_raw(path)
    if image.ndim != 3 or image.dtype != np.uint8:
        raise VfoaError(f"{path}: found shape {image.shape} of {image.dtype}; expected Sintel's 8-bit RGB segmentation")
    return image.astype(np.uint32) @ np.array([65536, 256, 1], dtype=np.uint32)


def read_mask(path: Path) -> Mask:
    """Read a mask (H, W): pixels that are not black; VfoaError if it is no image."""
    image = read_raw(path)
    return (image if image.ndim == 2 else image.max(axis=2)) > 0
