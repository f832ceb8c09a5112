"""Masks of COCO's annotations: polygons, and run lengths as numbers or as text.

Run lengths go down the columns, from left to right, of free and of covered pixels in turn, free ones first. As text,
each is a number of 6-bit digits, from 48 on (``0`` to ``o``): 5 bits from the lowest on, and whether one more follows;
the sign is the 5th bit of the last. From the fourth length on it is the difference to the last but one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from harness.files.parsing import parse_json_as
from vfoa.errors import VfoaError
from vfoa.types import Mask

MOST_OUTSIDE = 2
"""By how many sizes of the image a polygon may reach beyond it."""


class _Runs(Struct):
    size: tuple[int, int]
    counts: str | list[int]


def read_mask(segmentation: bytes, size: tuple[int, int], where: str) -> Mask:
    """The mask (H, W) of a JSON value, of an image of ``size`` (H, W).

    Polygons are united. They hold the pixels whose centres lie inside, where those cross themselves by the even-odd
    rule.

    Raises
    ------
    VfoaError
        If it is no mask, or one of another size.
    """
    found = parse_json_as(_Runs | list[list[float]] | None, segmentation, where)  # type: ignore[arg-type]
    if isinstance(found, _Runs):
        if tuple(found.size) != size:
            expected = f"[{size[0]}, {size[1]}], the height and the width of the image"
            raise VfoaError(f"{where}: size: found {[*found.size]}; expected {expected}")
        return _of_runs(found.counts, size, where)
    if not found or not all(found):
        expected = "expected polygons [[u, v, ...], ...] or run lengths (boxes: vfoa labels import --format coco)"
        raise VfoaError(f"{where}: found no mask; {expected}")
    return np.logical_or.reduce([_of_polygon(polygon, size, where) for polygon in found])


def _of_runs(counts: str | Sequence[int], size: tuple[int, int], where: str) -> Mask:
    lengths = _of_text(counts, where) if isinstance(counts, str) else np.array(counts, dtype=object)
    pixels = size[0] * size[1]
    if not len(lengths) or any(not 0 <= length <= pixels for length in lengths) or sum(lengths) != pixels:
        total = sum(lengths)
        raise VfoaError(f"{where}: counts: the run lengths are of {total} pixels; expected {pixels}, none below 0")
    is_covered = np.arange(len(lengths)) % 2 == 1
    return np.repeat(is_covered, lengths.astype(np.int64)).reshape(size[::-1]).T


_LONGEST = 8
"""Most digits of a run length in text: 40 bits."""


def _of_text(text: str, where: str) -> NDArray[np.int64]:
    digits = np.frombuffer(text.encode("latin-1", "replace"), np.uint8).astype(np.int64) - 48
    is_last = (digits & 32) == 0
    begins = np.flatnonzero(np.concatenate([[True], is_last[:-1]])) if len(digits) else np.zeros(0, np.intp)
    spans = np.diff(np.append(begins, len(digits)))
    if not len(digits) or not is_last[-1] or spans.max() > _LONGEST or not ((digits >= 0) & (digits < 64)).all():
        raise VfoaError(f"{where}: counts: found {text[:40]!r}; expected run lengths in COCO's compressed form")
    shifts = 5 * (np.arange(len(digits)) - np.repeat(begins, spans))
    lengths = np.add.reduceat((digits & 31) << shifts, begins)
    lengths -= np.where(digits[is_last] & 16, np.int64(1) << (5 * spans), 0)
    for first in (1, 2):
        lengths[first::2] = np.cumsum(lengths[first::2])
    return lengths


def _of_polygon(polygon: Sequence[float], size: tuple[int, int], where: str) -> Mask:
    """The pixels whose centres have an odd number of sides on their left."""
    height, width = size
    corners = np.array(polygon, dtype=np.float64)
    if len(corners) < 6 or len(corners) % 2:
        raise VfoaError(f"{where}: found a polygon of {len(corners)} numbers; expected u, v of three corners or more")
    if corners.min() >= 0 and corners.max() <= 1:
        raise VfoaError(
            f"{where}: found a polygon with corners from 0 to 1; expected pixels: multiply by the image's size"
        )
    u, v = corners.reshape(-1, 2).T
    if not (_is_near(u, width) and _is_near(v, height)):
        raise VfoaError(
            f"{where}: found a polygon far outside the image; expected corners in its {width} x {height} pixels"
        )
    crossings = np.zeros((height, width + 1), np.uint8)
    for u0, v0, u1, v1 in zip(u, v, np.roll(u, -1), np.roll(v, -1), strict=True):
        low, high = np.clip(np.ceil(np.sort([v0, v1]) - 0.5), 0, height).astype(np.intp)
        rows = np.arange(low, high)  # those whose centres are from v0 to v1
        if len(rows):
            at = u0 + (rows + 0.5 - v0) * (u1 - u0) / (v1 - v0)
            crossings[rows, np.clip(np.ceil(at - 0.5), 0, width).astype(np.intp)] += 1
    return (np.cumsum(crossings[:, :width], axis=1, dtype=np.uint8) & 1).astype(np.bool_)


def _is_near(coordinates: NDArray[np.float64], length: int) -> bool:
    return bool(((coordinates > -MOST_OUTSIDE * length) & (coordinates < (1 + MOST_OUTSIDE) * length)).all())
