"""Both views of each frame, by frame number: image files, two per frame or one, and videos, two or one."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from harness.files.digests import digest_files
from harness.sources.media.film import first_picture_s
from harness.sources.media.frame_files import find_frames
from harness.sources.media.frame_times import (
    TICKS_NS,
    StampUnit,
    join_nearest,
    join_times,
    nearest_apart,
    numbered_apart,
    rate_of,
    times_beside,
)
from harness.sources.media.images import read_rgb, turn_of, width_by_height
from harness.sources.media.listed_times import read_times
from harness.sources.media.video import VIDEO_SUFFIXES, Video
from vfoa.errors import VfoaError, counted
from vfoa.settings import Settings
from vfoa.types import Image

Packing = Literal["side_by_side", "top_bottom"]
PACKINGS: tuple[Packing, ...] = ("side_by_side", "top_bottom")
Layout = Literal[
    "images", "images_side_by_side", "images_top_bottom", "videos", "video_side_by_side", "video_top_bottom"
]
_SHOWN = 8
_RATES_DIFFER = 5e-4  # half of the difference between 30 and 29.97 frames per second


class ImageFiles:
    """Pictures in files, one per frame; ``times_ns`` are their times, if these are known.

    They are turned and mirrored as each file says; ``notes``: whether the first one is.
    """

    def __init__(self, files: Mapping[int, Path], times_ns: Mapping[int, int] | None = None) -> None:
        self._files, self.times_ns = files, times_ns
        self.rate_hz = None if times_ns is None else rate_of(times_ns.values())
        turned = [(path, turn) for path in islice(files.values(), 1) if (turn := turn_of(path))]
        self.notes = tuple(
            f"{path.parent.name}/{path.name}: images are {turn}, as their EXIF says" for path, turn in turned
        )

    @property
    def frames(self) -> Collection[int]:
        """The numbers."""
        return self._files.keys()

    def file(self, number: int) -> Path:
        """The file of a frame."""
        return self._files[number]

    def read(self, number: int) -> Image:
        """Read one file."""
        return read_rgb(self._files[number], upright=True)

    def parts(self, role: str, frames: Iterable[int]) -> Iterator[tuple[str, Path]]:
        """Each file with its number."""
        return ((f"{number} {role}", self._files[number]) for number in frames)


class ShiftedVideo:
    """The right video of two that were not started together, by the numbers of the left one.

    ``offset`` is its own frame at the left one's frame 0; below 0, it was started later.
    """

    def __init__(self, video: Video, offset: int) -> None:
        self._video, self._offset = video, offset
        self.path, self.rate_hz, self.notes = video.path, video.rate_hz, video.notes
        self.frames = range(-offset, len(video.frames) - offset)
        self.times_ns = dict(zip(self.frames, video.times_ns, strict=True))

    def file(self, number: int) -> Path:
        """The file."""
        return self.path

    def read(self, number: int) -> Image:
        """Read the picture at the left one's number."""
        return self._video.read(number + self._offset)

    def parts(self, role: str, frames: Iterable[int]) -> Iterator[tuple[str, Path]]:
        """The file with its role, and where it starts."""
        return self._video.parts(f"{role} from {self._offset}", frames)


class JoinedVideo:
    """The right video of two whose frames are joined by their times, by the numbers of the left one.

    Cameras that lose frames, or film with varying steps, are out of step by their places. ``offset``: as of
    :class:`ShiftedVideo`, the frame at which this video's times begin. ``rate_hz`` is that of the joined frames.
    """

    def __init__(self, video: Video, left: Video, offset: int, tolerance_ms: float) -> None:
        self._video, self._how = video, f"from {offset} by times within {tolerance_ms:g} ms"
        self.path = video.path
        first, first_left = max(offset, 0), max(-offset, 0)
        if first >= len(video.times_ns) or first_left >= len(left.times_ns):
            counts = f"{left.path.name} has {counted(len(left.times_ns), 'frame')}, {video.path.name}"
            raise VfoaError(f"source.right_offset: found {offset}; {counts} {len(video.times_ns)}")
        begin_ns = video.times_ns[first] - left.times_ns[first_left]
        own_ns = [time_ns - begin_ns for time_ns in video.times_ns]
        self._places = dict(join_times(left.times_ns, own_ns, round(tolerance_ms * 1e6)))
        self.frames = tuple(self._places)  # keys cannot be pickled
        self.times_ns = {number: own_ns[place] for number, place in self._places.items()}
        self.rate_hz = rate_of(left.times_ns[number] for number in self._places)
        alone = len(own_ns) - len(self._places)
        what = f"{alone} of {len(own_ns)} frames have no left one within {tolerance_ms:g} ms"
        self.notes = (*video.notes, *([f"{video.path.name}: {what}"] if alone else []))

    def file(self, number: int) -> Path:
        """The file."""
        return self.path

    def read(self, number: int) -> Image:
        """Read the picture that was taken with the left one of this number."""
        return self._video.read(self._places[number])

    def parts(self, role: str, frames: Iterable[int]) -> Iterator[tuple[str, Path]]:
        """The file with its role, and how it is joined."""
        return self._video.parts(f"{role} {self._how}", frames)


