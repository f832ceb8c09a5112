"""Which files hold both views, as a manifest or the command line says it."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from pydantic import model_validator

from harness.adapters.stereo_videos import PackedVideo, VideoPair
from harness.adapters.stereo_views import ImagePairs, PackedImages, Packing, Views
from harness.media.frame_files import find_frames
from vfoa.settings import Settings

Layout = Literal[
    "images", "images_side_by_side", "images_top_bottom", "videos", "video_side_by_side", "video_top_bottom"
]


StampUnit = Literal["s", "ms", "us", "ns"]
TICKS_NS: dict[StampUnit, int] = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


class ViewFiles(Settings):
    """``left`` and ``right`` are a folder, a glob (``left*.png``) or a pattern (``left/%06d.png``), or two videos.

    ``both`` is the same for files that hold both views. ``stamps``: the numbers in the images' names are times, in this
    unit.
    """

    layout: Layout = "images"
    left: str | None = None
    right: str | None = None
    both: str | None = None
    stamps: StampUnit | None = None

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
        return self

    def views(self, folder: Path) -> Views:
        """The views' files under a folder.

        Raises
        ------
        VfoaError
            If nothing is found, it cannot be numbered, or (videos) not read.
        """
        left, right, both = (str(name) for name in (self.left, self.right, self.both))
        packing: Packing = "top_bottom" if self.layout.endswith("top_bottom") else "side_by_side"
        tick = None if self.stamps is None else TICKS_NS[self.stamps]
        match self.layout:
            case "images":
                return ImagePairs(
                    find_frames(folder, left, "source.left"), find_frames(folder, right, "source.right"), tick
                )
            case "videos":
                return VideoPair(folder / left, folder / right)
            case "images_side_by_side" | "images_top_bottom":
                return PackedImages(find_frames(folder, both, "source.both"), packing, tick)
            case "video_side_by_side" | "video_top_bottom":
                return PackedVideo(folder / both, packing)
