"""Block matching and semi-global matching, on planes of known disparity and on real frames."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError

from tests.scenes import make_rig, stereo_planes
from vfoa.geometry import depth_from_disparity, disparity_from_depth
from vfoa.stereo import MATCHERS
from vfoa.stereo.block_matching import SGBM_MODES, DisparityRange, PairMatcher, disparity_range
from vfoa.types import StereoFrame

RIG = make_rig(240, 120)
PLATE = (slice(30, 90), slice(80, 180))
CONFIGURATIONS = [
    ("bm", {}),
    ("bm", {"wls": False}),
    ("bm", {"wls": False, "block_size_px": 23}),
    ("bm", {"wls": False, "pre_filter_cap": 32}),
    *[("sgbm", {"mode": mode, "wls": wls}) for mode in SGBM_MODES for wls in (True, False)],
]


def matcher(name, **settings):
    plugin = MATCHERS.load(name)
    return plugin(plugin.Settings(**settings))


@pytest.fixture(scope="module")
def planes():
    return stereo_planes(RIG, far_px=8, near_px=24, window=PLATE, noise=3)


@pytest.mark.parametrize(("name", "settings"), CONFIGURATIONS)
def test_planes_have_their_disparity(planes, name, settings):
    frame, truth, visible = planes
    found = matcher(name, **settings).match(frame).disparity_px
    error = np.abs(found - truth)
    neighbourhood = np.ones((17, 17), np.uint8)
    core = (cv2.erode(np.where(visible, truth, 0), neighbourhood) == cv2.dilate(truth, neighbourhood)) & visible
    assert np.isfinite(found[core]).mean() > 0.9
    assert np.nanmedian(error) <= 1 / 16
    assert np.nanmean(error[core] > 1) < 0.05


@pytest.mark.parametrize(("name", "settings"), CONFIGURATIONS)
def test_every_known_pixel_is_seen_by_both_cameras_at_a_depth(planes, name, settings):
    frame, _, _ = planes
    found = matcher(name, **settings).match(frame).disparity_px
    known = np.isfinite(found)
    column_right = np.arange(RIG.width_px) - found
    assert found.dtype == np.float32
    assert (found[known] > 0).all()
    assert (column_right[known] >= 0).all()


@pytest.mark.parametrize(("name", "settings"), CONFIGURATIONS)
def test_no_band_is_blind(name, settings):
    frame, truth, visible = stereo_planes(RIG, far_px=8, near_px=12, window=(slice(40, 80), slice(12, 60)))
    found = matcher(name, min_depth_m=0.3, **settings).match(frame).disparity_px
    right = np.abs(found - truth) < 1
    for columns in (slice(12, 30), slice(RIG.width_px - 20, RIG.width_px)):
        assert right[:, columns][visible[:, columns]].mean() > 0.75


@pytest.mark.parametrize(("name", "settings"), CONFIGURATIONS)
def test_what_is_behind_the_plate_for_the_right_camera_is_mostly_unknown(planes, name, settings):
    frame, _, visible = planes
    known = np.isfinite(matcher(name, **settings).match(frame).disparity_px)
    hidden = ~visible
    hidden[:, :8] = False
    assert known[hidden].mean() < 0.6 < known[visible].mean()


@pytest.mark.parametrize("name", ["bm", "sgbm"])
def test_a_surface_without_texture_is_unknown_without_wls(name):
    frame, _, _ = stereo_planes(RIG, far_px=8, near_px=24, window=PLATE)
    for image in (frame.left, frame.right):
        image.flags.writeable = True
        image[:] = 128
    assert np.isnan(matcher(name, wls=False).match(frame).disparity_px).all()


COMMON = {"uniqueness_percent": 7, "left_right_px": 3, "speckle_size_px": 40, "speckle_range_px": 5}


@pytest.mark.parametrize(
    ("name", "settings", "expected"),
    [
        ("bm", {"texture_threshold": 9}, {"TextureThreshold": 9, "SpeckleRange": 5 * 16}),
        (
            "sgbm",
            {"mode": "hh", "p1": 6, "p2": 20},
            {"Mode": cv2.STEREO_SGBM_MODE_HH, "P1": 6 * 81, "P2": 20 * 81, "SpeckleRange": 5},
        ),
    ],
)
def test_every_setting_reaches_opencv(name, settings, expected):
    found = matcher(name, wls=False, block_size_px=9, pre_filter_cap=20, **COMMON, **settings)._create(
        DisparityRange(first_px=3, count=32)
    )
    expected |= {"BlockSize": 9, "PreFilterCap": 20, "MinDisparity": 3, "NumDisparities": 32}
    expected |= {"UniquenessRatio": 7, "Disp12MaxDiff": 3, "SpeckleWindowSize": 40}
    assert {what: getattr(found, f"get{what}")() for what in expected} == expected


@pytest.mark.parametrize(
    ("name", "settings"),
    [("bm", {}), ("bm", {"block_size_px": 23}), ("bm", {"pre_filter_cap": 32}), ("sgbm", {})],
)
def test_a_slanted_surface_is_no_speckle(name, settings):
    """Its neighbours differ by a sixth of a pixel, and by more than one pixel within any region of 400."""
    frame, truth = _slanted(slope=1 / 6)
    every = {"wls": False, "uniqueness_percent": 0, "speckle_size_px": 400, "speckle_range_px": 1}
    found = matcher(name, **every, **settings).match(frame).disparity_px
    inner = (slice(20, -20), slice(80, -20))
    assert (np.abs(found - truth)[inner] < 1).mean() > 0.8


def _slanted(slope):
    """A surface with texture whose disparity grows by ``slope`` px along columns and rows, and its disparity."""
    rows, columns = np.indices((RIG.height_px, RIG.width_px), dtype=np.float32)
    disparity = 4 + slope * (columns + rows)
    texture = cv2.GaussianBlur(
        np.random.default_rng(1).uniform(0, 255, disparity.shape).astype(np.float32), (0, 0), 1.2
    )
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    of_right = cv2.remap(texture, (columns + 4 + slope * rows) / (1 - slope), rows, cv2.INTER_LINEAR)
    left, right = (np.repeat(view[..., None], 3, axis=2).astype(np.uint8) for view in (texture, of_right))
    return StereoFrame(index=0, time_ns=0, left=left, right=right, rig=RIG), disparity


@pytest.mark.parametrize("settings", [{}, {"block_size_px": 23}, {"pre_filter_cap": 32}])
def test_known_matches_are_those_of_the_right_view_too(settings):
    """Which is, mirrored, the left view of the mirrored pair."""
    frame, _, _ = stereo_planes(RIG, far_px=8, near_px=24, window=PLATE, noise=40)
    mirrored = replace(frame, left=frame.right[:, ::-1].copy(), right=frame.left[:, ::-1].copy())
    all_kept = {"wls": False, "uniqueness_percent": 0, "texture_threshold": 0, "speckle_size_px": 0, **settings}
    of_right = matcher("bm", **{**all_kept, "left_right_px": 1000}).match(mirrored).disparity_px[:, ::-1]
    found = matcher("bm", **all_kept).match(frame).disparity_px
    rows, columns = np.nonzero(np.isfinite(found))
    difference = found[rows, columns] - of_right[rows, columns - np.rint(found[rows, columns]).astype(int)]
    assert (np.abs(difference) <= 1.5).mean() > 0.99
    assert 0.5 < np.isfinite(found).mean() < np.isfinite(of_right).mean()


@given(
    disparities=arrays(np.int16, (2, 3, 12), elements=st.integers(-6 * 16, 6 * 16)),
    most_px=st.integers(0, 3),
)
def test_a_disparity_is_kept_if_the_right_view_leads_back_to_it(disparities, most_px):
    searched = DisparityRange(first_px=-2, count=16)
    of_left, of_right = np.maximum(disparities[0], searched.unknown), -disparities[1]
    found = PairMatcher(left_matcher=None, right_matcher=None, searched=searched, block_size_px=23).agreeing(
        of_left, of_right, most_px
    )
    for (row, column), sixteenths in np.ndenumerate(of_left):
        there = column - math.floor(sixteenths / 16 + 0.5)
        back = math.floor(of_right[row, there] / 16 + 0.5) if 0 <= there < 12 else math.inf
        agrees = abs(column - there + back) <= most_px
        assert found[row, column] == (sixteenths if agrees else searched.unknown)


def test_a_pixel_without_a_match_in_the_right_view_agrees_with_none():
    searched = DisparityRange(first_px=0, count=16)
    pair = PairMatcher(left_matcher=None, right_matcher=None, searched=searched, block_size_px=23)
    of_left = np.full((1, 40), 15 * 16, np.int16)
    assert (pair.agreeing(of_left, -of_left, 1)[0, 15:] == 15 * 16).all()
    unmatched = np.full_like(of_left, searched.of_right_view.unknown)
    assert (pair.agreeing(of_left, unmatched, 1) == searched.unknown).all()


@pytest.mark.parametrize("mode", SGBM_MODES)
@pytest.mark.parametrize(("p2", "block_size_px"), [(655, 5), (135, 11), (16384, 1)])
def test_the_greatest_penalty_is_matched_with(planes, mode, p2, block_size_px):
    frame, truth, visible = planes
    found = matcher("sgbm", wls=False, mode=mode, p2=p2, block_size_px=block_size_px).match(frame).disparity_px
    assert (np.abs(found - truth)[visible] < 1).mean() > 0.7


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        *[("sgbm", {"uniqueness_percent": 99, "mode": mode}) for mode in SGBM_MODES],
        ("bm", {"uniqueness_percent": 99, "left_right_px": 100_000, "speckle_size_px": 100_000_000}),
        ("bm", {"speckle_range_px": 100_000, "texture_threshold": 100_000_000}),
    ],
)
def test_the_greatest_limits_end_no_process(planes, name, settings):
    """At a uniqueness of 100 %, OpenCV's semi-global matcher divided by 0, which ended the program."""
    frame, _, _ = planes
    assert matcher(name, wls=False, **settings).match(frame).disparity_px.shape == (RIG.height_px, RIG.width_px)


