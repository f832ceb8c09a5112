"""The range of disparities searched: all that are needed, in sixteens, and no sixteen more."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_rig
from vfoa.errors import VfoaError
from vfoa.stereo.block_matching import DisparityRange, disparity_range


@pytest.mark.parametrize(
    ("nearest_px", "offset_px", "first_px", "count"),
    [
        (15, 0, 0, 16),
        (15.5, 0, 0, 32),
        (31, 0, 0, 32),
        (32, 0, 0, 48),
        (20, -5, 5, 16),  # x_right = x_left - d: infinity has 5 px
        (20, 4, -4, 32),  # and here -4
        (-2, 4, -4, 16),
        (10_000, 0, 0, 208),  # the image is 200 px wide: 199 is the greatest
        (198, 0, 0, 208),
        (191, 0, 0, 192),
    ],
)
def test_all_disparities_from_infinity_to_the_nearest_depth_are_searched(nearest_px, offset_px, first_px, count):
    rig = make_rig(200, 100, cx_right_offset_px=offset_px)
    depth_m = rig.fx_px * rig.baseline_m / (nearest_px + offset_px)
    assert disparity_range(rig, depth_m) == DisparityRange(first_px=first_px, count=count)


def test_the_last_column_s_disparity_is_searched_and_none_beyond():
    """At most 192 of an image of 192 columns, not one more."""
    assert disparity_range(make_rig(192, 100), 1e-6).count == 192
    assert disparity_range(make_rig(193, 100), 1e-6).count == 208


@pytest.mark.parametrize("offset_px", [-5, 4])
def test_a_depth_without_a_disparity_is_refused(offset_px):
    rig = make_rig(200, 100, cx_right_offset_px=offset_px)
    with pytest.raises(VfoaError, match=r"stereo\.min_depth_m: .*above (-4|5) px"):
        disparity_range(rig, 1e30)


@given(first=st.integers(-100, 100), sixteens=st.integers(1, 20), factor=st.integers(1, 4))
def test_in_a_smaller_image_the_same_is_searched(first, sixteens, factor):
    whole = DisparityRange(first_px=first, count=16 * sixteens)
    part = whole.shrunk(factor)
    assert part.first_px * factor <= first < (part.first_px + 1) * factor
    assert part.count % 16 == 0
    end, whole_end = part.first_px + part.count, whole.first_px + whole.count
    assert (end - 16) * factor < whole_end <= end * factor
