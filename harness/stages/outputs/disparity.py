"""Disparity of another program, read from files."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from harness.files.digests import digest_files
from harness.remote import expand
from harness.sources import Clip
from harness.sources.media.frame_files import check_printf, printf_name
from harness.sources.media.maps import read_disparity
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.types import Disparity, StereoFrame


class FileMatcherSettings(Settings):
    """Location of the maps: ``pattern`` (one printf field for the frame number) under ``root``.

    ``counts_per_px`` is the scale of 16-bit PNG files: 256 is KITTI's. With ``partial``, a frame without a map is an
    error only when it is read: enough for a run of the clip's first frames.
    """

    root: str
    """Folder of the maps; ``${CLIP}`` stands for the clip's name."""
    pattern: str = "frame_%04d.png"
    """Name of a map below ``root``, with one printf field for the frame number."""
    counts_per_px: float = Field(default=256.0, gt=0)
    """Scale of 16-bit PNG files: counts per pixel of disparity. KITTI's is 256."""
    partial: bool = False
    """Accept frames without a map until one is read: enough for a run of the first frames."""


class FileMatcher:
    """A matcher that reads each frame's disparity: Sintel PNG, 16-bit PNG, PFM or npy, recognised by content."""

    Settings = FileMatcherSettings

    def __init__(self, settings: FileMatcherSettings, clip: Clip) -> None:
        self._root = expand(settings.root, Path.cwd(), "stereo.root")
        self._settings = settings
        check_printf(settings.pattern, "stereo.pattern")
        self._frames = tuple(clip.frames)
        missing = [number for number in self._frames if not self._path(number).is_file()]
        if missing and not settings.partial:
            raise VfoaError(
                f"{self._path(missing[0])}: no such file; expected the disparity of frame {missing[0]} "
                f"({len(missing)} of {len(self._frames)} frames are missing)"
            )

    def match(self, frame: StereoFrame) -> Disparity:
        """Read one frame's map.

        Raises
        ------
        VfoaError
            If it cannot be read, or its size is not the image's.
        """
        path = self._path(frame.index)
        disparity = read_disparity(path, counts_per_px=self._settings.counts_per_px)
        if disparity.shape != frame.left.shape[:2]:
            raise VfoaError(
                f"{path}: the map is {disparity.shape[1]} x {disparity.shape[0]} pixels, "
                f"the left image {frame.rig.width_px} x {frame.rig.height_px}"
            )
        return Disparity(disparity_px=disparity)

    def digest(self) -> str:
        """Hexadecimal sha256 of every map."""
        present = (number for number in self._frames if not self._settings.partial or self._path(number).is_file())
        return digest_files((str(number), self._path(number)) for number in present)

    def _path(self, number: int) -> Path:
        return self._root / printf_name(self._settings.pattern, number)
