"""The pictures that a calibration is made from, joined by number and read one pair at a time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from harness.adapters.stereo_views import read_pair
from harness.frame_files import find_frames
from vfoa.errors import VfoaError
from vfoa.types import Image


def picture_pairs(folder: Path, left: str, right: str) -> tuple[Iterator[tuple[int, Image, Image]], tuple[int, int]]:
    """Pairs (number, left, right) that both sides have, and the (width, height) that all of them must share.

    Raises
    ------
    VfoaError
        If nothing is found, no number is on both sides, or (while reading) a pair has another size than the first.
    """
    lefts, rights = find_frames(folder, left, "left"), find_frames(folder, right, "right")
    for number in sorted(lefts.keys() ^ rights.keys()):
        raise VfoaError(f"{folder}: frame {number} is only on one side; expected a left and a right picture")
    first, _ = read_pair(*next(zip(lefts.values(), rights.values(), strict=True)))
    size_px = (first.shape[1], first.shape[0])
    return _read(lefts, rights, size_px), size_px


def _read(
    lefts: dict[int, Path], rights: dict[int, Path], size_px: tuple[int, int]
) -> Iterator[tuple[int, Image, Image]]:
    for number, path in lefts.items():
        left, right = read_pair(path, rights[number])
        if (left.shape[1], left.shape[0]) != size_px:
            raise VfoaError(
                f"{path}: {left.shape[1]} x {left.shape[0]} pixels; expected {size_px} as the first picture"
            )
        yield number, left, right
