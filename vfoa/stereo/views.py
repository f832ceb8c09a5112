"""The two views that a matcher compares."""

from __future__ import annotations

from vfoa.errors import VfoaError
from vfoa.types import Image, StereoFrame


def both_views(frame: StereoFrame) -> tuple[Image, Image]:
    """The left and the right image (H, W, 3) of a frame.

    Raises
    ------
    VfoaError
        If the frame has no right image.
    """
    if frame.right is None:
        raise VfoaError(
            "stereo.matcher: found a matcher of two views, but the clip has no right images; "
            'expected stereo.matcher = "sensor", which uses the measured depth'
        )
    return frame.left, frame.right
