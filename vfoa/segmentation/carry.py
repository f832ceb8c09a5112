"""Masks carried from a key frame to a later one by dense optical flow (Kroeger et al. 2016, DIS).

The flow is computed between neighbouring frames and joined: over several frames at once, it loses fast objects.
Each pixel of the later image takes the instance of the pixel that the flow finds for it in the key frame. Where a step
of the flow is followed there and back, it should end where it began (Kalal et al. 2010, forward-backward error), at a
pixel that looks alike. If that failed at most of an object's pixels in some frame since, the masks are not carried:
after a cut, a fast motion or an occlusion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.types import Image, Instances, Map, Mask, StereoFrame

FLOW_SIDE_PX = 400
"""Flow is computed in images shrunk by a whole number, to at least this length of the longer side."""

ROUND_TRIP_PX = 1.5
"""Greatest forward-backward error of a pixel that counts as followed, in pixels of the shrunk images."""

ALIKE_GRAY = 25
"""Greatest difference of gray values, 0 to 255, of a pixel that counts as followed."""

LEAST_FOLLOWED = 0.5
"""Least share of the pixels of each object that must be followed."""


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
