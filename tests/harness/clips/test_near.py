"""The note on objects nearer than a matcher searches."""

from __future__ import annotations

import numpy as np
import pytest

from harness.clips.matching import near_notes
from tests.scenes import make_rig, stereo_planes

NO_WINDOW = (slice(0, 0), slice(0, 0))


@pytest.mark.parametrize("offset_px", [-200, -30, 0, 30, 100])
@pytest.mark.parametrize(("wall_m", "is_near"), [(3.0, False), (0.4, True)])
def test_a_wall_is_near_or_not_whatever_the_principal_points(offset_px: int, wall_m: float, is_near: bool) -> None:
    """z = fx B / (d + cx_right - cx): where the principal points differ, disparities begin below or above 0."""
    rig = make_rig(320, 120, fx_px=300, cx_right_offset_px=offset_px)
    disparity_px = round(300 * 0.1 / wall_m) - offset_px
    frame, _, _ = stereo_planes(rig, far_px=disparity_px, near_px=0, window=NO_WINDOW)
    notes = near_notes([frame])
    assert len(notes) == is_near
    assert all("100% of the matches" in note for note in notes)


def test_a_small_near_object_before_a_far_wall_is_a_small_share() -> None:
    """The wall has negative disparities: without them, the object would be all that is matched."""
    rig = make_rig(320, 240, fx_px=300, cx_right_offset_px=30)
    window = (slice(100, 124), slice(200, 224))
    frame, truth, _ = stereo_planes(rig, far_px=-20, near_px=70, window=window)
    assert np.mean(truth == 70) < 0.01
    assert near_notes([frame]) == []
