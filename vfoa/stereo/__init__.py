"""Stereo matching: from a rectified pair to a disparity map of the left view."""

from __future__ import annotations

from typing import Protocol

from vfoa.registry import Registry
from vfoa.types import Disparity, StereoFrame


class StereoMatcher(Protocol):
    """Finds the disparity of every pixel of the left view. Built as ``Class(settings)``, with ``Class.Settings``."""

    def match(self, frame: StereoFrame) -> Disparity:
        """Match one pair. Pixels that could not be matched are NaN."""
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
