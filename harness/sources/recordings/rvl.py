"""Depth in RVL (A. D. Wilson, Fast Lossless Depth Image Compression, 2017), as ROS's compressedDepth has it.

Pixels are runs without depth and runs with depth in turn: the length of each, and after that of a run with depth its
values, each as the difference from the value before. A number is a sequence of nibbles: three bits, the lowest ones
first, and whether more follow. Eight nibbles are a word of 32 bits, the first one its highest bits.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from harness.sources.media.images import MOST_PIXELS, too_many_pixels
from vfoa.errors import VfoaError

_SIZE = struct.Struct("<II")
_SHIFTS = np.arange(28, -1, -4, dtype=np.uint32)
_MORE, _BITS = 8, 7
_MOST_NIBBLES = 10
"""Of a number of 30 bits; those of images have fewer. A longer one, of damaged data, is made larger than any image."""


def decode_rvl(data: bytes, where: str) -> NDArray[np.uint16]:
    """Return the counts (H, W), 0 where there is no depth; ``where`` opens the messages.

    Raises
    ------
    VfoaError
        If the data end before the image does, or claim more pixels than it has.
    """
    if len(data) < _SIZE.size:
        raise VfoaError(f"{where}: RVL of {len(data)} bytes; expected width and height in {_SIZE.size}")
    width, height = _SIZE.unpack_from(data)
    if not 0 < width * height <= MOST_PIXELS:
        raise VfoaError(f"{where}: RVL: {too_many_pixels(width, height)}")
    numbers = _numbers(data[_SIZE.size :])
    n_pixels = width * height
    pixels, places, counts = _runs(numbers.tolist(), n_pixels, where)
    in_run = np.arange(counts.sum()) - np.repeat(counts.cumsum() - counts, counts)
    folded = numbers[np.repeat(places, counts) + in_run]
    steps = (folded >> 1) ^ -(folded & 1)  # 0, -1, 1, -2 ... are 0, 1, 2, 3 ...
    depth = np.zeros(n_pixels, np.uint16)
    depth[np.repeat(pixels, counts) + in_run] = np.cumsum(steps).astype(np.uint16)
    return depth.reshape(height, width)


def _numbers(data: bytes) -> NDArray[np.int64]:
    """All numbers in the data, the lengths of runs among them."""
    words = np.frombuffer(data, "<u4", len(data) // 4)
    nibbles = ((words[:, None] >> _SHIFTS) & 0xF).astype(np.int64).ravel()
    ends = np.flatnonzero(nibbles < _MORE)
    if not ends.size:
        return np.zeros(0, np.int64)
    begins = np.concatenate([[0], ends[:-1] + 1])
    nibbles = nibbles[: ends[-1] + 1]
    in_number = np.arange(nibbles.size) - np.repeat(begins, ends - begins + 1)
    parts = (nibbles & _BITS) << 3 * np.minimum(in_number, _MOST_NIBBLES)
    return np.add.reduceat(np.where(in_number < _MOST_NIBBLES, parts, 1 << 32), begins)


def _runs(
    numbers: list[int], n_pixels: int, where: str
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Of each run with depth its first pixel, the place of its first value among the numbers, and its length."""
    pixel = place = 0
    runs = [(0, 0, 0)]
    while pixel < n_pixels:
        if place + 2 > len(numbers):
            raise VfoaError(f"{where}: RVL that ends after {pixel} of {n_pixels} pixels; expected a whole message")
        pixel, place, count = pixel + numbers[place], place + 2, numbers[place + 1]
        if pixel + count > n_pixels or place + count > len(numbers):
            raise VfoaError(
                f"{where}: damaged RVL: {count} pixels with depth from pixel {pixel} of {n_pixels} on, and "
                f"{len(numbers) - place} values"
            )
        runs.append((pixel, place, count))
        pixel, place = pixel + count, place + count
    pixels, places, counts = np.array(runs, np.int64).T
    return pixels, places, counts
