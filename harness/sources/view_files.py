"""The files of both views, as given in a manifest or on the command line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from harness.sources.media.frame_files import find_frames
from harness.sources.stereo_videos import PackedVideo, VideoPair
from harness.sources.stereo_views import ImagePairs, PackedImages, Packing, Swapped, Views, joined_by_time
from vfoa.settings import Settings

Layout = Literal[
    "images", "images_side_by_side", "images_top_bottom", "videos", "video_side_by_side", "video_top_bottom"
]


StampUnit = Literal["s", "ms", "us", "ns"]
TICKS_NS: dict[StampUnit, int] = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


class ViewFiles(Settings):
    """``left`` and ``right`` are a folder, a glob (``left*.png``) or a pattern (``left/%06d.png``), or two videos.

    ``both`` is the same for files that hold both views. ``stamps``: the numbers in the images' names are times, in this
    unit, and those of a pair may be ``tolerance_ms`` apart. ``swap`` exchanges left and right.
    """

    layout: Layout = "images"
    left: str | None = None
    right: str | None = None
    both: str | None = None
    stamps: StampUnit | None = None
    tolerance_ms: float | None = Field(default=None, ge=0, le=1e6)
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
                return ImagePairs(lefts, rights, tick)
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
