"""Measured depth in place of matching."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.scenes import make_rig
from vfoa.errors import VfoaError
from vfoa.geometry import depth_from_disparity
from vfoa.stereo import MATCHERS
from vfoa.types import Map, StereoFrame, StereoRig

DEPTHS = st.one_of(st.just(float("nan")), st.floats(0.0625, 300, width=32))


def _frame(depth_m: Map | None, rig: StereoRig, *, right: bool = False) -> StereoFrame:
    image = np.zeros((rig.height_px, rig.width_px, 3), np.uint8)
    return StereoFrame(index=1, time_ns=0, left=image, right=image if right else None, depth_m=depth_m, rig=rig)


@given(depth=arrays(np.float32, (3, 5), elements=DEPTHS), offset=st.floats(-3, 0))
def test_depth_comes_through_and_unknown_stays_unknown(depth: Map, offset: float) -> None:
    for rig in (
        make_rig(5, 3, cx_right_offset_px=offset),
        StereoRig.of_depth_camera(width_px=5, height_px=3, fx_px=600, fy_px=610, cx_px=2, cy_px=1),
    ):
        found = MATCHERS.load("sensor")(MATCHERS.load("sensor").Settings()).match(_frame(depth, rig))
        back = depth_from_disparity(found.disparity_px, rig)
        np.testing.assert_allclose(back, depth, rtol=1e-5)
        assert (np.isnan(found.disparity_px) == np.isnan(depth)).all()


def test_each_matcher_names_the_one_that_fits_the_frame() -> None:
    rig = make_rig(32, 16)
    sensor, sgbm = (MATCHERS.load(name)(MATCHERS.load(name).Settings()) for name in ("sensor", "sgbm"))
    with pytest.raises(VfoaError, match="sgbm"):
        sensor.match(_frame(None, rig, right=True))
    with pytest.raises(VfoaError, match="sensor"):
        sgbm.match(_frame(np.ones((16, 32), np.float32), rig))


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("inf")])
def test_a_frame_refuses_what_is_no_depth(wrong: float) -> None:
    rig = make_rig(4, 3)
    with pytest.raises(ValueError, match="depth_m"):
        _frame(np.full((3, 4), wrong, np.float32), rig)
    with pytest.raises(ValueError, match="neither"):
        _frame(None, rig)
