"""The range of disparities that is searched: those of all depths beyond the least one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vfoa.errors import VfoaError
from vfoa.geometry import disparity_from_depth
from vfoa.types import StereoRig


@dataclass(frozen=True, slots=True, kw_only=True)
class DisparityRange:
    """The disparities ``first_px`` to ``first_px + count - 1``; OpenCV needs a ``count`` that is a multiple of 16."""

    first_px: int
    count: int

    @property
    def reach_px(self) -> int:
        """Greatest distance to the left of a pixel's column at which its match can be."""
        return self.first_px + self.count

    def shrunk(self, factor: int) -> DisparityRange:
        """Return the range in an image with ``factor`` times fewer columns."""
        first, end = self.first_px // factor, -(-self.reach_px // factor)
        return DisparityRange(first_px=first, count=16 * math.ceil((end - first) / 16))


def disparity_range(rig: StereoRig, min_depth_m: float) -> DisparityRange:
    """Return the disparities of all depths between ``min_depth_m`` and infinity on a rig.

    The range goes from 0, or from the disparity of infinity if the principal points differ, to fx B / z - (cx_right -
    cx), rounded up to the next multiple of 16, and never beyond the image's width.

    Raises
    ------
    VfoaError
        If nothing at that depth has a positive disparity.
    """
    first = max(0, math.floor(rig.cx_px - rig.cx_right_px))
    last = min(math.ceil(float(disparity_from_depth(min_depth_m, rig))), rig.width_px - 1)
    if last <= first:
        raise VfoaError(
            f"stereo.min_depth_m: expected a depth with a disparity above {first} px on this rig, "
            f"found {min_depth_m} m, which has {last} px"
        )
    return DisparityRange(first_px=first, count=16 * math.ceil((last - first + 1) / 16))
