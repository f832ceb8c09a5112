"""Sources of a frame's two views, by frame number: one protocol, and image files, two per frame or one."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.files.digests import digest_files
from harness.sources.media.images import read_rgb
from vfoa.errors import VfoaError
from vfoa.types import Image

Packing = Literal["side_by_side", "top_bottom"]

_SHOWN = 8


class Views(Protocol):
    """Pairs of images by number. Can be pickled; reads on demand and in any order."""

    @property
    def frames(self) -> tuple[int, ...]:
        """The numbers of frames with both views, ascending."""
        ...

    @property
    def rate_hz(self) -> float | None:
        """Frames per second, if the files give it."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on frames that were left out."""
        ...

    def time_ns(self, number: int) -> int | None:
        """Time of a frame, if the files give it."""
        ...

    def where(self, number: int) -> str:
        """The file (and frame) that messages name."""
        ...

    def read(self, number: int) -> tuple[Image, Image]:
        """Read left and right (H, W, 3) uint8 RGB of the same size; raises VfoaError if that fails."""
        ...

    def digest(self) -> str:
        """Hexadecimal sha256 of the files' contents and of how they are split into views."""
        ...


class Swapped:
    """Views with left and right exchanged: for cameras that were named the wrong way round."""

    def __init__(self, views: Views) -> None:
        self._views = views
        self.frames, self.rate_hz, self.notes = views.frames, views.rate_hz, views.notes

    def time_ns(self, number: int) -> int | None:
        """Time from the files."""
        return self._views.time_ns(number)

    def where(self, number: int) -> str:
        """The file that messages name."""
        return self._views.where(number)

    def read(self, number: int) -> tuple[Image, Image]:
        """Right and left of the files."""
        right, left = self._views.read(number)
        return left, right

    def digest(self) -> str:
        """Digest of the files and the exchange."""
        return hashlib.sha256(f"swapped {self._views.digest()}".encode()).hexdigest()


class _NumberedImages:
    """Frames numbered by their names; with ``tick_ns`` the numbers are times in this unit.

    ``times_ns`` are the times by number, if a file has them.
    """

    def __init__(self, frames: tuple[int, ...], tick_ns: int | None, times_ns: Mapping[int, int] | None = None) -> None:
        self.frames = frames
        self._tick_ns, self._times_ns = tick_ns, times_ns

    @property
    def rate_hz(self) -> float | None:
        """Rate from the median step of the times."""
        if (self._tick_ns is None and self._times_ns is None) or len(self.frames) < 2:
            return None
        steps_ns = np.diff([self.time_ns(number) or 0 for number in self.frames])
        return round(1e9 / float(np.median(steps_ns)), 3)

    def time_ns(self, number: int) -> int | None:
        """The time from the file, or the number as a time."""
        if self._times_ns is not None:
            return self._times_ns[number]
        return None if self._tick_ns is None else number * self._tick_ns


class ImagePairs(_NumberedImages):
    """Two image files per frame, joined by number.

    Raises
    ------
    VfoaError
        If no number is on both sides.
    """

    def __init__(
        self,
        left: Mapping[int, Path],
        right: Mapping[int, Path],
        tick_ns: int | None = None,
        times_ns: Mapping[int, int] | None = None,
    ) -> None:
        super().__init__(tuple(sorted(left.keys() & right.keys())), tick_ns, times_ns)
        if not self.frames:
            side = next(iter(left.values())), next(iter(right.values()))
            hint = "" if tick_ns is None else _apart(left, right, tick_ns)
            raise VfoaError(f"no frame number is on both sides: left starts with {side[0]}, right with {side[1]}{hint}")
        self._left, self._right = left, right
        alone = (("left", left, "right", right), ("right", right, "left", left))
        self.notes = tuple(
            _unpaired(side, other, sorted(files.keys() - others.keys()))
            for side, files, other, others in alone
            if files.keys() - others.keys()
        )

    def where(self, number: int) -> str:
        """The left file."""
        return str(self._left[number])

    def read(self, number: int) -> tuple[Image, Image]:
        """Both files."""
        return read_pair(self._left[number], self._right[number])

    def digest(self) -> str:
        """Digest of the paired files, and of times from a file."""
        sides = (("left", self._left), ("right", self._right))
        files = digest_files((f"{number} {side}", files[number]) for number in self.frames for side, files in sides)
        return files if self._times_ns is None else hashlib.sha256(f"{files} {self._times_ns}".encode()).hexdigest()