@pytest.mark.parametrize("name", ["bm", "sgbm"])
def test_both_views_are_matched_alike(planes, name):
    frame, _, _ = planes
    ours = matcher(name, block_size_px=9, pre_filter_cap=20)
    ours.match(frame)
    right = ours._pair.right_matcher
    assert {"PreFilterCap": right.getPreFilterCap(), "BlockSize": right.getBlockSize()} == {
        "PreFilterCap": 20,
        "BlockSize": 9,
    }
    searched = ours._pair.searched
    assert right.getMinDisparity() == -(searched.first_px + searched.count - 1)
    assert right.getNumDisparities() == searched.count


@pytest.mark.parametrize("name", ["bm", "sgbm"])
def test_for_the_filter_every_match_is_kept(name):
    """It weighs matches by itself, and takes those that were found again from the right view for sure ones."""
    found = matcher(name, wls=True, **COMMON)._create(DisparityRange(first_px=0, count=16))
    # none is refused for what the right view says: a limit below 0, or one that no disparity exceeds
    assert found.getUniquenessRatio() == 0
    assert not 0 <= found.getDisp12MaxDiff() < 16
    assert found.getSpeckleWindowSize() == 0
    if name == "bm":
        assert found.getTextureThreshold() == 0


def test_confidence_decides_what_is_known(planes):
    frame, _, _ = planes
    found = {limit: matcher("sgbm", min_confidence=limit).match(frame) for limit in (0.0, 0.5, 1.0)}
    for limit, disparity in found.items():
        confidence = disparity.confidence
        assert 0 <= confidence.min() <= confidence.max() <= 1
        assert (confidence[np.isfinite(disparity.disparity_px)] >= limit).all()
    assert found[0.0].known_share > found[0.5].known_share > found[1.0].known_share
    assert matcher("sgbm", wls=False).match(frame).confidence is None


