"""RVL, the lossless compression of depth images in ROS's ``compressedDepth``.

Source: Wilson, Fast Lossless Depth Image Compression, ISS 2017. Runs alternate: a number of zeros, a number of non-
zeros, then for each of these its difference from the one before (of any run), with the sign in the lowest bit.
Numbers are groups of three bits, the lowest first, in nibbles whose highest bit says that another one follows;
nibbles fill 32-bit words from the top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_LONGEST = 11
"""Most nibbles of a number of 32 bits."""


def decode_rvl(data: bytes, width_px: int, height_px: int) -> NDArray[np.uint16]:
    """Decode the image (H, W) in a stream of RVL.

    Raises
    ------
    ValueError
        If the stream is too short for the size, or its runs are longer than the image.
    """
    numbers = _numbers(data)
    pixels = width_px * height_px
    places, differences = [np.zeros(0, np.intp)], [np.zeros(0, np.int64)]
    at = pixel = 0
    while pixel < pixels:
        if at + 2 > len(numbers):
            raise ValueError(f"the stream ends at pixel {pixel} of {pixels}")
        zeros, count = int(numbers[at]), int(numbers[at + 1])
        at, pixel = at + 2, pixel + zeros
        if pixel + count > pixels or at + count > len(numbers):
            raise ValueError(f"a run of {zeros} zeros and {count} others ends outside of {width_px} x {height_px}")
        places.append(np.arange(pixel, pixel + count))
        differences.append(numbers[at : at + count])
        at, pixel = at + count, pixel + count
        if zeros == count == 0:
            raise ValueError(f"an empty run at pixel {pixel} of {pixels}")
    coded = np.concatenate(differences)
    image = np.zeros(pixels, np.uint16)
    image[np.concatenate(places)] = np.cumsum((coded >> 1) ^ -(coded & 1)).astype(np.uint16)
    return image.reshape(height_px, width_px)


def _numbers(data: bytes) -> NDArray[np.int64]:
    """All numbers of the stream; incomplete nibbles at its end are ignored."""
    words = np.frombuffer(data, "<u4", len(data) // 4)
    nibbles = (words[:, None] >> np.arange(28, -4, -4, dtype=np.uint32) & 15).astype(np.int64).ravel()
    ends = np.flatnonzero(nibbles < 8)
    if ends.size == 0:
        return np.zeros(0, np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    if (ends - starts).max() >= _LONGEST:
        raise ValueError("a number of more than 32 bits")
    used = nibbles[: ends[-1] + 1]
    position = np.arange(len(used)) - np.repeat(starts, ends - starts + 1)
    return np.add.reduceat((used & 7) << 3 * position, starts)