Pictures = ImageFiles | Video | ShiftedVideo | JoinedVideo
"""Images by number, with their times and rate if they are known."""


class StereoPairs:
    """Pairs of images by number. Can be pickled; reads on demand and in any order.

    ``frames`` are the numbers of frames with both views, ascending; times and rate are those of the left side.
    ``notes`` are on frames that were left out.

    Parameters
    ----------
    left, right
        The two sides, joined by number; or pictures that hold both views, and None.
    packing
        How one picture holds both views.
    swapped
        Exchange left and right, for cameras that were named the wrong way round.

    Raises
    ------
    VfoaError
        If no number is on both sides, or their rates differ.
    """

    def __init__(self, left: Pictures, right: Pictures | None, packing: Packing, *, swapped: bool) -> None:
        self._left, self._right, self._packing, self._swapped = left, right, packing, swapped
        self.frames = tuple(left.frames)
        self.rate_hz, self.notes = left.rate_hz, left.notes
        if right is not None:
            self.frames = tuple(sorted(set(left.frames) & set(right.frames)))
            if not self.frames:
                first, other = (side.file(next(iter(side.frames))) for side in (left, right))
                raise VfoaError(f"no frame number is on both sides: left starts with {first}, right with {other}")
            self.notes += (*right.notes, *_unpaired(left, right), *_out_of_step(left, right, self.frames))
            self.rate_hz = right.rate_hz if isinstance(right, JoinedVideo) else _common_rate(left, right)

    def read(self, number: int) -> tuple[Image, Image]:
        """Read left and right (H, W, 3) uint8 RGB of the same size; raises VfoaError if that fails."""
        if self._right is None:
            first, second = split_views(self._left.read(number), self._packing, self.where(number))
        else:
            first, second = self._left.read(number), self._right.read(number)
            check_sizes(first, second, self._left.file(number), self._right.file(number))
        return (second, first) if self._swapped else (first, second)

    def read_left(self, number: int) -> Image:
        """Read the left image alone."""
        if self._right is None:
            return self.read(number)[0]
        return (self._right if self._swapped else self._left).read(number)

    def time_ns(self, number: int) -> int | None:
        """Time of a frame, if the files give it."""
        return None if self._left.times_ns is None else self._left.times_ns[number]

    @property
    def films(self) -> dict[str, float]:
        """The name of each video, the left one first, and the time of the clip's first frame for a player, s.

        Not of a right one that was started at another time.
        """
        sides = (self._right, self._left) if self._swapped and self._right else (self._left, self._right)
        videos = [side for side in sides if isinstance(side, Video)]
        return {each.path.name: first_picture_s(each.path) + each.times_ns[self.frames[0]] / 1e9 for each in videos}

    def where(self, number: int) -> str:
        """The (left) file and the frame that messages name."""
        path = self._left.file(number)
        return f"{path}: frame {number}" if isinstance(self._left, Video) else str(path)

    def digest(self) -> str:
        """Hexadecimal sha256 of the files' contents, their times, and how they are split into views."""
        sides = [self._left.parts(self._packing if self._right is None else "left", self.frames)]
        if self._right is not None:
            sides.append(self._right.parts("right", self.frames))
        parts = [part for of_frame in zip(*sides, strict=True) for part in of_frame]
        times = None if isinstance(self._left, Video) else self._left.times_ns
        return hashlib.sha256(f"{digest_files(parts)} {times} {self._swapped}".encode()).hexdigest()


