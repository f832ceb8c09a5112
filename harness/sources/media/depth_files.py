"""Depth maps in files: PNG or TIFF of 16 bits, npy, EXR, PFM."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from harness.files.io import read_bytes
from harness.sources.media.depth_maps import default_counts_per_m, depth_map
from harness.sources.media.disparity_files import read_pfm
from harness.sources.media.images import MOST_PIXELS, read_raw, too_many_pixels
from harness.sources.media.npy_files import read_npy
from vfoa.errors import VfoaError
from vfoa.types import Map

DEPTH_SUFFIXES = frozenset({".png", ".tif", ".tiff", ".pgm", ".npy", ".exr", ".pfm"})

_CHANNELS = ("Z", "Depth.Z", "ViewLayer.Depth.Z", "V", "Depth.V", "ViewLayer.Depth.V", "Y", "R")
"""Channel names of depth in EXR: of renderers, of Blender, and of programs that write one channel as gray or colour."""

_BACKGROUND = 1e9
"""Renderers write at least this where there is no surface; Blender writes 1e10."""


def read_depth_file(path: Path, counts_per_m: float | None) -> Map:
    """Read the depth (H, W) float32 in metres, NaN where there is none.

    ``counts_per_m`` is the file's unit; None: integers are millimetres, floating point numbers metres.

    Raises
    ------
    VfoaError
        If the file cannot be read, or holds no map of one channel.
    """
    counts = _counts(path)
    if counts.ndim == 3 and counts.shape[2] == 1:
        counts = counts[..., 0]
    is_depth = np.issubdtype(counts.dtype, np.floating) or (
        np.issubdtype(counts.dtype, np.integer) and counts.dtype.itemsize >= 2
    )
    if counts.ndim != 2 or not is_depth:
        raise VfoaError(
            f"{path}: found {counts.dtype.name} with shape {counts.shape}; expected depth in one channel of 16 bits or "
            "of floating point numbers (a picture of depth in 8 bits has lost it)"
        )
    return depth_map(counts, counts_per_m or default_counts_per_m(counts))


def _counts(path: Path) -> NDArray[Any]:
    match path.suffix.lower():
        case ".npy":
            return read_npy(path)
        case ".exr":
            return _read_exr(path)
        case ".pfm":
            return read_pfm(path)
    return read_raw(path)


def _read_exr(path: Path) -> NDArray[Any]:
    read_bytes(path)  # gives a clear error for a damaged file before the library tries
    try:
        with OpenEXR.File(str(path), header_only=True) as file:
            low, high = file.header()["dataWindow"]
            width, height = (high - low + 1).tolist()
        if not 0 < width * height <= MOST_PIXELS:
            raise VfoaError(f"{path}: {too_many_pixels(width, height)}")
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except VfoaError:
        raise
    except Exception as error:  # errors of the library have no common base class
        raise VfoaError(f"{path}: not a readable EXR: {str(error).splitlines()[0]}") from None
    name = next((each for each in _CHANNELS if each in channels), None)
    if name is None:
        raise VfoaError(
            f"{path}: found channels {', '.join(channels)}; expected depth as one of: {', '.join(_CHANNELS)}"
        )
    z = np.asarray(channels[name], np.float32)
    return np.where(z < _BACKGROUND, z, np.float32(np.nan))
