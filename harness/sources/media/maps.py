"""Maps in files, one number per pixel: disparity, depth, segment ids."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import PIL.Image
from numpy.typing import NDArray

from harness.files.io import read_bytes
from harness.files.parsing import check_archive
from harness.sources.media.images import MOST_PIXELS, read_raw, too_many_pixels
from vfoa.errors import VfoaError, listed, reported_as
from vfoa.types import Map


def read_npy(path: Path) -> NDArray[Any]:
    """Read an array of numbers of an ``.npy``, or the only one of an ``.npz``; no pickle.

    Raises
    ------
    VfoaError
        If it cannot be read, is no such file, or holds several arrays.
    """
    if path.suffix.lower() == ".npz":
        return _only_array(path)
    with reported_as(f"{path}: not an npy file"), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a file that Python 2 wrote
        return np.lib.format.read_array(io.BytesIO(read_bytes(path)), allow_pickle=False)


def _only_array(path: Path) -> NDArray[Any]:
    data = read_bytes(path)
    check_archive(data, path)
    with reported_as(f"{path}: not an npz file"), np.load(io.BytesIO(data), allow_pickle=False) as file:
        names = file.files
        array = file[names[0]] if len(names) == 1 else None
    if array is None:
        raise VfoaError(f"{path}: found the arrays {listed(names, 4) or 'none'}; expected one array in a file")
    return np.asarray(array)


MILLIMETRES = 1000.0


def depth_map(counts: NDArray[Any], counts_per_m: float) -> Map:
    """Depth (H, W) float32 in metres; NaN where the sensor has 0, NaN, infinity or a negative number."""
    with np.errstate(all="ignore"):  # NaN and infinity, as in a damaged file
        values = counts.astype(np.float32) / np.float32(counts_per_m)
    return np.where((values > 0) & np.isfinite(values), values, np.float32(np.nan))


def default_counts_per_m(counts: NDArray[Any]) -> float:
    """The default unit: integers are millimetres and floating point numbers metres."""
    return MILLIMETRES if np.issubdtype(counts.dtype, np.integer) else 1.0


_COUNTS_PER_PX = 256.0
"""Scale of a disparity map as a PNG with one 16-bit channel: KITTI's."""
_PFM_HEADER = re.compile(rb"(P[fF])\s+(\d+)\s+(\d+)\s+([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)[^\S\n]*\n")


def read_disparity(path: Path) -> Map:
    """Read a disparity map (H, W) float32, pixels, positive; unknown values are NaN.

    ``.npy``, ``.npz``, ``.pfm`` and ``.exr`` hold pixels. A PNG with three 8-bit channels is Sintel's, one with a
    single 16-bit channel holds 256 counts per pixel (KITTI), 0 = unknown.

    Raises
    ------
    VfoaError
        If the file cannot be read, is of another kind, such as a picture, or holds mostly negative disparities.
    """
    pixels, is_png = _pixels(path), path.suffix.lower() == ".png"
    if is_png and pixels.ndim == 3 and pixels.dtype == np.uint8:
        _check_no_picture(pixels, path)
        disparity = pixels.astype(np.float32) @ np.array([4, 1 / 64, 1 / 16384], dtype=np.float32)
        disparity = np.where(disparity < 1023.98, disparity, np.float32(np.nan))
    elif is_png and pixels.ndim == 2 and pixels.dtype == np.uint16:
        disparity = (pixels / _COUNTS_PER_PX).astype(np.float32)
    elif pixels.ndim == 2 and np.issubdtype(pixels.dtype, np.floating):
        # values too large for float32 become infinite, which means unknown, as do signalling NaNs, which would warn
        with np.errstate(over="ignore", invalid="ignore"):
            disparity = pixels.astype(np.float32)
    else:
        raise VfoaError(
            f"{path}: found shape {pixels.shape} of {pixels.dtype}; expected floating-point pixels, or a PNG of 8-bit "
            "RGB (Sintel) or one 16-bit channel (KITTI)"
        )
    known = np.isfinite(disparity)
    is_positive, negative = known & (disparity > 0), disparity[known & (disparity < 0)]
    positive = np.count_nonzero(is_positive)
    # some programs write -1, or another number, for unknown
    if negative.size > positive and (positive == 0 or np.ptp(negative) > 0):
        found = f"{negative.size} of {negative.size + positive} disparities are negative"
        raise VfoaError(f"{path}: {found}; expected positive ones (x_right = x_left - d)")
    return np.where(is_positive, disparity, np.float32(np.nan))


_COLOURS, _FEWEST, _LEAST_SPREAD = 256, 1024, 64
"""Most colours of a picture of a map; of how many pixels they are; the least spread of their red, of Sintel 256 px."""


def _check_no_picture(pixels: NDArray[np.uint8], path: Path) -> None:
    """Raise a :class:`VfoaError` for a map that was drawn in colours, by every fourth pixel of every fourth row."""
    some = pixels[::4, ::4].reshape(-1, 3).astype(np.uint32)
    is_judged = len(some) >= _FEWEST and np.ptp(some[:, 0]) >= _LEAST_SPREAD
    if is_judged and np.unique(some @ np.array([1 << 16, 1 << 8, 1])).size <= _COLOURS:
        raise VfoaError(
            f"{path}: a picture of disparity, in at most {_COLOURS} colours; expected its numbers: .npy, .pfm, or a "
            "PNG with one 16-bit channel of 256 counts per pixel"
        )


