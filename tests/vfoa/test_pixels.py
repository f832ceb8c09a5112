"""Pixels of a mask, and their points in space."""

from __future__ import annotations

import numpy as np
import pytest

from tests.scenes import make_rig
from vfoa.geometry import project
from vfoa.pixels import ViewMaps, known_pixels, points_of, window_of
from vfoa.types import Disparity, Instances

RIG = make_rig(64, 48, fx_px=50, cx_right_offset_px=3)


def test_the_points_of_a_mask_are_those_of_its_known_pixels() -> None:
    disparity = np.full((48, 64), np.nan, np.float32)
    disparity[10, 20], disparity[11, 21], disparity[12, 22], disparity[13, 23] = 2.0, 7.0, -4.0, 5.0
    window = slice(8, 20), slice(16, 30)
    mask = np.ones((12, 14), np.bool_)
    mask[13 - 8, 23 - 16] = False
    instances = Instances(ids=np.zeros((48, 64), np.uint16), instances=())
    seen = ViewMaps(disparity=Disparity(disparity_px=disparity), instances=instances, rig=RIG)
    pixels = known_pixels(mask, window, seen)
    np.testing.assert_array_equal(pixels, [[10, 20], [11, 21], [12, 22]])
    points = points_of(pixels, seen)
    np.testing.assert_allclose(points[:, 2], [1.0, 0.5])  # f B / (d + 3)
    np.testing.assert_allclose(project(points, RIG), [[20, 10], [21, 11]], atol=1e-9)


@pytest.mark.parametrize("count", [100, 233, 1000])
def test_fewer_pixels_are_spread_without_a_gap_of_twice_the_usual(count: int) -> None:
    rig = make_rig(500, 200)
    disparity = Disparity(disparity_px=np.ones((200, 500), np.float32))
    seen = ViewMaps(
        disparity=disparity, instances=Instances(ids=np.zeros((200, 500), np.uint16), instances=()), rig=rig
    )
    whole, mask = (slice(0, 200), slice(0, 500)), np.ones((200, 500), np.bool_)
    v, u = known_pixels(mask, whole, seen, most=count).T
    assert len(v) == count
    assert np.diff([0, *(500 * v + u), 100_000]).max() < 2 * 100_000 / count
    np.testing.assert_array_equal(known_pixels(mask, whole, seen, most=100_000), known_pixels(mask, whole, seen))


def test_a_window_is_of_whole_pixels_within_the_image() -> None:
    assert window_of(1.5, 2.0, 4.0, 5.9, RIG) == (slice(2, 6), slice(2, 5))
    assert window_of(-9.0, 40.0, 3.0, 99.0, RIG) == (slice(40, 48), slice(0, 4))
