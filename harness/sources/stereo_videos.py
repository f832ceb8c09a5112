"""Both views of a frame from two videos or one, by the frames' positions from 0."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np

from harness.files.digests import digest_files, file_digest
from harness.sources.media.video import Video
from harness.sources.stereo_views import Packing, check_sizes, split
from vfoa.errors import VfoaError
from vfoa.types import Image

_RATES_DIFFER = 5e-4  # half of the difference between 30 and 29.97 frames per second


class VideoPair:
    """Two videos, joined by the frames' positions from 0.

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
        self.frames = tuple(range(min(counts)))
        self.rate_hz = rates[0] or rates[1]
        longer = (left, right)[counts[1] > counts[0]]
        rest = (f"{longer.name}: {abs(counts[0] - counts[1])} frames after the other video's end are left out",)
        self.notes = (
            *self._left.notes,
            *self._right.notes,
            *(rest if counts[0] != counts[1] else ()),
            *_asunder(self._left, self._right, len(self.frames)),
        )

    def time_ns(self, number: int) -> int:
        """Time in the left video, from 0."""
        return self._left.time_ns(number)

    def where(self, number: int) -> str:
        """The left file and the frame."""
        return f"{self._left.path}: frame {number}"

    def read(self, number: int) -> tuple[Image, Image]:
        """The frame of each video."""
        left, right = self._left.read(number), self._right.read(number)
        check_sizes(left, right, str(self._left.path), self._right.path)
        return left, right

    def read_left(self, number: int) -> Image:
        """The left frame alone."""
        return self._left.read(number)

    def digest(self) -> str:
        """Digest of both files."""
        return digest_files((("left", self._left.path), ("right", self._right.path)))


class PackedVideo:
    """One video whose frames hold both views, by their positions from 0."""

    def __init__(self, path: Path, packing: Packing) -> None:
        self._video, self._packing = Video(path), packing
        self.frames = tuple(range(len(self._video.index.stamps_ns)))
        self.rate_hz = self._video.index.rate_hz
        self.notes = self._video.notes

    def time_ns(self, number: int) -> int:
        """Time in the video, from 0."""
        return self._video.time_ns(number)

    def where(self, number: int) -> str:
        """The file and the frame."""
        return f"{self._video.path}: frame {number}"

    def read(self, number: int) -> tuple[Image, Image]:
        """Both halves of the frame."""
        return split(self._video.read(number), self._packing, self.where(number))

    def digest(self) -> str:
        """Digest of the file and the packing."""
        return hashlib.sha256(f"{self._packing} {file_digest(self._video.path)}".encode()).hexdigest()


def _asunder(left: Video, right: Video, count: int) -> list[str]:
    """A note if frames at one position were taken at different times: one video has lost some."""
    times_ns = [np.array([video.time_ns(place) for place in range(count)]) for video in (left, right)]
    apart_ns = np.abs(times_ns[0] - times_ns[1])
    if count < 2 or apart_ns.max() <= float(np.median(np.diff(times_ns[0]))) / 2:
        return []
    first, most_ms = int(np.argmax(apart_ns > 0)), apart_ns.max() / 1e6
    return [
        f"{right.path.name}: from frame {first} on not in step with {left.path.name}, by up to {most_ms:.0f} ms; "
        "frames are paired by their places"
    ]
