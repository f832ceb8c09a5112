"""Guided search: the matches of a full search, where half the resolution bounds them, and the whole range elsewhere."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.examples import few
from tests.scenes import make_rig, stereo_planes
from tests.vfoa.stereo.test_stereo import bandage_2, errors, matcher  # noqa: F401
from vfoa.stereo.cut import gray
from vfoa.stereo.fine_texture import TILE_PX, too_fine_areas
from vfoa.stereo.guided import pays
from vfoa.stereo.region import Region
from vfoa.stereo.search import DisparityRange
from vfoa.types import Image, StereoFrame

RIG = make_rig(256, 128)
NEAR_M = 0.13
"""128 disparities: guiding pays with and without the WLS filter."""


def searched(frame, search, region=None, **settings):
    chosen = matcher("sgbm", search=search, min_depth_m=NEAR_M, **settings)
    return (chosen.match(frame) if region is None else chosen.match_region(frame, region)).disparity_px


def shifted(texture: Image, disparity: int) -> StereoFrame:
    """A wall with a texture (H, W + disparity, 3) at a disparity."""
    width = RIG.width_px
    left, right = texture[:, :width].copy(), texture[:, disparity : width + disparity].copy()
    return StereoFrame(index=1, time_ns=0, left=left, right=right, rig=RIG)


def too_fine_texture(seed: int = 0) -> Image:
    """Blocks of 2 x 2 pixels whose mean is the same everywhere: at half the resolution there is nothing to see."""
    rng = np.random.default_rng(seed)
    signs = rng.choice([-60, 60], (RIG.height_px // 2, RIG.width_px))
    pattern = np.kron(signs, [[1, -1], [-1, 1]]) + 128
    return np.repeat(pattern.astype(np.uint8)[..., None], 3, axis=2)


def blurred_texture(seed: int = 0) -> Image:
    """A random texture that half the resolution shows as well."""
    rng = np.random.default_rng(seed)
    noise = rng.integers(0, 256, (RIG.height_px, RIG.width_px * 2, 3), dtype=np.uint8)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1.5), None, 0, 255, cv2.NORM_MINMAX)


@few
@given(
    far_px=st.integers(1, 8).map(lambda half: 2 * half),
    step_px=st.integers(1, 14).map(lambda half: 2 * half),
    u0=st.integers(40, 120),
    v0=st.integers(0, 60),
)
def test_a_guided_match_is_that_of_the_full_search_wherever_a_step_is(far_px, step_px, u0, v0):
    """Even disparities, which half the resolution bounds exactly. Steps of more and of less than the 16 around it."""
    window = (slice(v0, v0 + 50), slice(u0, u0 + 90))
    frame, truth, _ = stereo_planes(RIG, far_px=far_px, near_px=far_px + step_px, window=window, noise=3)
    full, guided = (searched(frame, search, wls=False) for search in ("full", "guided"))
    both = np.isfinite(full) & np.isfinite(guided)
    assert both.sum() > 0.9 * np.isfinite(full).sum()
    assert (np.abs(full - guided)[both] <= 1 / 4).mean() > 0.96
    assert (np.abs(guided - truth)[np.isfinite(guided)] > 1).mean() < 0.02


@few
@given(disparity=st.integers(2, 47), seed=st.integers(0, 9), wls=st.booleans())
def test_odd_and_near_disparities_are_found_as_by_the_full_search(disparity, seed, wls):
    frame = shifted(blurred_texture(seed), disparity)
    found = {search: searched(frame, search, wls=wls) for search in ("full", "guided")}
    for each in found.values():
        right = np.abs(each[:, disparity:] - disparity) <= 1 / 2
        assert right.mean() > 0.85
    known = [np.isfinite(each).mean() for each in found.values()]
    assert known[1] > known[0] - 0.1


def test_a_slanted_wall_is_as_exact_as_by_the_full_search():
    """The bound is smooth along the slant: with steps, the error between pixels would be twice as large."""
    texture = blurred_texture()
    width = RIG.width_px
    columns = np.tile(np.arange(width, dtype=np.float32), (RIG.height_px, 1))
    rows = np.repeat(np.arange(RIG.height_px, dtype=np.float32)[:, None], width, axis=1)
    truth = 20 + 0.08 * columns
    right = np.ascontiguousarray(texture[:, :width])
    left = cv2.remap(right, columns - truth, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    frame = StereoFrame(index=1, time_ns=0, left=left, right=right, rig=RIG)
    error = {search: np.abs(searched(frame, search) - truth) for search in ("full", "guided")}
    assert np.nanmedian(error["guided"]) <= np.nanmedian(error["full"]) + 0.03
    assert np.nanmean(error["guided"] > 1) <= np.nanmean(error["full"] > 1) + 0.01
    assert np.isfinite(error["guided"]).mean() > np.isfinite(error["full"]).mean() - 0.1


@pytest.mark.parametrize("wls", [True, False])
@pytest.mark.parametrize("disparity", [9, 17])
def test_texture_that_half_the_resolution_loses_is_matched_as_by_the_full_search(disparity, wls):
    frame = shifted(too_fine_texture(), disparity)
    full, guided = (searched(frame, search, wls=wls) for search in ("full", "guided"))
    assert (np.abs(full - disparity) < 0.5)[:, disparity:].mean() > 0.9
    np.testing.assert_array_equal(guided, full)


@pytest.mark.parametrize("wls", [True, False])
def test_a_part_with_texture_that_is_too_fine_is_found_amid_the_rest(wls):
    disparity = 12
    texture = blurred_texture()
    patch = (slice(32, 96), slice(96, 192))
    texture[patch] = too_fine_texture()[patch]
    frame = shifted(texture, disparity)
    guided = searched(frame, "guided", wls=wls)
    tile = (slice(36, 92), slice(100, 188))
    assert (np.abs(guided - disparity) <= 0.25)[tile].mean() > 0.9
    full = searched(frame, "full", wls=wls)
    assert (np.abs(full - guided) <= 0.25)[tile].mean() > 0.9


@pytest.mark.parametrize("wls", [True, False])
def test_the_pixels_that_the_right_camera_does_not_see_stay_unknown(wls):
    frame, _, visible = stereo_planes(RIG, far_px=8, near_px=40, window=(slice(30, 90), slice(100, 200)), noise=3)
    guided = searched(frame, "guided", wls=wls)
    hidden = ~visible
    hidden[:, :8] = False
    assert np.isfinite(guided)[hidden].mean() < 0.4
    assert (np.arange(RIG.width_px) - guided)[np.isfinite(guided)].min() >= 0
    assert np.isfinite(guided)[visible].mean() > 0.75


@pytest.mark.parametrize("wls", [True, False])
def test_a_pattern_that_repeats_has_no_unique_match(wls):
    """Vertical stripes of 8 px: many disparities match alike, at half the resolution too, up to the last pixel."""
    stripes = 128 + 60 * np.sin(np.arange(RIG.width_px + 8) * 2 * np.pi / 8)
    texture = np.broadcast_to(stripes.astype(np.uint8)[:, None], (RIG.height_px, RIG.width_px + 8, 3))
    assert np.isnan(searched(shifted(texture, 8), "guided", wls=wls)).mean() > 0.95


def test_flat_pairs_have_no_disparity():
    flat = np.full((RIG.height_px, RIG.width_px, 3), 90, np.uint8)
    frame = StereoFrame(index=1, time_ns=0, left=flat, right=flat, rig=RIG)
    assert np.isnan(searched(frame, "guided", wls=False)).all()
    assert np.isnan(searched(frame, "guided", wls=True)).all()


@pytest.mark.parametrize(("wls", "longest"), [(False, 64), (True, 16)])
def test_a_range_is_searched_in_full_where_guiding_costs_more(wls, longest):
    counts = range(16, 321, 16)
    full = [count for count in counts if not pays(DisparityRange(first_px=0, count=count), filtered=wls)]
    assert full == list(range(16, longest + 1, 16))


@pytest.mark.parametrize(("near_m", "is_full"), [(0.3, True), (NEAR_M, False)])
def test_a_short_range_has_the_disparities_of_the_full_search_bit_for_bit(near_m, is_full):
    frame, _, _ = stereo_planes(RIG, far_px=8, near_px=30, window=(slice(30, 90), slice(80, 180)), noise=3)
    found = [matcher("sgbm", search=each, min_depth_m=near_m, wls=False).match(frame) for each in ("full", "guided")]
    assert np.array_equal(*(each.disparity_px for each in found), equal_nan=True) == is_full


def test_another_rig_decides_anew_whether_guiding_pays():
    chosen = matcher("sgbm", search="guided", min_depth_m=NEAR_M, wls=False)
    long = shifted(blurred_texture(), 12)
    rig = make_rig(256, 128, fx_px=60)
    short = replace(long, rig=rig)
    chosen.match(long)
    full = matcher("sgbm", min_depth_m=NEAR_M, wls=False).match(short)
    np.testing.assert_array_equal(chosen.match(short).disparity_px, full.disparity_px)


def test_a_wall_has_no_seam():
    """An odd disparity is between two of the coarse map. No row or column of the wall is off from its neighbours."""
    frame = shifted(blurred_texture(), 21)
    found = searched(frame, "guided")[8:-8, 40:-24]
    for axis in (0, 1):
        of_lines = np.nanmedian(found, axis=axis)
        assert np.abs(np.diff(of_lines)).max() <= 1 / 8
        assert np.abs(of_lines - 21).max() <= 1 / 4


@few
@given(u0=st.integers(0, 120), v0=st.integers(0, 60), width=st.integers(30, 130), height=st.integers(20, 60))
def test_a_region_is_nearly_that_of_the_whole_frame(u0, v0, width, height):
    frame, _, _ = stereo_planes(RIG, far_px=8, near_px=30, window=(slice(30, 90), slice(80, 180)), noise=3)
    region = Region(u0=u0, v0=v0, u1=u0 + width, v1=v0 + height)
    whole, part = (searched(frame, "guided", each)[region.window] for each in (None, region))
    assert (np.isfinite(whole) == np.isfinite(part)).mean() > 0.85
    both = np.isfinite(whole) & np.isfinite(part)
    assert (np.abs(whole - part)[both] <= 0.25).mean() > 0.9


def test_areas_are_too_fine_where_half_the_resolution_loses_the_texture_and_few_pixels_are_sure():
    width = RIG.width_px
    image = gray(np.ascontiguousarray(blurred_texture()[:, :width]), 1)
    fine = gray(too_fine_texture(), 1)[:, :width]
    image[TILE_PX : 2 * TILE_PX, 3 * TILE_PX : 5 * TILE_PX] = fine[TILE_PX : 2 * TILE_PX, 3 * TILE_PX : 5 * TILE_PX]
    image[3 * TILE_PX :, 7 * TILE_PX :] = fine[3 * TILE_PX :, 7 * TILE_PX :]
    sure = np.zeros(image.shape, np.bool_)
    expected = [
        Region(u0=3 * TILE_PX, v0=TILE_PX, u1=5 * TILE_PX, v1=2 * TILE_PX),
        Region(u0=7 * TILE_PX, v0=3 * TILE_PX, u1=8 * TILE_PX, v1=4 * TILE_PX),
    ]
    assert too_fine_areas(image, sure) == expected
    sure[: 2 * TILE_PX] = True
    assert too_fine_areas(image, sure) == expected[1:]
    assert too_fine_areas(image, np.ones_like(sure)) == []


def test_half_the_resolution_is_refused():
    with pytest.raises(ValidationError, match="guided"):
        matcher("sgbm", search="guided", resolution="half")
    with pytest.raises(ValidationError):
        matcher("bm", search="guided")


def test_on_bandage_2_the_error_is_that_of_the_full_search(bandage_2):  # noqa: F811
    found = {search: np.abs(errors(matcher("sgbm", search=search), bandage_2)) for search in ("full", "guided")}
    known = {search: each[np.isfinite(each)] for search, each in found.items()}
    assert np.median(known["guided"]) <= np.median(known["full"]) + 0.02
    assert (known["guided"] > 2).mean() <= (known["full"] > 2).mean() + 0.005
    assert len(known["guided"]) > 0.92 * len(known["full"])