@pytest.mark.parametrize("offset_px", [-6, 4])
def test_separate_principal_points_shift_the_search(offset_px):
    rig = make_rig(240, 120, cx_right_offset_px=offset_px)
    frame, truth, visible = stereo_planes(rig, far_px=8, near_px=24, window=PLATE)
    found = matcher("sgbm", min_depth_m=float(160 * 0.1 / (24 + offset_px))).match(frame).disparity_px
    assert (np.abs(found - truth)[visible] < 0.5).mean() > 0.85


@pytest.mark.parametrize("resolution", ["full", "half"])
@pytest.mark.parametrize(("name", "settings"), CONFIGURATIONS)
def test_what_is_behind_the_crossing_of_the_axes_has_its_disparity(name, settings, resolution):
    """It is negative: the match is to the right, up to 12 pixels for infinity."""
    rig = make_rig(240, 120, cx_right_offset_px=12)
    frame, truth, visible = stereo_planes(rig, far_px=-8, near_px=10, window=PLATE)
    found = matcher(name, min_depth_m=160 * 0.1 / (10 + 12), resolution=resolution, **settings).match(frame)
    known = np.isfinite(found.disparity_px)
    assert (np.abs(found.disparity_px - truth)[visible] < 0.5).mean() > 0.7
    assert np.isfinite(depth_from_disparity(found.disparity_px, rig))[known].all()
    columns_right = (np.arange(rig.width_px) - found.disparity_px)[known]
    assert 0 <= columns_right.min() <= columns_right.max() <= rig.width_px - 1


@pytest.mark.parametrize(("name", "settings"), CONFIGURATIONS)
def test_the_same_pair_gives_the_same_map_also_after_other_rigs_and_in_a_copy(planes, name, settings):
    frame, _, _ = planes
    first = matcher(name, **settings)
    expected = first.match(frame).disparity_px
    other, _, _ = stereo_planes(make_rig(200, 100), far_px=4, near_px=9, window=(slice(20, 60), slice(50, 120)))
    first.match(other)
    copy = pickle.loads(pickle.dumps(first))
    for again in (first, copy):
        np.testing.assert_array_equal(again.match(frame).disparity_px, expected)


