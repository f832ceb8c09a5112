"""Depth that a sensor measured (a depth camera, or a stereo camera with its own matching), instead of matching."""

from __future__ import annotations

import numpy as np

from vfoa import settings
from vfoa.errors import VfoaError
from vfoa.geometry import disparity_from_depth
from vfoa.types import Disparity, StereoFrame


class SensorDepth:
    """A matcher that returns the measured depth of each frame, as disparities of the frame's rig."""

    class Settings(settings.Settings):
        """There are no settings."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def match(self, frame: StereoFrame) -> Disparity:
        """Convert the measured depth (see :class:`vfoa.stereo.StereoMatcher`); unknown depth stays unknown.

        Raises
        ------
        VfoaError
            If the frame has no measured depth.
        """
        if frame.depth_m is None:
            raise VfoaError(
                'stereo.matcher: found "sensor", but the clip has no measured depth; '
                'expected a matcher of two views, such as stereo.matcher = "sgbm"'
            )
        return Disparity(disparity_px=disparity_from_depth(frame.depth_m, frame.rig).astype(np.float32))