class PackedImages(_NumberedImages):
    """One image file per frame, which holds both views."""

    notes: tuple[str, ...] = ()

    def __init__(self, files: Mapping[int, Path], packing: Packing, tick_ns: int | None = None) -> None:
        super().__init__(tuple(files), tick_ns)
        self._files, self._packing = files, packing

    def where(self, number: int) -> str:
        """The file."""
        return str(self._files[number])

    def read(self, number: int) -> tuple[Image, Image]:
        """Both halves."""
        return split(read_rgb(self._files[number]), self._packing, self.where(number))

    def digest(self) -> str:
        """Digest of the files and the packing."""
        return digest_files((f"{number} {self._packing}", path) for number, path in self._files.items())


def joined_by_time(left: Iterable[int], right: Mapping[int, Path], tolerance: int) -> dict[int, Path]:
    """The right files by left numbers: each left stamp's nearest right one, at most ``tolerance`` ticks apart.

    A right file that is nearer to another left stamp stays alone, under its own number.
    """
    lefts, rights = np.array(sorted(left), dtype=np.int64), np.array(sorted(right), dtype=np.int64)
    if not len(lefts) or not len(rights):
        return dict(right)
    to_left = _nearest(rights, lefts)
    found = dict(right)
    for place, nearest in enumerate(_nearest(lefts, rights)):
        number, other = int(lefts[place]), int(rights[nearest])
        if to_left[nearest] == place and abs(number - other) <= tolerance:
            del found[other]
            found[number] = right[other]
    return found


def _nearest(numbers: NDArray[np.int64], among: NDArray[np.int64]) -> NDArray[np.intp]:
    """The index of the nearest of ascending numbers, for each of some ascending numbers."""
    after = np.clip(np.searchsorted(among, numbers), 1, len(among) - 1) if len(among) > 1 else np.zeros_like(numbers)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(numbers - among[before]) <= np.abs(among[after] - numbers), before, after)


def _apart(left: Iterable[int], right: Iterable[int], tick_ns: int) -> str:
    lefts, rights = (np.array(sorted(side), dtype=np.int64) for side in (left, right))
    ticks = float(np.median(np.abs(lefts - rights[_nearest(lefts, rights)])))
    return (
        f"; the nearest stamps are {ticks * tick_ns / 1e6:.3g} ms apart (median): tolerance_ms = in [source] allows it"
    )


def read_pair(left_path: Path, right_path: Path) -> tuple[Image, Image]:
    """Read two images (H, W, 3) uint8 RGB of the same size.

    Raises
    ------
    VfoaError
        If one cannot be read, or the sizes differ.
    """
    left, right = read_rgb(left_path), read_rgb(right_path)
    check_sizes(left, right, left_path.name, right_path)
    return left, right


def split(image: Image, packing: Packing, where: str) -> tuple[Image, Image]:
    """Split an image (H, W, 3) into left and right view: left is the left, or the upper half.

    Raises
    ------
    VfoaError
        If it cannot be halved.
    """
    axis = 1 if packing == "side_by_side" else 0
    length = image.shape[axis]
    if length % 2:
        name = ("height", "width")[axis]
        raise VfoaError(f"{where}: the {name} is {length} pixels; expected an even number, for two views {packing}")
    first, second = np.split(image, 2, axis=axis)
    return np.ascontiguousarray(first), np.ascontiguousarray(second)


def check_sizes(left: Image, right: Image, left_name: str, right_path: Path) -> None:
    """Reject two images of different sizes."""
    if left.shape != right.shape:
        raise VfoaError(
            f"{right_path}: the right image is {right.shape[1]} x {right.shape[0]} pixels, "
            f"the left one ({left_name}) {left.shape[1]} x {left.shape[0]}"
        )


def _unpaired(side: str, other: str, numbers: list[int]) -> str:
    shown = ", ".join(map(str, numbers[:_SHOWN])) + (" ..." if len(numbers) > _SHOWN else "")
    images = f"1 {side} image has" if len(numbers) == 1 else f"{len(numbers)} {side} images have"
    return f"{images} no {other} one, left out: frame {shown}"
