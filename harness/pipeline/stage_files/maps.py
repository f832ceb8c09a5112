"""Disparity of other programs, and maps for each frame, read from files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.files.digests import digest_files
from harness.files.remote import expand
from harness.sources import Clip
from harness.sources.media.frame_files import check_printf, printf_name
from harness.sources.media.images import width_by_height
from harness.sources.media.maps import read_disparity
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.types import Disparity, StereoFrame


class FileMatcherSettings(Settings):
    """Location of the maps under ``root``."""

    root: str
    """Folder of the maps; ``${CLIP}`` stands for the clip's name."""
    pattern: str = "frame_%04d.png"
    """Name of a map below ``root``, with one printf field for the frame number."""
    partial: bool = False
    """Accept frames without a map until one is read: enough for a run of the first frames."""


class FileMatcher:
    """A matcher that reads each frame's disparity: Sintel PNG, 16-bit PNG, PFM or npy, recognised by content."""

    Settings = FileMatcherSettings

    def __init__(self, settings: FileMatcherSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), "stereo.root")
        check_printf(settings.pattern, "stereo.pattern")
        self._maps = MapFiles(root, settings.pattern, clip.frames, what="disparity", partial=settings.partial)

    def match(self, frame: StereoFrame) -> Disparity:
        """Read one frame's map.

        Raises
        ------
        VfoaError
            If it cannot be read, its size is not the image's, or most of it cannot be disparities in pixels.
        """
        path = self._maps.path(frame.index)
        disparity = read_disparity(path)
        check_size(disparity, frame, path)
        known = np.isfinite(disparity)
        beyond = np.count_nonzero(disparity > np.arange(1, disparity.shape[1] + 1))  # NaN is not
        if 2 * beyond > np.count_nonzero(known):
            raise VfoaError(
                f"{path}: {beyond} of {np.count_nonzero(known)} disparities lead beyond the right image (median "
                f"{np.median(disparity[known]):.4g}); expected pixels: depth, or counts of a pixel's parts?"
            )
        return Disparity(disparity_px=disparity)

    def digest(self) -> str:
        """Hexadecimal sha256 of every map."""
        return digest_files(self._maps.parts())


class MapFiles:
    """A map for each frame, in a file named by its number less ``offset``.

    One that is missing is a :class:`VfoaError`, unless ``partial``: its message says ``what`` it is, and a ``hint``.
    """

    def __init__(
        self,
        root: Path,
        pattern: str,
        frames: Sequence[int],
        *,
        what: str,
        partial: bool,
        offset: int = 0,
        hint: str = "",
    ) -> None:
        self._root, self._pattern, self._offset, self._partial = root, pattern, offset, partial
        self._frames = tuple(frames)
        missing = [] if partial else [number for number in self._frames if not self.path(number).is_file()]
        if missing:
            raise VfoaError(
                f"{self.path(missing[0])}: no such file; expected the {what} of frame {missing[0]} "
                f"({len(missing)} of {len(self._frames)} frames are missing{hint})"
            )

    def path(self, frame: int) -> Path:
        """The file of a frame."""
        return self._root / printf_name(self._pattern, frame - self._offset)

    def parts(self) -> Iterator[tuple[str, Path]]:
        """Each file that there is, with its frame, for a digest."""
        paths = ((str(number), self.path(number)) for number in self._frames)
        return ((number, path) for number, path in paths if not self._partial or path.is_file())


def check_size(pixels: NDArray[Any], frame: StereoFrame, path: Path, what: str = "map is") -> None:
    """Raise a :class:`VfoaError` if what a file holds has not the size of the left image."""
    if pixels.shape != frame.left.shape[:2]:
        found, expected = map(width_by_height, (pixels, frame.left))
        raise VfoaError(f"{path}: the {what} {found} pixels, the left image {expected}; expected the same size")
