from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from harness.sources.sintel import SintelClip, SintelSettings
from harness.studio.clip import StudioClip, StudioSettings
from tests import graphs
from tests.scenes import make_rig
from vfoa.errors import VfoaError
from vfoa.geometry import depth_from_disparity
from vfoa.stereo import MATCHERS
from vfoa.stereo.hitnet import HitNet
from vfoa.types import StereoFrame, StereoRig

INPUT = {"input": (1, 2, 240, 320)}


def frame_of(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> StereoFrame:
    return StereoFrame(index=1, time_ns=0, left=left, right=right, rig=rig)


def black(rig: StereoRig) -> StereoFrame:
    image = np.zeros((rig.height_px, rig.width_px, 3), np.uint8)
    return frame_of(image, image, rig)


def answering(folder: Path, disparity: np.ndarray) -> HitNet:
    """A network that always gives this disparity (240, 320)."""
    weights = graphs.constant(folder / "hitnet.onnx", INPUT, {"any": disparity[None, ..., None]})
    return HitNet(HitNet.Settings(weights=weights))


def brightness(folder: Path) -> HitNet:
    """A network whose disparity is 100 times what the left view is brighter than the right one."""
    nodes = [
        helper.make_node("Split", ["input"], ["left", "right"], axis=1),
        helper.make_node("Sub", ["left", "right"], ["brighter"]),
        graphs.constant_node("hundred", np.float32(100)),
        helper.make_node("Mul", ["brighter", "hundred"], ["map"]),
        helper.make_node("Transpose", ["map"], ["disparity"], perm=[0, 2, 3, 1]),
    ]
    weights = graphs.write(folder / "gray.onnx", nodes, INPUT, {"disparity": (1, 240, 320, 1)})
    return HitNet(HitNet.Settings(weights=weights))


def test_is_used_by_name() -> None:
    assert MATCHERS.load("hitnet") is HitNet


@pytest.mark.parametrize("offset_px", [0.0, -12.0, 12.0])
def test_depth_is_the_same_at_the_networks_size_and_the_images(tmp_path: Path, offset_px: float) -> None:
    rig = make_rig(960, 360, fx_px=700, cx_right_offset_px=offset_px)
    third = replace(rig, width_px=320, fx_px=rig.fx_px / 3, cx_px=rig.cx_px / 3, cx_right_px=rig.cx_right_px / 3)
    small = np.tile(np.linspace(5, 25, 240, dtype=np.float32)[:, None], (1, 320))
    found = answering(tmp_path, small).match(black(rig)).disparity_px
    assert found.shape == (360, 960)
    # Row 1 of the network is nearest to row 2 of the image; its disparity is three times as large there.
    moved_px = max(offset_px, 0)  # of the right view that the network gets
    np.testing.assert_allclose(found[[2, 182, 359], 500], 3 * small[[1, 121, 239], 0] - moved_px, rtol=1e-6)
    np.testing.assert_allclose(
        depth_from_disparity(found[182, 500], rig), depth_from_disparity(small[121, 0] - moved_px / 3, third), rtol=1e-6
    )


def test_what_lies_at_infinity_or_outside_the_right_image_is_unknown(tmp_path: Path) -> None:
    rig = make_rig(640, 240)
    small = np.full((240, 320), 30, np.float32)
    small[:10], small[10:20] = 0, -1
    found = answering(tmp_path, small).match(black(rig)).disparity_px
    assert np.isnan(found[:20]).all()
    assert np.isnan(found[20:, :60]).all()
    assert (found[20:, 60:] == 60).all()


def test_where_infinity_has_a_negative_disparity_the_right_view_is_moved(tmp_path: Path) -> None:
    """The graph's disparity is 100 times what the left view is brighter than the right one."""
    rig = make_rig(320, 240, cx_right_offset_px=20)
    left, right = np.full((2, 240, 320, 3), 51, np.uint8)
    right[:, 60:] = 0
    found = brightness(tmp_path).match(frame_of(left, right, rig)).disparity_px
    assert np.isnan(found[:, :40]).all()
    np.testing.assert_allclose(found[:, 40:300], 100 * 51 / 255 - 20, atol=1e-4)


def test_the_input_is_the_left_and_the_right_view_in_gray_from_0_to_1(tmp_path: Path) -> None:
    model = pickle.loads(pickle.dumps(brightness(tmp_path)))
    rig = make_rig(320, 240)
    left, right = np.zeros((2, 240, 320, 3), np.uint8)
    left[...], right[...] = [200, 100, 50], 60
    found = model.match(frame_of(left, right, rig)).disparity_px
    luma = round(0.299 * 200 + 0.587 * 100 + 0.114 * 50)
    np.testing.assert_allclose(found[:, 200:], 100 * (luma - 60) / 255, rtol=1e-5)


def test_an_open_input_size_is_refused(tmp_path: Path) -> None:
    weights = graphs.constant(
        tmp_path / "open.onnx", {"input": (1, 2, "height", "width")}, {"disparity": np.zeros((1, 240, 320, 1))}
    )
    with pytest.raises(VfoaError, match="leaves its input size open"):
        HitNet(HitNet.Settings(weights=weights)).match(black(make_rig()))


def errors_px(model: HitNet, clip: SintelClip | StudioClip, number: int) -> np.ndarray:
    """Absolute errors of the pixels whose truth is known, NaN where the network knows nothing."""
    truth = clip.truth(number).disparity
    assert truth is not None
    found = model.match(clip.frame(number)).disparity_px
    return np.abs(found - truth.disparity_px)[np.isfinite(truth.disparity_px)]


def test_finds_the_true_disparity_of_bandage_2_and_of_a_studio(shared_data: Path, shared_models: Path) -> None:
    model = HitNet(HitNet.Settings(weights=str(shared_models / "hitnet_1x240x320_model_float32.onnx")))
    sintel = SintelClip(SintelSettings.model_validate({"scene": "bandage_2"}), shared_data / "sintel")
    studio = StudioClip(StudioSettings(scenario="table"), None)
    # The median disparities are 78 and 30 px: one that is not scaled back is off by more than two thirds of that.
    for clip, number, limit_px in ((sintel, 26, 2.5), (studio, 31, 1.5)):
        errors = errors_px(model, clip, number)
        assert np.isfinite(errors).mean() > 0.85
        assert np.nanmedian(errors) < limit_px
