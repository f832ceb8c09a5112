"""Regions of an image: cut out, made smaller and larger, and put back, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_rig
from vfoa.stereo.cut import cropped, cut, enlarged, gray, in_frame
from vfoa.stereo.region import Region, whole

RIG = make_rig(30, 20)
PIXELS = np.random.default_rng(0).integers(0, 256, (20, 30), dtype=np.uint8)


@given(u0=st.integers(-9, 29), v0=st.integers(-9, 19), width=st.integers(10, 45), height=st.integers(10, 45))
def test_beyond_the_edges_the_last_pixels_are_repeated(u0, v0, width, height):
    padded = np.pad(PIXELS, 80, mode="edge")
    region = Region(u0=u0, v0=v0, u1=u0 + width, v1=v0 + height)
    expected = padded[80 + v0 : 80 + v0 + height, 80 + u0 : 80 + u0 + width]
    np.testing.assert_array_equal(cut(PIXELS, region), expected)


@pytest.mark.parametrize("size", [(20, 30), (19, 29)])
def test_at_half_size_a_pixel_is_the_mean_of_four_and_the_last_ones_are_repeated(size):
    part = PIXELS[: size[0], : size[1]]
    image = np.repeat(part[..., None], 3, axis=2)
    np.testing.assert_array_equal(gray(image, 1), part)
    even = np.pad(part, ((0, size[0] % 2), (0, size[1] % 2)), mode="edge").astype(float)
    means = even.reshape(10, 2, 15, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(gray(image, 2), means, atol=0.5)


def test_an_enlarged_disparity_is_as_many_times_as_great_at_each_of_its_pixels():
    found = np.array([[1, -16], [7, 0]], np.int16)
    assert enlarged(found, 1) is found
    expected = [[2, 2, -32, -32], [2, 2, -32, -32], [14, 14, 0, 0], [14, 14, 0, 0]]
    np.testing.assert_array_equal(enlarged(found, 2), np.array(expected, np.int16))


def test_a_part_of_a_part_is_where_it_was():
    origin, region = Region(u0=3, v0=2, u1=20, v1=15), Region(u0=5, v0=4, u1=12, v1=9)
    np.testing.assert_array_equal(cropped(PIXELS[origin.window], origin, region), PIXELS[4:9, 5:12])


@pytest.mark.parametrize("has_confidence", [True, False])
def test_outside_of_its_region_nothing_is_known(has_confidence):
    region = Region(u0=5, v0=4, u1=12, v1=9)
    found, sure = np.full((5, 7), 3, np.float32), np.full((5, 7), 0.5, np.float32)
    disparity = in_frame(found, sure if has_confidence else None, region, RIG)
    inside = np.zeros((20, 30), bool)
    inside[4:9, 5:12] = True
    np.testing.assert_array_equal(disparity.disparity_px, np.where(inside, np.float32(3), np.float32(np.nan)))
    if has_confidence:
        np.testing.assert_array_equal(disparity.confidence, np.where(inside, np.float32(0.5), np.float32(0)))
    else:
        assert disparity.confidence is None


def test_a_map_of_the_whole_image_is_handed_on_as_it_is():
    found, sure = (np.arange(600, dtype=np.float32).reshape(20, 30) + offset for offset in (1, 2))
    disparity = in_frame(found, sure, Region(u0=0, v0=0, u1=30, v1=20), RIG)
    np.testing.assert_array_equal(disparity.disparity_px, found)
    np.testing.assert_array_equal(disparity.confidence, sure)


def test_a_region_grows_as_far_as_the_image_goes():
    assert Region(u0=5, v0=4, u1=12, v1=9).grown(3, whole(RIG)) == Region(u0=2, v0=1, u1=15, v1=12)
    assert Region(u0=5, v0=4, u1=28, v1=18).grown(6, whole(RIG)) == Region(u0=0, v0=0, u1=30, v1=20)
    empty = Region(u0=5, v0=4, u1=5, v1=9)
    assert empty.grown(3, whole(RIG)) == empty


def test_a_smaller_image_has_every_pixel_that_touches_the_region():
    assert Region(u0=5, v0=4, u1=11, v1=9).shrunk(2) == Region(u0=2, v0=2, u1=6, v1=5)
    assert Region(u0=2, v0=2, u1=6, v1=5).times(2) == Region(u0=4, v0=4, u1=12, v1=10)
    assert Region(u0=6, v0=3, u1=12, v1=9).shrunk(3) == Region(u0=2, v0=1, u1=4, v1=3)


@pytest.mark.parametrize(
    ("region", "is_empty"),
    [((1, 1, 2, 2), False), ((1, 1, 1, 2), True), ((1, 1, 2, 1), True), ((3, 1, 2, 2), True), ((1, 3, 2, 2), True)],
)
def test_a_region_without_a_pixel_is_empty(region, is_empty):
    u0, v0, u1, v1 = region
    assert Region(u0=u0, v0=v0, u1=u1, v1=v1).is_empty is is_empty
