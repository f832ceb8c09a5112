"""Both views of each frame, by frame number: image files, two per frame or one, and videos, two or one."""

from __future__ import annotations

import hashlib
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from harness.files.digests import digest_files, file_digest
from harness.files.io import read_text
from harness.sources.media.frame_files import find_frames, join_times, nearest_apart
from harness.sources.media.images import read_rgb
from harness.sources.media.video import Video
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.types import Image

Packing = Literal["side_by_side", "top_bottom"]
Layout = Literal[
    "images", "images_side_by_side", "images_top_bottom", "videos", "video_side_by_side", "video_top_bottom"
]
StampUnit = Literal["s", "ms", "us", "ns"]
TICKS_NS: dict[StampUnit, int] = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}

_SHOWN = 8
_RATES_DIFFER = 5e-4  # half of the difference between 30 and 29.97 frames per second
_TIME = re.compile(r"(?:19|20|21)[0-9]{2}-[0-9]{2}-[0-9]{2}[ T][0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?")


class Views(ABC):
    """Pairs of images by number. Can be pickled; reads on demand and in any order.

    ``frames`` are the numbers of frames with both views, ascending. ``rate_hz`` is the frame rate if the files give it.
    ``notes`` are on frames that were left out. ``swapped`` exchanges left and right, for cameras that were named the
    wrong way round.
    """

    frames: tuple[int, ...]
    rate_hz: float | None
    notes: tuple[str, ...] = ()
    swapped = False
    _times_ns: Mapping[int, int] | Sequence[int] | None = None

    def read(self, number: int) -> tuple[Image, Image]:
        """Read left and right (H, W, 3) uint8 RGB of the same size; raises VfoaError if that fails."""
        first, second = self._read(number)
        return (second, first) if self.swapped else (first, second)

    def read_left(self, number: int) -> Image:
        """Read the left image alone, if that is cheaper."""
        return self.read(number)[0]

    def time_ns(self, number: int) -> int | None:
        """Time of a frame, if the files give it."""
        return None if self._times_ns is None else self._times_ns[number]

    def digest(self) -> str:
        """Hexadecimal sha256 of the files' contents and of how they are split into views."""
        digest = self._digest()
        return hashlib.sha256(f"swapped {digest}".encode()).hexdigest() if self.swapped else digest

    @abstractmethod
    def where(self, number: int) -> str:
        """The file (and frame) that messages name."""

    @abstractmethod
    def _read(self, number: int) -> tuple[Image, Image]: ...

    @abstractmethod
    def _digest(self) -> str: ...


class _NumberedImages(Views):
    """Frames numbered by their names; with ``tick_ns`` the numbers are times in this unit.

    ``times_ns`` are the times by number, if a file has them.
    """

    def __init__(self, frames: tuple[int, ...], tick_ns: int | None, times_ns: Mapping[int, int] | None = None) -> None:
        self.frames = frames
        if times_ns is None and tick_ns is not None:
            times_ns = {number: number * tick_ns for number in frames}
        self._times_ns = times_ns
        self.rate_hz = None
        if times_ns is not None and len(frames) > 1:
            self.rate_hz = round(1e9 / float(np.median(np.diff([times_ns[number] for number in frames]))), 3)


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
        frames = tuple(sorted(left.keys() & right.keys()))
        if not frames:
            side = next(iter(left.values())), next(iter(right.values()))
            hint = ""
            if tick_ns is not None:
                apart_ms = nearest_apart(sorted(left), sorted(right)) * tick_ns / 1e6
                hint = f"; the nearest stamps are {apart_ms:.3g} ms apart (median): set tolerance_ms in [source]"
            raise VfoaError(f"no frame number is on both sides: left starts with {side[0]}, right with {side[1]}{hint}")
        super().__init__(frames, tick_ns, times_ns)
        self._left, self._right, self._listed_ns = left, right, times_ns
        self.notes = tuple(
            _unpaired(side, other, alone)
            for side, other, alone in (
                ("left", "right", sorted(left.keys() - right.keys())),
                ("right", "left", sorted(right.keys() - left.keys())),
            )
            if alone
        )

    def where(self, number: int) -> str:
        """The left file."""
        return str(self._left[number])

    def _read(self, number: int) -> tuple[Image, Image]:
        return read_pair(self._left[number], self._right[number])

    def _digest(self) -> str:
        sides = (("left", self._left), ("right", self._right))
        files = digest_files((f"{number} {side}", files[number]) for number in self.frames for side, files in sides)
        return files if self._listed_ns is None else hashlib.sha256(f"{files} {self._listed_ns}".encode()).hexdigest()


class PackedImages(_NumberedImages):
    """One image file per frame, which holds both views."""

    def __init__(self, files: Mapping[int, Path], packing: Packing, tick_ns: int | None = None) -> None:
        super().__init__(tuple(files), tick_ns)
        self._files, self._packing = files, packing

    def where(self, number: int) -> str:
        """The file."""
        return str(self._files[number])

    def _read(self, number: int) -> tuple[Image, Image]:
        return _split(read_rgb(self._files[number]), self._packing, self.where(number))

    def _digest(self) -> str:
        return digest_files((f"{number} {self._packing}", path) for number, path in self._files.items())


