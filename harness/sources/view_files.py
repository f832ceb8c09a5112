"""The files of both views, as given in a manifest or on the command line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from harness.files.io import read_text
from harness.sources.media.frame_files import find_frames
from harness.sources.stereo_videos import PackedVideo, VideoPair
from harness.sources.stereo_views import ImagePairs, PackedImages, Packing, Swapped, Views, joined_by_time
from vfoa.errors import VfoaError
from vfoa.settings import Settings

Layout = Literal[
    "images", "images_side_by_side", "images_top_bottom", "videos", "video_side_by_side", "video_top_bottom"
]


StampUnit = Literal["s", "ms", "us", "ns"]
TICKS_NS: dict[StampUnit, int] = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


_TIME = re.compile(r"(?:19|20|21)[0-9]{2}-[0-9]{2}-[0-9]{2}[ T][0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?")


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
        return Swapped(views) if self.swap else views

    def _views(self, folder: Path) -> Views:
        left, right, both = (str(name) for name in (self.left, self.right, self.both))
        packing: Packing = "top_bottom" if self.layout.endswith("top_bottom") else "side_by_side"
        tick = None if self.stamps is None else TICKS_NS[self.stamps]
        match self.layout:
            case "images":
                lefts, rights = find_sides(folder, left, right)
                if tick is not None and self.tolerance_ms is not None:
                    rights = joined_by_time(lefts, rights, round(self.tolerance_ms * 1e6 / tick))
                times_ns = None if self.times is None else _read_times(folder / self.times, lefts)
                return ImagePairs(lefts, rights, tick, times_ns)
            case "videos":
                return VideoPair(folder / left, folder / right)
            case "images_side_by_side" | "images_top_bottom":
                return PackedImages(find_frames(folder, both, "source.both"), packing, tick)
            case "video_side_by_side" | "video_top_bottom":
                return PackedVideo(folder / both, packing)


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