def read_pfm(path: Path) -> Map:
    """Read a one-channel PFM (H, W) float32: a negative scale means little-endian, rows are stored bottom up."""
    data = read_bytes(path)
    header = _PFM_HEADER.match(data)
    if header is None or header[1] != b"Pf" or float(header[4]) == 0:
        raise VfoaError(f"{path}: not a one-channel PFM: the header is {data[:20]!r}")
    width, height, order = int(header[2]), int(header[3]), "<" if header[4].startswith(b"-") else ">"
    n_bytes, expected = len(data) - header.end(), 4 * width * height
    if n_bytes != expected:
        raise VfoaError(f"{path}: found {n_bytes} bytes of pixels; expected {expected} for {width} x {height}")
    pixels = np.frombuffer(data, f"{order}f4", offset=header.end()).reshape(height, width)
    return np.ascontiguousarray(pixels[::-1], dtype=np.float32)


DEPTH_SUFFIXES = frozenset({".png", ".tif", ".tiff", ".pgm", ".npy", ".npz", ".exr", ".pfm"})

_CHANNELS = ("Z", "Depth.Z", "ViewLayer.Depth.Z", "V", "Depth.V", "ViewLayer.Depth.V", "Y", "R")
"""Channel names of depth in EXR: of renderers, of Blender, and of programs that write one channel as gray or colour."""

_BACKGROUND = 1e9
"""Renderers write at least this where there is no surface; Blender writes 1e10."""


def read_depth_file(path: Path, counts_per_m: float | None, of_integers: float | None = None) -> Map:
    """Read the depth (H, W) float32 in metres, NaN where there is none.

    ``counts_per_m`` is the file's unit; None: that of integers is ``of_integers``, by default millimetres, and floating
    point numbers are metres.

    Raises
    ------
    VfoaError
        If the file cannot be read, or holds no map of one channel.
    """
    counts = _pixels(path)
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
    if np.issubdtype(counts.dtype, np.integer):
        counts_per_m = counts_per_m or of_integers
    return depth_map(counts, counts_per_m or default_counts_per_m(counts))


def _pixels(path: Path) -> NDArray[Any]:
    match path.suffix.lower():
        case ".npy" | ".npz":
            return read_npy(path)
        case ".exr":
            return _read_exr(path)
        case ".pfm":
            return read_pfm(path)
    return read_raw(path)


def _read_exr(path: Path) -> NDArray[Any]:
    read_bytes(path)  # gives a clear error for a damaged file before the library tries
    with reported_as(f"{path}: not a readable EXR"):
        with OpenEXR.File(str(path), header_only=True) as file:
            low, high = file.header()["dataWindow"]
            width, height = (high - low + 1).tolist()
        if not 0 < width * height <= MOST_PIXELS:
            raise VfoaError(f"{path}: {too_many_pixels(width, height)}")
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    name = next((channel for channel in _CHANNELS if channel in channels), None)
    if name is None:
        raise VfoaError(
            f"{path}: found channels {', '.join(channels)}; expected depth as one of: {', '.join(_CHANNELS)}"
        )
    z = channels[name]
    if np.issubdtype(z.dtype, np.integer):
        return np.asarray(z)
    z = z.astype(np.float32)
    return np.where(z < _BACKGROUND, z, np.float32(np.nan))


_LARGEST = np.iinfo(np.uint16).max
LARGEST_ID = (1 << 24) - 1
"""Of a segment in a file, as in COCO's panoptic format."""


def read_ids(path: Path) -> NDArray[np.uint32]:
    """Read a map (H, W) of segment ids, 0 = none: a gray PNG, the numbers of a palette's colours, or an ``.npy``.

    Raises
    ------
    VfoaError
        If it cannot be read, holds colours instead of numbers, or a number outside 0 to :data:`LARGEST_ID`.
    """
    is_array = path.suffix.lower() in (".npy", ".npz")
    ids = read_npy(path) if is_array else read_raw(path)
    if ids.ndim == 3 and not is_array:
        with reported_as(f"{path}: not a readable image"), PIL.Image.open(path) as image:
            ids = np.asarray(image) if image.mode == "P" else ids
    if ids.ndim != 2 or not (np.issubdtype(ids.dtype, np.integer) or ids.dtype == np.bool_):
        raise VfoaError(
            f"{path}: found shape {ids.shape} of {ids.dtype}; expected one number per pixel: a PNG with a palette, or "
            "gray of 8 or 16 bits, or an .npy of whole numbers"
        )
    if ids.size and not 0 <= ids.min() <= ids.max() <= LARGEST_ID:
        raise VfoaError(f"{path}: found the numbers {ids.min()} to {ids.max()}; expected 0 to {LARGEST_ID}")
    return ids.astype(np.uint32)


def small_ids(ids: Iterable[int], where: str) -> dict[int, int]:
    """Return a 16-bit id above 0 for each id: its own if it fits, else the smallest free one, in ascending order.

    Raises
    ------
    VfoaError
        If there are more than 65,535 ids.
    """
    distinct = sorted(set(ids) - {0})
    if len(distinct) > _LARGEST:
        raise VfoaError(f"{where}: {len(distinct)} different segment ids; expected at most {_LARGEST}")
    kept = {number for number in distinct if number <= _LARGEST}
    free = (number for number in range(1, _LARGEST + 1) if number not in kept)
    return {number: number if number in kept else next(free) for number in distinct}


def present_ids(ids: NDArray[np.uint32]) -> NDArray[np.intp]:
    """Every id that an id map (H, W) has, ascending; counting is ten times as fast as sorting."""
    is_present = np.zeros(int(ids.max(initial=0)) + 1, np.bool_)
    is_present[ids] = True
    return np.flatnonzero(is_present)