class PairFiles(Settings):
    """``left`` and ``right`` are a folder, a glob (``left*.png``) or a pattern (``left/%06d.png``), or two videos.

    ``both`` is the same for files that hold both views. ``stamps``: the numbers in the images' names are times, in this
    unit, and those of a pair may be ``tolerance_ms`` apart; with it, the frames of two videos are paired by their times
    since the first frames, else by their places. ``times`` is a file with the time of each left image in a line: date
    and time as in KITTI's raw recordings, seconds, or a whole number of ms, us or ns. ``swap`` exchanges left and
    right. ``right_offset``: of cameras that were not started together, the frame of ``right`` that was taken with frame
    0 of ``left``; -3 if that is frame 3 of ``left`` with frame 0 of ``right``.
    """

    layout: Layout = "images"
    left: str | None = None
    right: str | None = None
    both: str | None = None
    stamps: StampUnit | None = None
    tolerance_ms: float | None = Field(default=None, ge=0, le=1e6)
    times: str | None = None
    swap: bool = False
    right_offset: int = 0

    @model_validator(mode="after")
    def _files_of_the_layout(self) -> Self:
        keys = {"left", "right"} if self.layout in ("images", "videos") else {"both"}
        given = {key for key in ("left", "right", "both") if getattr(self, key) is not None}
        if given != keys:
            raise ValueError(
                f"found {' and '.join(sorted(given)) or 'no files'}; "
                f"expected {' and '.join(sorted(keys))} for the layout {self.layout!r}"
            )
        if self.both is not None and "image" in self.layout and Path(self.both).suffix.lower() in VIDEO_SUFFIXES:
            of_films = self.layout.replace("images", "video")
            raise ValueError(f"layout: found {self.layout!r} for the film {self.both!r}; expected {of_films!r}")
        if self.stamps is not None and "video" in self.layout:
            raise ValueError(f"stamps: found {self.stamps!r}; expected none for the layout {self.layout!r}")
        if self.times is not None and (self.stamps is not None or self.layout != "images"):
            raise ValueError(f"times: found {self.times!r}; expected it only for the layout images, and without stamps")
        if self.tolerance_ms is not None and self.layout != "videos" and (self.stamps is None or self.both is not None):
            raise ValueError(
                'tolerance_ms: expected stamps = "ns" (or us, ms, s) beside it, and the layout images; or two videos'
            )
        if self.right_offset and (self.both is not None or self.stamps is not None):
            raise ValueError(f"right_offset: found {self.right_offset}; expected it only for two views by number")
        return self

    def views(self, folder: Path) -> StereoPairs:
        """Open the views' files under a folder.

        Raises
        ------
        VfoaError
            If nothing is found, it cannot be numbered, or (videos) not read.
        """
        right: Pictures | None = None
        left: Pictures
        notes: tuple[str, ...] = ()
        if "video" in self.layout:
            left = Video(folder / (self.left or str(self.both)))
            if self.right is not None:
                film = right = Video(folder / self.right)
                if self.tolerance_ms is not None:
                    right = JoinedVideo(film, left, self.right_offset, self.tolerance_ms)
                elif self.right_offset:
                    right = ShiftedVideo(film, self.right_offset)
        elif self.both is not None:
            left = self._images(find_frames(folder, self.both, "source.both"), folder)
        else:
            lefts, rights = find_sides(folder, str(self.left), str(self.right))
            shift = numbered_apart(lefts, rights)
            if shift and self.stamps is None and not self.right_offset:
                notes = (
                    f"{len(lefts)} left images from {min(lefts)} and {len(rights)} right ones from {min(rights)}, "
                    f"paired by number: if the first ones belong together, say right_offset = {shift} in [source]",
                )
            if self.right_offset:
                rights = {number - self.right_offset: path for number, path in rights.items()}
            if self.stamps is not None:
                rights = _joined_by_time(lefts, rights, self.tolerance_ms, TICKS_NS[self.stamps])
            left, right = self._images(lefts, folder), ImageFiles(rights)
        packing = next((packing for packing in PACKINGS if self.layout.endswith(packing)), PACKINGS[0])
        pairs = StereoPairs(left, right, packing, swapped=self.swap)
        pairs.notes += notes
        return pairs

    def _images(self, files: Mapping[int, Path], folder: Path) -> ImageFiles:
        """Images with the times of their names, or of a file."""
        if self.times is not None:
            return ImageFiles(files, read_times(folder / self.times, files))
        if self.stamps is not None:
            return ImageFiles(files, {number: number * TICKS_NS[self.stamps] for number in files})
        return ImageFiles(files, times_beside(files))


def find_sides(folder: Path, left: str, right: str) -> tuple[Mapping[int, Path], Mapping[int, Path]]:
    """The files of both sides by frame number; two single files (``im0.png`` and ``im1.png``) are one frame, 0.

    Raises
    ------
    VfoaError
        As :func:`harness.sources.media.frame_files.find_frames`.
    """
    lefts, rights = find_frames(folder, left, "source.left"), find_frames(folder, right, "source.right")
    are_single = len(lefts) == len(rights) == 1 and (folder / left).is_file() and (folder / right).is_file()
    if are_single and lefts.keys() != rights.keys():
        return {0: folder / left}, {0: folder / right}
    return lefts, rights


