"""Stereo matching: from a rectified pair to a disparity map of the left view."""

from __future__ import annotations

from typing import Protocol

from vfoa.registry import Registry
from vfoa.stereo.region import Region
from vfoa.types import Disparity, StereoFrame


class StereoMatcher(Protocol):
    """Finds the disparity of every pixel of the left view. Built as ``Class(settings)``, with ``Class.Settings``."""

    def match(self, frame: StereoFrame) -> Disparity:
        """Match one pair. Pixels that could not be matched are NaN."""
        ...


class RegionMatcher(Protocol):
    """What a matcher has besides that can match a part of the image in less time. Its settings ask for it.

    ``region = "needed"`` in the settings has it called with the region of things and heads.
    """

    def match_region(self, frame: StereoFrame, region: Region) -> Disparity:
        """Match one pair in a region of the left view; outside of it, all is NaN."""
        ...


MATCHERS = Registry(
    kind="stereo.matcher",
    builtin={
        "bm": "vfoa.stereo.block_matching:BlockMatcher",
        "sgbm": "vfoa.stereo.block_matching:SemiGlobalMatcher",
        "hitnet": "vfoa.stereo.hitnet:HitNet",
    },
    group="vfoa.stereo",
)