class VideoPair(Views):
    """Two videos, joined by the frames' positions from 0; times are the left one's.

    Raises
    ------
    VfoaError
        If the rates differ.
    """

    def __init__(self, left: Path, right: Path) -> None:
        self._left, self._right = Video(left), Video(right)
        rates = self._left.index.rate_hz, self._right.index.rate_hz
        if None not in rates and not math.isclose(*rates, rel_tol=_RATES_DIFFER):  # type: ignore[arg-type]
            raise VfoaError(f"{right}: {rates[1]:g} frames per second, {left} has {rates[0]:g}; expected the same rate")
        counts = len(self._left.index.stamps_ns), len(self._right.index.stamps_ns)
        self.frames, self.rate_hz = tuple(range(min(counts))), rates[0] or rates[1]
        self._times_ns = self._left.times_ns
        longer = (left, right)[counts[1] > counts[0]]
        rest = (f"{longer.name}: {abs(counts[0] - counts[1])} frames after the other video's end are left out",)
        self.notes = (
            *self._left.notes,
            *self._right.notes,
            *(rest if counts[0] != counts[1] else ()),
            *_out_of_step(self._left, self._right, len(self.frames)),
        )

    def where(self, number: int) -> str:
        """The left file and the frame."""
        return f"{self._left.path}: frame {number}"

    def _read(self, number: int) -> tuple[Image, Image]:
        left, right = self._left.read(number), self._right.read(number)
        _check_sizes(left, right, str(self._left.path), self._right.path)
        return left, right

    def read_left(self, number: int) -> Image:
        """Decode one of the two videos."""
        return (self._right if self.swapped else self._left).read(number)

    def _digest(self) -> str:
        return digest_files((("left", self._left.path), ("right", self._right.path)))


class PackedVideo(Views):
    """One video whose frames hold both views, by their positions from 0."""

    def __init__(self, path: Path, packing: Packing) -> None:
        self._video, self._packing = Video(path), packing
        self.frames = tuple(range(len(self._video.index.stamps_ns)))
        self.rate_hz, self.notes = self._video.index.rate_hz, self._video.notes
        self._times_ns = self._video.times_ns

    def where(self, number: int) -> str:
        """The file and the frame."""
        return f"{self._video.path}: frame {number}"

    def _read(self, number: int) -> tuple[Image, Image]:
        return _split(self._video.read(number), self._packing, self.where(number))

    def _digest(self) -> str:
        return hashlib.sha256(f"{self._packing} {file_digest(self._video.path)}".encode()).hexdigest()


class ViewFiles(Settings):
    """``left`` and ``right`` are a folder, a glob (``left*.png``) or a pattern (``left/%06d.png``), or two videos.

    ``both`` is the same for files that hold both views. ``stamps``: the numbers in the images' names are times, in this
    unit, and those of a pair may be ``tolerance_ms`` apart. ``times`` is a file with the time of each left image in a
    line, as in KITTI's raw recordings. ``swap`` exchanges left and right.
    """

    layout: Layout = "images"
    left: str | None = None
    right: str | None = None
    both: str | None = None
    stamps: StampUnit | None = None
    tolerance_ms: float | None = Field(default=None, ge=0, le=1e6)
    times: str | None = None
    swap: bool = False

    @model_validator(mode="after")
    def _files_of_the_layout(self) -> Self:
        keys = {"left", "right"} if self.layout in ("images", "videos") else {"both"}
        found = {key for key in ("left", "right", "both") if getattr(self, key) is not None}
        if found != keys:
            raise ValueError(
                f"found {' and '.join(sorted(found)) or 'no files'}; "
                f"expected {' and '.join(sorted(keys))} for the layout {self.layout!r}"
            )
        if self.stamps is not None and "video" in self.layout:
            raise ValueError(f"stamps: found {self.stamps!r}; expected none for the layout {self.layout!r}")
        if self.times is not None and (self.stamps is not None or self.layout != "images"):
            raise ValueError(f"times: found {self.times!r}; expected it only for the layout images, and without stamps")
        if self.tolerance_ms is not None and (self.stamps is None or self.layout != "images"):
            raise ValueError('tolerance_ms: expected stamps = "ns" (or us, ms, s) beside it, and the layout images')
        return self

    def views(self, folder: Path) -> Views:
        """Open the views' files under a folder.

        Raises
        ------
        VfoaError
            If nothing is found, it cannot be numbered, or (videos) not read.
        """
        views = self._views(folder)
        views.swapped = self.swap
        return views

    def _views(self, folder: Path) -> Views:
        left, right, both = (str(name) for name in (self.left, self.right, self.both))
        packing: Packing = "top_bottom" if self.layout.endswith("top_bottom") else "side_by_side"
        tick = None if self.stamps is None else TICKS_NS[self.stamps]
        match self.layout:
            case "images":
                lefts, rights = find_sides(folder, left, right)
                if tick is not None and self.tolerance_ms is not None:
                    rights = _joined_by_time(lefts, rights, round(self.tolerance_ms * 1e6 / tick))
                times_ns = None if self.times is None else _read_times(folder / self.times, lefts)
                return ImagePairs(lefts, rights, tick, times_ns)
            case "videos":
                return VideoPair(folder / left, folder / right)
            case "images_side_by_side" | "images_top_bottom":
                return PackedImages(find_frames(folder, both, "source.both"), packing, tick)
            case "video_side_by_side" | "video_top_bottom":
                return PackedVideo(folder / both, packing)