# Range


@given(
    min_depth_m=st.floats(0.1, 20),
    fx_px=st.floats(100, 2000),
    baseline_m=st.floats(0.02, 0.5),
    offset_px=st.floats(-40, 40),
    depth_scale=st.floats(1, 100),
)
def test_the_range_holds_every_depth_from_the_nearest_on(min_depth_m, fx_px, baseline_m, offset_px, depth_scale):
    rig = make_rig(640, 480, fx_px=fx_px, baseline_m=baseline_m, cx_right_offset_px=offset_px)
    nearest = float(disparity_from_depth(min_depth_m, rig))
    assume(nearest > 1)
    found = disparity_range(rig, min_depth_m)
    disparity = float(disparity_from_depth(min_depth_m * depth_scale, rig))
    assert found.count % 16 == 0
    if abs(disparity) < rig.width_px - 1:
        assert found.first_px <= disparity <= found.first_px + found.count - 1
    assert found.count < min(nearest, rig.width_px) - found.first_px + 18


def test_the_range_reaches_the_dragon_of_bandage_2():
    rig = make_rig(1024, 436, fx_px=896, baseline_m=0.1)
    assert disparity_range(rig, 0.45).count == 208


# Settings


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("bm", {"block_size_px": 14}),
        ("bm", {"block_size_px": 3}),
        ("sgbm", {"block_size_px": 4}),
        ("sgbm", {"block_size_px": 13}),
        ("sgbm", {"p1": 32, "p2": 32}),
        ("sgbm", {"p2": 656}),
        ("sgbm", {"p2": 136, "block_size_px": 11}),
        ("sgbm", {"uniqueness_percent": 100}),
        ("bm", {"left_right_px": 2**31}),
        ("bm", {"speckle_range_px": 2**27}),
        ("sgbm", {"mode": "4way"}),
        ("bm", {"mode": "3way"}),
        ("sgbm", {"min_depth_m": 0}),
        ("sgbm", {"min_confidence": 1.1}),
    ],
)
def test_impossible_settings_are_refused(name, settings):
    with pytest.raises(ValidationError):
        matcher(name, **settings)


# Real frames


def sintel(folder, kind, frame):
    path = folder / "sintel" / "training" / kind / "bandage_2" / f"frame_{frame:04d}.png"
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


@pytest.fixture(scope="module")
def bandage_2(shared_data):
    rig = make_rig(1024, 436, fx_px=896, baseline_m=0.1)
    pairs = []
    for number in (1, 25, 50):
        coded = sintel(shared_data, "disparities", number).astype(np.float32)
        left, right = (sintel(shared_data, kind, number) for kind in ("clean_left", "clean_right"))
        truth = 4 * coded[..., 0] + coded[..., 1] / 64
        pairs.append((StereoFrame(index=number, time_ns=0, left=left, right=right, rig=rig), truth))
    return pairs


def errors(matcher, pairs):
    return np.stack([matcher.match(frame).disparity_px - truth for frame, truth in pairs])


@pytest.mark.parametrize("wls", [True, False])
def test_semi_global_matching_sees_more_of_bandage_2_than_block_matching(bandage_2, wls):
    """The share of all pixels that are known and right to two pixels."""
    right = {name: (np.abs(errors(matcher(name, wls=wls), bandage_2)) < 2).mean() for name in ("bm", "sgbm")}
    assert right["sgbm"] > right["bm"] + 0.05


def test_semi_global_matching_with_wls_is_right_to_half_a_pixel_on_bandage_2(bandage_2):
    assert np.nanmedian(np.abs(errors(matcher("sgbm"), bandage_2))) < 0.5


_ASKS_FOR_TWELVE_GB = """
import resource
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
import numpy as np
from tests.scenes import make_rig
from vfoa.errors import VfoaError
from vfoa.stereo.block_matching import SemiGlobalMatcher
from vfoa.types import StereoFrame

image = np.zeros((1500, 2000, 3), np.uint8)
rig = make_rig(width_px=2000, height_px=1500, fx_px=5000.0, baseline_m=0.1)
matcher = SemiGlobalMatcher(SemiGlobalMatcher.Settings(mode="hh", min_depth_m=0.5))
try:
    matcher.match(StereoFrame(index=7, time_ns=0, left=image, right=image, rig=rig))
except VfoaError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="has no limit on a process's memory")
def test_a_pair_too_large_for_the_memory_says_what_takes_less() -> None:
    command = [sys.executable, "-c", _ASKS_FOR_TWELVE_GB]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[3])
    assert done.stdout.startswith("frame 7: no memory for matching 2000 x 1500 pixels with 1008 disparities; expected ")
    assert done.stdout.count("\n") == 1