def check_sizes(left: Image, right: Image, left_path: Path, right_path: Path) -> None:
    """Reject two images of different sizes."""
    if left.shape != right.shape:
        raise VfoaError(
            f"{right_path}: the right image is {width_by_height(right)} pixels, the left one ({left_path.name}) "
            f"{width_by_height(left)}; expected the same"
        )


def _joined_by_time(
    left: Mapping[int, Path], right: Mapping[int, Path], tolerance_ms: float | None, tick_ns: int
) -> Mapping[int, Path]:
    """The right files by left numbers, if the two are at most the tolerance apart, else by their own.

    Raises
    ------
    VfoaError
        If no number is on both sides, or without a tolerance most of those that are near to each other differ.
    """
    lefts, rights, renumbered = sorted(left), sorted(right), dict(right)
    if tolerance_ms is not None:
        for place, other in join_times(lefts, rights, round(tolerance_ms * 1e6 / tick_ns)):
            renumbered[lefts[place]] = renumbered.pop(rights[other])
    equal = left.keys() & renumbered.keys()
    if not equal:
        apart_ms = nearest_apart(lefts, rights) * tick_ns / 1e6
        raise VfoaError(f"the nearest stamps are {apart_ms:.3g} ms apart (median): set tolerance_ms in [source]")
    near = [] if tolerance_ms is not None else join_nearest(lefts, rights)
    if len(equal) < len(near) / 2:
        apart_ms = max(abs(lefts[place] - rights[other]) for place, other in near) * tick_ns / 1e6
        raise VfoaError(
            f"{len(equal)} of {len(near)} pairs have equal stamps, the others are up to {apart_ms:.3g} ms apart: "
            "set tolerance_ms in [source] (0 takes equal stamps alone)"
        )
    return renumbered


def split_views(image: Image, packing: Packing, where: str) -> tuple[Image, Image]:
    """Split an image (H, W, 3) into left and right view: left is the left, or the upper half."""
    axis = 1 if packing == "side_by_side" else 0
    if image.shape[axis] % 2:
        length = f"found a {('height', 'width')[axis]} of {image.shape[axis]} pixels"
        raise VfoaError(f"{where}: {length}; expected an even number, for two views {packing}")
    first, second = np.split(image, 2, axis=axis)
    return np.ascontiguousarray(first), np.ascontiguousarray(second)


def _unpaired(left: Pictures, right: Pictures) -> Iterator[str]:
    for side, of_side, other, of_other in (("left", left, "right", right), ("right", right, "left", left)):
        if alone := sorted(set(of_side.frames) - set(of_other.frames)):
            shown = ", ".join(map(str, alone[:_SHOWN])) + (" ..." if len(alone) > _SHOWN else "")
            images = f"1 {side} image has" if len(alone) == 1 else f"{len(alone)} {side} images have"
            yield f"{images} no {other} one, left out: frame {shown}"


def _common_rate(left: Pictures, right: Pictures) -> float | None:
    rate_hz, other_hz = left.rate_hz, right.rate_hz
    if rate_hz is not None and other_hz is not None and not math.isclose(rate_hz, other_hz, rel_tol=_RATES_DIFFER):
        raise VfoaError(
            f"{right.file(0)}: {other_hz:g} frames per second, {left.file(0)} has {rate_hz:g}; expected the same "
            "rate, or left, right and tolerance_ms = in [source], which pairs them by their times"
        )
    return rate_hz or other_hz


def _out_of_step(left: Pictures, right: Pictures, frames: Sequence[int]) -> list[str]:
    """A note if frames at one position were taken at different times: one video has lost some."""
    if left.times_ns is None or right.times_ns is None:
        return []
    times_ns = [np.array([times[number] for number in frames]) for times in (left.times_ns, right.times_ns)]
    apart_ns = np.abs(np.subtract(*(times - times[0] for times in times_ns)))  # they may have started apart
    is_out = apart_ns > (float(np.median(np.diff(times_ns[0]))) / 2 if len(frames) > 1 else math.inf)
    if not is_out.any():
        return []
    first, most_ms = frames[int(np.argmax(is_out))], apart_ns.max() / 1e6  # times are rounded, or jitter, before
    return [
        f"{right.file(first).name}: from frame {first} on not in step with {left.file(first).name}, by up to "
        f"{most_ms:.0f} ms; frames are paired by their places; tolerance_ms = in [source] pairs them by times"
    ]
