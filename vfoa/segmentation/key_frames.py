"""A segmenter that runs on key frames only: the frames between them get the masks of the last one, carried along."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence

from pydantic import Field

from vfoa.segmentation import Segmenter
from vfoa.segmentation.carry import carry
from vfoa.settings import Settings
from vfoa.types import Instances, StereoFrame


class KeyFrameSettings(Settings):
    """Settings of every segmenter that can run on key frames only."""

    every: int = Field(default=1, ge=1)
    """Segment every Nth frame; the frames between get its masks, moved by optical flow. Faster, and less exact."""


def key_number(number: int, frames: Sequence[int], every: int) -> int:
    """Return the number of a frame's key frame: every Nth one of these ascending numbers is a key frame.

    A frame that is not among them is a key frame of its own.
    """
    place = bisect_left(frames, number)
    is_listed = place < len(frames) and frames[place] == number
    return frames[place - place % every] if is_listed else number


class KeyFrameSegmenter:
    """Segments key frames, and frames to which the masks of their key frame cannot be carried safely.

    A frame's masks follow from this frame and its key frame alone, so frames may come in any order.

    Parameters
    ----------
    segmenter
        The segmenter of the key frames.
    key_of
        Returns the number of a frame's key frame, from the frame's number: its own for a key frame.
    read
        Reads a key frame by its number, if it was not the last one. None: frames come in order.
    """

    def __init__(
        self, segmenter: Segmenter, key_of: Callable[[int], int], read: Callable[[int], StereoFrame] | None = None
    ) -> None:
        self._segmenter, self._key_of, self._read = segmenter, key_of, read
        self._key: tuple[StereoFrame, Instances] | None = None

    def segment(self, frame: StereoFrame) -> Instances:
        """Return the masks of a frame; ``carried_from`` says whose they are if they were not found in it."""
        number = self._key_of(frame.index)
        if number == frame.index:
            return self._segment_key(frame)
        key, masks = self._key_frame(number)
        carried = carry(masks, key, frame)
        return self._segmenter.segment(frame) if carried is None else carried

    def _key_frame(self, number: int) -> tuple[StereoFrame, Instances]:
        """A key frame with its masks: the last one, or another one that is read and segmented again."""
        if self._key is None or self._key[0].index != number:
            assert self._read is not None, "a sequence without its key frame"
            self._segment_key(self._read(number))
        assert self._key is not None
        return self._key

    def _segment_key(self, frame: StereoFrame) -> Instances:
        masks = self._segmenter.segment(frame)
        self._key = frame, masks
        return masks
