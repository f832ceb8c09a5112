"""The views of a frame on the labelling page: the images of a clip with outlines."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from harness.annotate import pictures
from harness.annotate.scene import Scenes
from harness.annotate.suggestions import Predictions
from harness.clips.manifest import ClipManifest
from harness.sources import Clip, LeftClip
from vfoa.types import Image, StereoFrame

_CACHED_FRAMES = 2
"""A frame's picture and its scene are requested one after the other. Large images take tens of MB."""
_CACHED_PICTURES = 256
_CACHED_SCENES = 2048


class Views:
    """The images of a clip, and its disparity. Not for several threads at once."""

    def __init__(self, clip: Clip, manifest: ClipManifest, predictions: Predictions | None) -> None:
        self._clip, self._manifest = clip, manifest
        self._scenes = Scenes(clip, predictions)
        self._disparity = pictures.DisparityView(clip)
        self._frame = lru_cache(_CACHED_FRAMES)(self._read)
        self._left = lru_cache(_CACHED_FRAMES)(self._read_left)
        self._picture = lru_cache(_CACHED_PICTURES)(self._draw)
        self._scene = lru_cache(_CACHED_SCENES)(self._look_at)

    def use(self, manifest: ClipManifest, predictions: Predictions | None) -> None:
        """Use the names of a changed manifest."""
        self._manifest, self._scenes.predictions = manifest, predictions
        self._scene.cache_clear()

    def scene(self, number: int) -> dict[str, Any]:
        """Outlines and heads in the left image."""
        return self._scene(number)

    def picture(
        self, view: pictures.View, number: int, subject: str | None, region: pictures.RegionPx | None, width: int | None
    ) -> bytes | None:
        """A region of a view, or all of it."""
        return self._picture(view, number, subject, region, width)

    def _read(self, number: int) -> StereoFrame:
        return self._clip.frame(number)

    def _read_left(self, number: int) -> Image:
        return self._clip.left(number) if isinstance(self._clip, LeftClip) else self._frame(number).left

    def _look_at(self, number: int) -> dict[str, Any]:
        height, width = self._left(number).shape[:2]
        scene = self._scenes.at(number, self._manifest)
        return {**scene.plain(), "size_px": (width, height)}

    def _draw(
        self, view: pictures.View, number: int, subject: str | None, region: pictures.RegionPx | None, width: int | None
    ) -> bytes | None:
        if view == "head":
            box = self._scene(number)["heads_px"].get(subject)
            return None if box is None else pictures.jpeg(pictures.head(self._left(number), box))
        if view == "disparity":
            disparity = pictures.colour(self._disparity.at(self._frame(number)))
            return pictures.jpeg(pictures.shrunk(disparity, region, width))
        image = self._left(number) if view == "left" else self._frame(number).right
        return None if image is None else pictures.jpeg(pictures.shrunk(image, region, width))
