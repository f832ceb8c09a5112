"""A segmenter that runs on key frames only. Frames in between reuse the masks of the last key frame, moved by flow."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from pydantic import Field

from vfoa.segmentation import Segmenter
from vfoa.segmentation.carry import Motion, carry, motion_between, no_motion, shrunk
from vfoa.settings import Settings
from vfoa.types import Image, Instances, StereoFrame


class KeyFrameSettings(Settings):
    """Settings of every segmenter that can run on key frames only."""

    every: int = Field(default=1, ge=1)
    """Segment every Nth frame; frames in between reuse its masks, moved by optical flow. Faster, and less exact."""


def path_to(number: int, frames: Sequence[int], every: int) -> Sequence[int]:
    """Return the numbers from the key frame whose masks a frame gets up to the frame.

    Every Nth one of these ascending numbers of a clip is a key frame. A frame that is not among them is a key frame of
    its own.
    """
    place = bisect_left(frames, number)
    if not (place < len(frames) and frames[place] == number):
        return (number,)
    return frames[place - place % every : place + 1]


class KeyFrameSegmenter:
    """Segments key frames, and frames to which the masks of their key frame cannot be carried safely.

    The masks of a frame depend on the frames since its key frame only, so frames may come in any order; they come
    fastest in that of the clip.

    Parameters
    ----------
    segmenter
        The segmenter of the key frames.
    path_to
        Returns the frame numbers from a frame's key frame up to the frame, as :func:`path_to` does.
    read
        Reads a frame of the path by its number, if it was not the last one. None: frames come in order.
    """

    def __init__(
        self,
        segmenter: Segmenter,
        path_to: Callable[[int], Sequence[int]],
        read: Callable[[int], StereoFrame] | None = None,
    ) -> None:
        self._segmenter, self._path_to, self._read = segmenter, path_to, read
        self._followed: list[_Followed] = []

    def segment(self, frame: StereoFrame) -> Instances:
        """Return the masks of a frame; ``carried_from`` says whose they are if they were not found in it."""
        before = self._followed_to(self._path_to(frame.index))
        now = self._follow(before, frame)
        carried = now.masks if before is None else carry(now.masks, now.key, frame, now.motion)
        masks = self._segmenter.segment(frame) if carried is None else carried
        self._followed = [state for state in (before, now) if state]
        return masks

    def _followed_to(self, path: Sequence[int]) -> _Followed | None:
        """The state after the frame before the last one of a path; None if there is none before.

        The last two states are kept, since a frame may come again after an error.
        """
        if len(path) == 1:
            return None
        for state in self._followed:
            if (state.key.index, state.number) == (path[0], path[-2]):
                return state
        assert self._read is not None, "a sequence without its key frame"
        state_before: _Followed | None = None
        for number in path[:-1]:
            state_before = self._follow(state_before, self._read(number))
        return state_before

    def _follow(self, before: _Followed | None, frame: StereoFrame) -> _Followed:
        """The state after one more frame; without one before, the frame is a key frame."""
        image = shrunk(frame.left)
        if before is None:
            masks = self._segmenter.segment(frame)
            return _Followed(number=frame.index, image=image, key=frame, masks=masks, motion=no_motion(image))
        motion = before.motion.then(motion_between(before.image, image))
        return replace(before, number=frame.index, image=image, motion=motion)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Followed:
    """The last frame, shrunk; its key frame with its masks, and the motion from there to the last frame."""

    number: int
    image: Image
    key: StereoFrame
    masks: Instances
    motion: Motion
