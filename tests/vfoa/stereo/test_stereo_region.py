"""Matching at half resolution, in a region, and with several threads: the same disparities for less."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.examples import few
from tests.scenes import make_box, make_rig, rendered_boxes, stereo_planes
from tests.vfoa.stereo.test_stereo import matcher
from vfoa.stereo.region import Region, needed_region, whole
from vfoa.types import Head, Instance, Instances

RIG, ODD_RIG = make_rig(240, 120), make_rig(241, 121)
WINDOW = (slice(30, 90), slice(80, 180))
FRAME, TRUTH, VISIBLE = stereo_planes(RIG, far_px=8, near_px=24, window=WINDOW, noise=3)
ODD_FRAME, _, _ = stereo_planes(ODD_RIG, far_px=8, near_px=24, window=WINDOW, noise=3)
CROSSING_FRAME, _, _ = stereo_planes(
    make_rig(240, 120, cx_right_offset_px=12), far_px=-8, near_px=10, window=WINDOW, noise=3
)
CONFIGURATIONS = [("bm", True), ("bm", False), ("sgbm", True), ("sgbm", False)]
NEAR_M = 0.5


def found(name: str, frame=FRAME, region: Region | None = None, **options):
    chosen = matcher(name, **{"min_depth_m": NEAR_M, **options})
    return chosen.match(frame) if region is None else chosen.match_region(frame, region)


# Half resolution


@pytest.mark.parametrize(("name", "wls"), CONFIGURATIONS)
@pytest.mark.parametrize(("width", "height"), [(240, 120), (241, 121)])
def test_at_half_resolution_planes_have_their_disparity_at_every_pixel_of_the_full_size(name, wls, width, height):
    rig = make_rig(width, height)
    frame, truth, visible = stereo_planes(rig, far_px=8, near_px=24, window=WINDOW, noise=3)
    disparity = found(name, frame, wls=wls, resolution="half").disparity_px
    far_from_edges = np.ones((33, 33), np.uint8)
    core = (cv2.erode(np.where(visible, truth, 0), far_from_edges) == cv2.dilate(truth, far_from_edges)) & visible
    assert disparity.shape == (height, width)
    assert np.isfinite(disparity[core]).mean() > 0.85
    assert np.nanmedian(np.abs(disparity - truth)[core]) <= 1 / 8
    assert np.nanmean(np.abs(disparity - truth)[core] > 1) < 0.05


@pytest.mark.parametrize("name", ["bm", "sgbm"])
def test_at_half_resolution_a_match_stands_for_its_four_pixels_in_eighths(name):
    known = found(name, wls=False, resolution="half").disparity_px.reshape(60, 2, 120, 2).swapaxes(1, 2).reshape(-1, 4)
    known = known[np.isfinite(known).all(axis=1)]
    assert len(known) > 1000
    assert (known == known[:, :1]).all()
    np.testing.assert_array_equal(known * 8, np.round(known * 8))


@pytest.mark.parametrize("name", ["bm", "sgbm"])
def test_at_half_resolution_known_pixels_are_seen_by_both_cameras_with_confidence(name):
    disparity = found(name, resolution="half")
    known = np.isfinite(disparity.disparity_px)
    assert (np.arange(RIG.width_px) - disparity.disparity_px)[known].min() >= 0
    assert disparity.disparity_px[known].min() > 0
    assert disparity.confidence.shape == TRUTH.shape
    assert disparity.confidence[known].min() >= 0.5


@pytest.mark.parametrize("offset_px", [-6, 4])
def test_at_half_resolution_separate_principal_points_shift_the_search(offset_px):
    rig = make_rig(240, 120, cx_right_offset_px=offset_px)
    frame, truth, visible = stereo_planes(rig, far_px=8, near_px=24, window=WINDOW)
    nearest = float(160 * 0.1 / (24 + offset_px))
    disparity = matcher("sgbm", min_depth_m=nearest, resolution="half").match(frame).disparity_px
    assert (np.abs(disparity - truth)[visible] < 0.5).mean() > 0.7


# Regions


@st.composite
def regions(draw: st.DrawFn) -> Region:
    u0, v0 = draw(st.integers(0, 230)), draw(st.integers(0, 110))
    return Region(u0=u0, v0=v0, u1=draw(st.integers(u0 + 1, 240)), v1=draw(st.integers(v0 + 1, 120)))


@given(
    region=regions(),
    frame=st.sampled_from([FRAME, ODD_FRAME, CROSSING_FRAME]),
    resolution=st.sampled_from(["full", "half"]),
)
@example(region=Region(u0=0, v0=42, u1=37, v1=119), frame=FRAME, resolution="half")  # an odd number of rows
def test_a_block_match_in_a_region_is_that_of_the_whole_frame(region, frame, resolution):
    """Without what looks beyond a block: speckles, the way back from the right view, the filter."""
    alone = {"wls": False, "speckle_size_px": 0, "left_right_px": 1000, "resolution": resolution}
    expected = found("bm", frame, **alone).disparity_px
    disparity = found("bm", frame, region, region_margin_px=20, **alone).disparity_px
    np.testing.assert_array_equal(disparity[region.window], expected[region.window])
    beyond = np.ones(expected.shape, np.bool_)
    beyond[region.grown(20, whole(frame.rig)).window] = False
    assert np.isnan(disparity[beyond]).all()


@few
@given(u0=st.integers(0, 140), v0=st.integers(0, 60), resolution=st.sampled_from(["full", "half"]))
@pytest.mark.parametrize("name", ["bm", "sgbm"])
def test_a_filtered_match_in_a_region_is_nearly_that_of_the_whole_frame(name, u0, v0, resolution):
    region = Region(u0=u0, v0=v0, u1=u0 + 100, v1=v0 + 60)
    whole, part = (found(name, region=each, resolution=resolution).disparity_px for each in (None, region))
    whole, part = whole[region.window], part[region.window]
    assert (np.isfinite(whole) == np.isfinite(part)).mean() > 0.85
    both = np.isfinite(whole) & np.isfinite(part)
    assert (np.abs(whole - part)[both] <= 0.25).mean() > 0.9


@pytest.mark.parametrize(("name", "wls"), CONFIGURATIONS)
@pytest.mark.parametrize("resolution", ["full", "half"])
def test_the_region_of_the_whole_image_is_the_whole_image(name, wls, resolution):
    everything = Region(u0=0, v0=0, u1=240, v1=120)
    whole, part = (found(name, region=each, wls=wls, resolution=resolution) for each in (None, everything))
    np.testing.assert_array_equal(whole.disparity_px, part.disparity_px)
    if wls:
        np.testing.assert_array_equal(whole.confidence, part.confidence)


def test_nothing_is_known_of_an_empty_region():
    disparity = found("sgbm", region=Region(u0=0, v0=0, u1=0, v1=0))
    assert disparity.disparity_px.shape == TRUTH.shape
    assert np.isnan(disparity.disparity_px).all()


def test_the_needed_region_holds_all_things_and_heads_and_nothing_more():
    percepts = rendered_boxes(RIG, [make_box((-0.3, 0.1, 2.0), 0.1), make_box((0.5, -0.1, 2.5), 0.15)])
    head = Head(box_px=np.array([3.5, 10.0, 20.0, 40.2]), score=1.0)
    region = needed_region(percepts.instances, [head], RIG)
    rows, columns = np.nonzero(percepts.instances.ids)
    assert (region.u0, region.v0) == (4, 10)
    assert (region.u1, region.v1) == (columns.max() + 1, max(rows.max(), 40) + 1)
    stuff = Instances(
        ids=percepts.instances.ids,
        instances=tuple(
            Instance(id=instance.id, label="sky", category_id=1, is_thing=False, score=1.0)
            for instance in percepts.instances.instances
        ),
    )
    assert needed_region(stuff, [], RIG).is_empty
    assert needed_region(stuff, [head], RIG) == Region(u0=4, v0=10, u1=21, v1=41)
    for beyond in (
        (-50, -50, -10, -10),
        (100, -50, 120, -10),
        (-50, 40, -10, 60),
        (100, 130, 120, 150),
        (250, 40, 260, 60),
    ):
        outside = Head(box_px=np.array(beyond, dtype=np.float64), score=1.0)
        assert needed_region(stuff, [outside], RIG).is_empty
        assert needed_region(stuff, [head, outside], RIG) == Region(u0=4, v0=10, u1=21, v1=41)


# Threads


@pytest.fixture
def threads_restored() -> Iterator[None]:
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


@pytest.mark.usefixtures("threads_restored")
@pytest.mark.parametrize("resolution", ["full", "half"])
@pytest.mark.parametrize("name", ["bm", "sgbm"])
def test_several_threads_find_the_same(name, resolution):
    maps = []
    for threads in (1, 2, 4):
        cv2.setNumThreads(threads)
        maps.append(found(name, resolution=resolution))
    for other in maps[1:]:
        np.testing.assert_array_equal(other.disparity_px, maps[0].disparity_px)
        np.testing.assert_array_equal(other.confidence, maps[0].confidence)


# Real frames


def test_half_resolution_costs_less_than_a_third_of_a_pixel_on_bandage_2(shared_data):
    from tests.vfoa.stereo.test_stereo import errors, sintel
    from vfoa.types import StereoFrame

    rig = make_rig(1024, 436, fx_px=896, baseline_m=0.1)
    left, right = (sintel(shared_data, kind, 25) for kind in ("clean_left", "clean_right"))
    coded = sintel(shared_data, "disparities", 25).astype(np.float32)
    pairs = [
        (StereoFrame(index=25, time_ns=0, left=left, right=right, rig=rig), 4 * coded[..., 0] + coded[..., 1] / 64)
    ]
    full, half = (np.nanmedian(np.abs(errors(matcher("sgbm", resolution=each), pairs))) for each in ("full", "half"))
    assert half <= full + 0.3
