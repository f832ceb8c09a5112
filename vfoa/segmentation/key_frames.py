"""A segmenter that runs on key frames only. Frames in between reuse the masks of the last key frame, moved by flow."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vfoa.segmentation import Segmenter
from vfoa.settings import Settings
from vfoa.types import Image, Instances, Map, Mask, StereoFrame

FLOW_SIDE_PX = 400
"""Flow is computed in images shrunk by a whole number, to at least this length of the longer side."""

ROUND_TRIP_PX = 1.5
"""Greatest forward-backward error of a pixel that counts as followed, in pixels of the shrunk images."""

ALIKE_GRAY = 25
"""Greatest difference of gray values, 0 to 255, of a pixel that counts as followed."""

LEAST_FOLLOWED = 0.5
"""Least share of the pixels of each object that must be followed."""


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
        self._followed: list[_MotionState] = []

    def segment(self, frame: StereoFrame) -> Instances:
        """Return the masks of a frame; ``carried_from`` says whose they are if they were not found in it."""
        before = self._followed_to(self._path_to(frame.index))
        now = self._follow(before, frame)
        carried = now.masks if before is None else carry(now.masks, now.key, frame, now.motion)
        masks = self._segmenter.segment(frame) if carried is None else carried
        self._followed = [state for state in (before, now) if state]
        return masks

    def _followed_to(self, path: Sequence[int]) -> _MotionState | None:
        """The state after the frame before the last one of a path; None if there is none before.

        The last two states are kept, since a frame may come again after an error.
        """
        if len(path) == 1:
            return None
        for state in self._followed:
            if (state.key.index, state.number) == (path[0], path[-2]):
                return state
        assert self._read is not None, "a sequence without its key frame"
        state_before: _MotionState | None = None
        for number in path[:-1]:
            state_before = self._follow(state_before, self._read(number))
        return state_before

    def _follow(self, before: _MotionState | None, frame: StereoFrame) -> _MotionState:
        """The state after one more frame; without one before, the frame is a key frame."""
        image = shrunk(frame.left)
        if before is None:
            masks = self._segmenter.segment(frame)
            return _MotionState(number=frame.index, image=image, key=frame, masks=masks, motion=no_motion(image))
        motion = before.motion.then(motion_between(before.image, image))
        return replace(before, number=frame.index, image=image, motion=motion)


@dataclass(frozen=True, slots=True, kw_only=True)
class _MotionState:
    """The last frame, shrunk; its key frame with its masks, and the motion from there to the last frame."""

    number: int
    image: Image
    key: StereoFrame
    masks: Instances
    motion: Motion


# Masks carried from a key frame to a later one by dense optical flow (Kroeger et al. 2016, DIS)
#
# The flow is computed between neighbouring frames and joined: over several frames at once, it loses fast objects. Each
# pixel of the later image takes the instance of the pixel that the flow finds for it in the key frame. Where a step of
# the flow is followed there and back, it should end where it began (Kalal et al. 2010, forward-backward error), at a
# pixel that looks alike. If that failed at most of an object's pixels in some frame since, the masks are not carried:
# after a cut, a fast motion or an occlusion.


@dataclass(frozen=True, slots=True)
class Motion:
    """Where the pixels of a frame were in an earlier one, both shrunk by :func:`shrunk`.

    ``flow`` (h, w, 2) leads from each pixel to its place in the earlier image, in pixels. ``followed`` (h, w) are the
    pixels that were followed in every frame since.
    """

    flow: Map
    followed: Mask

    def then(self, step: Motion) -> Motion:
        """Join the motion of the next frame to this one."""
        if step.followed.shape != self.followed.shape:
            return _lost(step.followed.shape)
        followed = _sampled(self.followed.view(np.uint8), step.flow, cv2.INTER_NEAREST).view(np.bool_)
        return Motion(step.flow + _sampled(self.flow, step.flow), step.followed & followed)


def no_motion(image: Image) -> Motion:
    """The motion from a shrunk image (h, w) to itself."""
    return Motion(np.zeros((*image.shape, 2), np.float32), np.ones(image.shape, np.bool_))


def motion_between(before: Image, after: Image) -> Motion:
    """The motion from one shrunk image (h, w) to the next one; nothing is followed if their sizes differ."""
    if before.shape != after.shape:
        return _lost(after.shape)
    flow = _flow(after, before)
    return Motion(flow, _returned(flow, _flow(before, after)) & _alike(before, after, flow))


def carry(masks: Instances, key: StereoFrame, now: StereoFrame, motion: Motion) -> Instances | None:
    """Return the masks of a key frame, moved to where its objects are in another frame; None if it is uncertain.

    ``motion`` is the one from the key frame to the other. The instances keep their ids and scores. One that is no
    longer seen is dropped, and one that is new is missing.
    """
    if key.left.shape != now.left.shape:
        return None
    ids = _moved(masks.ids, motion.flow)
    if not _is_followed(ids, motion.followed):
        return None
    seen = set(np.flatnonzero(np.bincount(ids.ravel())).tolist())
    instances = tuple(instance for instance in masks.instances if instance.id in seen)
    return Instances(ids=ids, instances=instances, carried_from=key.index, carried_s=(now.time_ns - key.time_ns) / 1e9)


def _lost(shape: tuple[int, ...]) -> Motion:
    return Motion(np.zeros((*shape, 2), np.float32), np.zeros(shape, np.bool_))


def shrunk(image: Image) -> Image:
    """An image (H, W, 3) in gray and shrunk (h, w), as motion is computed from it."""
    height, width = image.shape[:2]
    divisor = max(1, max(height, width) // FLOW_SIDE_PX)
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    size = max(1, width // divisor), max(1, height // divisor)
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _flow(start: Image, end: Image) -> Map:
    """Motion (h, w, 2) of each pixel of one gray image to the other, in pixels; the same for any number of threads."""
    flow: Map = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST).calc(start, end, None)
    return flow


def _moved(ids: NDArray[np.uint16], flow: Map) -> NDArray[np.uint16]:
    """Ids (H, W), taken from where the flow (h, w, 2) of the shrunk image points to."""
    height, width = ids.shape
    scaled = cv2.multiply(flow, (width / flow.shape[1], height / flow.shape[0], 0, 0))
    large = cv2.resize(scaled, (width, height), interpolation=cv2.INTER_LINEAR)
    places = cv2.add(large, _grid(height, width), dst=large)
    moved = cv2.remap(ids, places, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(moved, dtype=np.uint16)


def _returned(there: Map, back: Map) -> Mask:
    """The pixels (h, w) from which the flow ``there`` (h, w, 2) and then ``back`` ends where it began."""
    error_u, error_v = cv2.split(there + _sampled(back, there))
    return np.asarray(error_u * error_u + error_v * error_v <= ROUND_TRIP_PX**2)


def _alike(before: Image, after: Image, flow: Map) -> Mask:
    """The pixels (h, w) of the later gray image that look like the ones of the earlier one that the flow points to."""
    return np.asarray(cv2.absdiff(_sampled(before, flow), after) <= ALIKE_GRAY)


def _sampled(values: Map | Image, flow: Map, interpolation: int = cv2.INTER_LINEAR) -> NDArray[Any]:
    """Values (h, w, ...) at the places that the flow (h, w, 2) points to; the border is repeated."""
    places = _grid(*flow.shape[:2]) + flow
    return cv2.remap(values, places, None, interpolation, borderMode=cv2.BORDER_REPLICATE)


def _is_followed(ids: NDArray[np.uint16], followed: Mask) -> bool:
    """Whether enough pixels of each object, as ids (H, W), are among the followed ones (h, w)."""
    shrunk = cv2.resize(ids, followed.shape[::-1], interpolation=cv2.INTER_NEAREST)
    pixels = np.bincount(shrunk.ravel())
    followed_pixels = np.bincount(shrunk[followed], minlength=len(pixels))
    return bool((followed_pixels >= LEAST_FOLLOWED * pixels)[1:].all())


@lru_cache(maxsize=4)
def _grid(height: int, width: int) -> Map:
    """The position (u, v) of each pixel, (height, width, 2)."""
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float32)
    grid.flags.writeable = False
    return grid
