"""The pictures for a calibration, one pair at a time."""

from __future__ import annotations

from collections.abc import Iterator

from harness.sources.calibrate.views import Dropped
from harness.sources.stereo_views import Views
from vfoa.errors import VfoaError
from vfoa.types import Image


class Pictures:
    """Pairs (number, left, right) of one size, in order; unusable ones are added to :attr:`dropped` as they are met.

    ``every``: use every Nth frame of a video. ``size_px`` is the (width, height) of the first pair that can be read.

    Raises
    ------
    VfoaError
        If no pair can be read.
    """

    def __init__(self, views: Views, every: int = 1) -> None:
        self._views = views
        self._numbers = views.frames[::every]
        self.dropped: list[Dropped] = []
        first = next(self._readable(), None)
        if first is None:
            reasons = "; ".join(each.reason for each in self.dropped[:1])
            raise VfoaError(f"none of {len(self._numbers)} pairs of pictures can be read: {reasons}")
        self.size_px = _size(first[1])

    def __iter__(self) -> Iterator[tuple[int, Image, Image]]:
        self.dropped.clear()
        for number, left, right in self._readable():
            if _size(left) == self.size_px:
                yield number, left, right
            else:
                self._drop(number, f"{_size(left)} pixels; expected {self.size_px} as in the first pair")

    def _readable(self) -> Iterator[tuple[int, Image, Image]]:
        for number in self._numbers:
            try:
                left, right = self._views.read(number)
            except VfoaError as error:
                self._drop(number, str(error))
            else:
                yield number, left, right

    def _drop(self, number: int, reason: str) -> None:
        self.dropped.append(Dropped(number=number, reason=reason))


def _size(image: Image) -> tuple[int, int]:
    return image.shape[1], image.shape[0]
