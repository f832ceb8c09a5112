"""Stereo matching: from a frame to a disparity map of the left view."""

from __future__ import annotations

from typing import Protocol

from vfoa.registry import Registry
from vfoa.stereo.region import Region
from vfoa.types import Disparity, StereoFrame


class StereoMatcher(Protocol):
    """Finds the disparity of every pixel of the left view. Built as ``Class(settings)``, with ``Class.Settings``."""

    def match(self, frame: StereoFrame) -> Disparity:
        """Return the disparity (H, W) of the left view, pixels; NaN where no match was found."""
        ...


class RegionMatcher(Protocol):
    """The second method of a matcher that can match a part of the image in less time.

    With ``region = "needed"`` in its settings, it is called with the region of objects and heads.
    """

    def match_region(self, frame: StereoFrame, region: Region) -> Disparity:
        """Return the disparity (H, W) of a region of the left view, pixels; NaN outside it and where no match is."""
        ...


MATCHERS = Registry(
    kind="stereo.matcher",
    builtin={
        "bm": "vfoa.stereo.block_matching:BlockMatcher",
        "sgbm": "vfoa.stereo.block_matching:SemiGlobalMatcher",
        "hitnet": "vfoa.stereo.hitnet:HitNet",
        "sensor": "vfoa.stereo.sensor:SensorDepth",
    },
    group="vfoa.stereo",
)