def find_sides(folder: Path, left: str, right: str) -> tuple[Mapping[int, Path], Mapping[int, Path]]:
    """The files of both sides by frame number; two single files (``im0.png`` and ``im1.png``) are one frame, 0.

    Raises
    ------
    VfoaError
        As :func:`harness.sources.media.frame_files.find_frames`.
    """
    lefts, rights = find_frames(folder, left, "source.left"), find_frames(folder, right, "source.right")
    if (folder / left).is_file() and (folder / right).is_file() and lefts.keys() != rights.keys():
        return {0: folder / left}, {0: folder / right}
    return lefts, rights


def read_pair(left_path: Path, right_path: Path) -> tuple[Image, Image]:
    """Read two images (H, W, 3) uint8 RGB of the same size.

    Raises
    ------
    VfoaError
        If one cannot be read, or the sizes differ.
    """
    left, right = read_rgb(left_path), read_rgb(right_path)
    _check_sizes(left, right, left_path.name, right_path)
    return left, right


def _read_times(path: Path, lefts: Mapping[int, Path]) -> dict[int, int]:
    """The time of each left image, ns since 1970, from lines such as ``2011-09-26 13:02:25.964389445``.

    Raises
    ------
    VfoaError
        If a line is no time, times do not ascend, or there are not as many as images.
    """
    found: list[int] = []
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    for number, line in enumerate(lines, start=1):
        try:
            if not _TIME.fullmatch(line.strip()):
                raise ValueError
            found.append(int(np.datetime64(line.strip(), "ns").astype(np.int64)))
        except ValueError:
            raise VfoaError(f"{path}:{number}: found {line[:60]!r}; expected 2011-09-26 13:02:25.964389445") from None
        if len(found) > 1 and found[-1] <= found[-2]:
            raise VfoaError(f"{path}:{number}: {line!r} is not after the time before it")
    if len(found) != len(lefts):
        raise VfoaError(f"{path}: found {len(found)} times; expected {len(lefts)}, one for each left image")
    return dict(zip(lefts, found, strict=True))


def _joined_by_time(left: Iterable[int], right: Mapping[int, Path], tolerance: int) -> dict[int, Path]:
    """The right files by left numbers, if the two are at most ``tolerance`` ticks apart, else by their own."""
    lefts, rights, found = sorted(left), sorted(right), dict(right)
    for place, other in join_times(lefts, rights, tolerance):
        found[lefts[place]] = found.pop(rights[other])
    return found


def _split(image: Image, packing: Packing, where: str) -> tuple[Image, Image]:
    """Split an image (H, W, 3) into left and right view: left is the left, or the upper half."""
    axis = 1 if packing == "side_by_side" else 0
    if image.shape[axis] % 2:
        length = f"the {('height', 'width')[axis]} is {image.shape[axis]} pixels"
        raise VfoaError(f"{where}: {length}; expected an even number, for two views {packing}")
    first, second = np.split(image, 2, axis=axis)
    return np.ascontiguousarray(first), np.ascontiguousarray(second)


def _check_sizes(left: Image, right: Image, left_name: str, right_path: Path) -> None:
    if left.shape != right.shape:
        raise VfoaError(
            f"{right_path}: the right image is {right.shape[1]} x {right.shape[0]} pixels, "
            f"the left one ({left_name}) {left.shape[1]} x {left.shape[0]}"
        )


def _unpaired(side: str, other: str, numbers: list[int]) -> str:
    shown = ", ".join(map(str, numbers[:_SHOWN])) + (" ..." if len(numbers) > _SHOWN else "")
    images = f"1 {side} image has" if len(numbers) == 1 else f"{len(numbers)} {side} images have"
    return f"{images} no {other} one, left out: frame {shown}"


def _out_of_step(left: Video, right: Video, count: int) -> list[str]:
    """A note if frames at one position were taken at different times: one video has lost some."""
    times_ns = [np.array(video.times_ns[:count]) for video in (left, right)]
    apart_ns = np.abs(times_ns[0] - times_ns[1])
    if count < 2 or apart_ns.max() <= float(np.median(np.diff(times_ns[0]))) / 2:
        return []
    first, most_ms = int(np.argmax(apart_ns > 0)), apart_ns.max() / 1e6
    return [
        f"{right.path.name}: from frame {first} on not in step with {left.path.name}, by up to {most_ms:.0f} ms; "
        "frames are paired by their places"
    ]
