"""Readers of disparity and depth maps: Sintel PNG, 16-bit PNG, PFM, npy, Sintel .dpt."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.files.io import read_bytes
from harness.sources.media.images import read_raw
from harness.sources.media.npy_files import read_npy
from vfoa.errors import VfoaError
from vfoa.types import Map

_PFM_HEADER = re.compile(rb"(P[fF])\s+(\d+)\s+(\d+)\s+(-?[0-9.eE+-]+)[^\S\n]*\n")
_DPT_TAG = np.float32(202021.25)


def read_disparity(path: Path, *, counts_per_px: float = 256.0) -> Map:
    """Read a disparity map (H, W) float32, pixels, positive; unknown values are NaN.

    ``.npy`` and ``.pfm`` hold pixels. A PNG with three 8-bit channels is Sintel's, one with a single 16-bit channel
    holds ``counts_per_px`` counts per pixel (KITTI: 256), 0 = unknown.

    Raises
    ------
    VfoaError
        If the file cannot be read, is of another kind, or holds no positive disparity but negative ones.
    """
    match path.suffix.lower():
        case ".npy":
            disparity = _read_npy(path)
        case ".pfm":
            disparity = read_pfm(path)
        case ".png":
            disparity = _read_png(path, counts_per_px)
        case other:
            raise VfoaError(f"{path}: cannot read a {other!r} file; expected .npy, .pfm or .png")
    known = np.isfinite(disparity)
    if (known & (disparity < 0)).any() and not (known & (disparity > 0)).any():
        raise VfoaError(f"{path}: every disparity is negative; expected positive ones (x_right = x_left - d)")
    return np.where(known & (disparity > 0), disparity, np.float32(np.nan))


def read_sintel_disparity(path: Path) -> Map:
    """Read MPI Sintel's PNG: d = 4 R + G / 64 + B / 16384, capped at 1024 (the cap is no measurement: NaN)."""
    image = read_raw(path)
    if image.ndim != 3 or image.dtype != np.uint8:
        raise VfoaError(f"{path}: found {_kind(image)}; expected Sintel's 8-bit RGB disparity")
    return _from_sintel(image)


def read_depth(path: Path) -> Map:
    """Read MPI Sintel's .dpt: depth (H, W) float32 in metres; the sky is huge but finite."""
    data = read_bytes(path)
    if len(data) < 12 or np.frombuffer(data, "<f4", 1)[0] != _DPT_TAG:
        raise VfoaError(f"{path}: not a Sintel depth file: expected the tag {_DPT_TAG} in the first 4 bytes")
    width, height = np.frombuffer(data, "<i4", 2, offset=4).tolist()
    if width <= 0 or height <= 0 or len(data) != 12 + 4 * width * height:
        raise VfoaError(f"{path}: found {len(data)} bytes; expected {12 + 4 * width * height} for {width} x {height}")
    return np.frombuffer(data, "<f4", offset=12).reshape(height, width).astype(np.float32)


def read_pfm(path: Path) -> Map:
    """Read a one-channel PFM (H, W) float32: a negative scale means little-endian, rows are stored bottom up."""
    data = read_bytes(path)
    header = _PFM_HEADER.match(data)
    if header is None or header[1] != b"Pf" or not _is_scale(header[4]):
        raise VfoaError(f"{path}: not a one-channel PFM: the header is {data[:20]!r}")
    width, height, order = int(header[2]), int(header[3]), "<" if header[4].startswith(b"-") else ">"
    found, expected = len(data) - header.end(), 4 * width * height
    if found != expected:
        raise VfoaError(f"{path}: found {found} bytes of pixels; expected {expected} for {width} x {height}")
    pixels = np.frombuffer(data, f"{order}f4", offset=header.end()).reshape(height, width)
    return np.ascontiguousarray(pixels[::-1], dtype=np.float32)


def _is_scale(text: bytes) -> bool:
    try:
        return float(text) != 0
    except ValueError:
        return False


def _read_png(path: Path, counts_per_px: float) -> Map:
    image = read_raw(path)
    if image.ndim == 3 and image.dtype == np.uint8:
        return _from_sintel(image)
    if image.ndim == 2 and image.dtype == np.uint16:
        return (image / counts_per_px).astype(np.float32)
    raise VfoaError(f"{path}: found {_kind(image)}; expected 8-bit RGB (Sintel) or one 16-bit channel (KITTI)")


def _from_sintel(image: NDArray[np.uint8]) -> Map:
    disparity = image.astype(np.float32) @ np.array([4, 1 / 64, 1 / 16384], dtype=np.float32)
    return np.where((disparity > 0) & (disparity < 1023.98), disparity, np.float32(np.nan))


def _read_npy(path: Path) -> Map:
    array = read_npy(path)
    if array.ndim != 2 or not np.issubdtype(array.dtype, np.floating):
        raise VfoaError(f"{path}: found {_kind(array)}; expected (H, W) of floating-point pixels")
    with np.errstate(over="ignore"):  # values too large for float32 become infinite, which means unknown
        return array.astype(np.float32)


def _kind(array: NDArray[Any]) -> str:
    return f"shape {array.shape} of {array.dtype}"
