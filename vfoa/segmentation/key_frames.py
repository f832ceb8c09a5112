"""A segmenter that runs on key frames only. Frames in between reuse the masks of an earlier key frame, moved by flow.

With a delay, another thread segments a key frame while frames still use the masks of the key frame before. The number
of frames decides when the new masks are used, not the time that the segmenter takes: if they are not ready by then, the
frame waits. So the masks of a frame depend only on the clip and the settings.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from threading import Lock

from pydantic import Field

from vfoa.segmentation import Segmenter
from vfoa.segmentation.carry import Motion, carry, motion_between, no_motion, shrunk
from vfoa.settings import Settings
from vfoa.types import Image, Instances, StereoFrame


class KeyFrameSettings(Settings):
    """Settings of every segmenter that can run on key frames only."""

    every: int = Field(default=1, ge=1)
    """Segment every Nth frame; frames in between reuse its masks, moved by optical flow. Faster, and less exact."""
    delay: int = Field(default=0, ge=0)
    """Use the masks of a key frame from this many frames later on, and those of the key frame before until then. With
    several threads, frames do not wait for the segmenter meanwhile; masks are up to ``every + delay - 1`` frames
    old."""

    @property
    def on_every_frame(self) -> bool:
        """Whether each frame gets masks found in itself."""
        return self.every == 1 and self.delay == 0


def path_to(number: int, frames: Sequence[int], settings: KeyFrameSettings) -> Sequence[int]:
    """Return the numbers from the key frame whose masks a frame gets up to the frame.

    Every Nth one of these ascending numbers of a clip is a key frame. A frame that is not among them is a key frame of
    its own.
    """
    place = bisect_left(frames, number)
    if not (place < len(frames) and frames[place] == number):
        return (number,)
    due = max(place - settings.delay, 0)
    return frames[due - due % settings.every : place + 1]


class KeyFrameSegmenter:
    """Segments key frames, and frames to which no key frame's masks can be carried safely.

    A frame gets the masks of the key frame at the beginning of its path. If they cannot be carried, it gets those of
    the next key frame on the path, and so on. These frames and those between are all that its masks depend on, so
    frames may come in any order; they come fastest in that of the clip.

    Parameters
    ----------
    segmenter
        The segmenter of the key frames.
    settings
        How far apart key frames are, and from when on their masks are used.
    path_to
        Returns the frame numbers from a frame's key frame up to the frame, as :func:`path_to` does.
    read
        Reads a frame of the path by its number, if it was not the last one. None: frames come in order.
    beside
        Segments key frames in another thread before their masks are used. None: when they are used.
    """

    def __init__(
        self,
        segmenter: Segmenter,
        settings: KeyFrameSettings,
        path_to: Callable[[int], Sequence[int]],
        read: Callable[[int], StereoFrame] | None = None,
        *,
        beside: Executor | None = None,
    ) -> None:
        self._segmenter, self._settings, self._path_to, self._read = segmenter, settings, path_to, read
        self._beside = beside if settings.delay else None
        self._one_at_a_time = Lock()
        self._followed: list[_Followed] = []

    def segment(self, frame: StereoFrame) -> Instances:
        """Return the masks of a frame; ``carried_from`` says whose they are if they were not found in it."""
        path = self._path_to(frame.index)
        before = self._followed_to(path)
        now = self._follow(before, frame, path)
        masks = self._masks(now, frame)
        self._followed = [state for state in (before, now) if state]
        return masks

    def _masks(self, now: _Followed, frame: StereoFrame) -> Instances:
        for key in now.keys:
            masks = key.answer()
            carried = masks if key.frame.index == frame.index else carry(masks, key.frame, frame, key.motion)
            if carried is not None:
                return carried
        return self._segment(frame)

    def _followed_to(self, path: Sequence[int]) -> _Followed | None:
        """The state after the frame before the last one of a path; None if there is none before.

        The last two states are kept, since a frame may come again after an error.
        """
        if len(path) == 1:
            return None
        for state in self._followed:
            if state.number == path[-2] and any(key.frame.index == path[0] for key in state.keys):
                return state
        assert self._read is not None, "a sequence without its key frame"
        state_before: _Followed | None = None
        for number in path[:-1]:
            state_before = self._follow(state_before, self._read(number), path)
        return state_before

    def _follow(self, before: _Followed | None, frame: StereoFrame, path: Sequence[int]) -> _Followed:
        """The state after one more frame, with the key frames of the path."""
        image = shrunk(frame.left)
        keys = [key for key in before.keys if key.frame.index in path] if before else []
        if before and keys:
            step = motion_between(before.image, image)
            keys = [replace(key, motion=key.motion.then(step)) for key in keys]
        if path.index(frame.index) % self._settings.every == 0:
            answer = _Answer(partial(self._segment, frame), self._beside)
            keys.append(_Key(frame=frame, answer=answer, motion=no_motion(image)))
        return _Followed(number=frame.index, image=image, keys=tuple(keys))

    def _segment(self, frame: StereoFrame) -> Instances:
        with self._one_at_a_time:
            return self._segmenter.segment(frame)


class _Answer:
    """The masks of a key frame, found in another thread or when they are first used; found again after an error."""

    def __init__(self, find: Callable[[], Instances], beside: Executor | None) -> None:
        self._find = find
        self._masks: Instances | None = None
        self._begun = beside.submit(find).result if beside else None

    def __call__(self) -> Instances:
        if self._masks is None:
            find, self._begun = self._begun or self._find, None
            self._masks = find()
        return self._masks


@dataclass(frozen=True, slots=True, kw_only=True)
class _Key:
    """A key frame, its masks, and the motion from it to the last frame."""

    frame: StereoFrame
    answer: Callable[[], Instances]
    motion: Motion


@dataclass(frozen=True, slots=True, kw_only=True)
class _Followed:
    """The last frame, shrunk, and the key frames that its path or a later one begins with."""

    number: int
    image: Image
    keys: tuple[_Key, ...]
