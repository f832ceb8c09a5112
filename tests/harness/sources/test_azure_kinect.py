"""A recording that Azure Kinect's recorder wrote, and cameras as its SDK computes them from a unit's calibration."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness.sources import azure_kinect
from harness.sources.azure_kinect import AzureKinectClip, AzureKinectSettings, colour_camera, depth_camera
from harness.sources.depth_optics import DepthRegistration
from harness.sources.rectification import RawCamera
from tests.kinect import FOLDER, kinect_recording
from tests.scenes import make_rig
from vfoa.errors import VfoaError


def opened(path: Path) -> AzureKinectClip:
    return AzureKinectClip(AzureKinectSettings(recording=path.name), path.parent)


def test_a_recording_is_colour_with_depth_in_it(tmp_path: Path) -> None:
    clip = opened(kinect_recording(tmp_path))
    assert list(clip.frames) == [1, 2, 3]
    assert [clip.time_ns(number) for number in clip.frames] == [0, 66_667_000, 133_334_000]
    for number in clip.frames:
        frame = clip.frame(number)
        assert frame.left.shape == (720, 1280, 3)
        np.testing.assert_allclose(frame.left[600, 300].astype(int), (40 * number, 90, 160), atol=3)
        assert frame.left[360, 600].tolist() == [255, 255, 255]
        depth_m = frame.depth_m
        assert depth_m is not None
        # the pixel (198.4, 144) of depth at 1.2 m, in the frame of the colour camera, by k4a_calibration_2d_to_3d
        x, y, z = 0.14923760986328125, 0.010393159866333008, 1.2094145507812501
        rig = frame.rig
        u, v = rig.fx_px * x / z + rig.cx_px, rig.fy_px * y / z + rig.cy_px
        assert depth_m[round(v), round(u)] == pytest.approx(z, abs=1e-3)
        assert depth_m[round(v), 500] == pytest.approx(1.5, abs=0.05)
        assert np.isnan(depth_m[:, :20]).all(), "the depth camera does not see that far to the left"


@pytest.mark.parametrize("scale", [1, 2])
def test_depth_of_the_colour_camera_s_own_place_fills_its_image(scale: int) -> None:
    """To the border, also where the image has more pixels; two pixels to the right where it is so far to the left."""
    depth_m = np.random.default_rng(0).uniform(1, 4, (6, 8)).astype(np.float32)
    k = np.array([[80, 0, 3.5], [0, 80, 2.5], [0, 0, 1.0]])
    source, target = RawCamera(size_px=(8, 6), k=k, d=np.zeros(0)), make_rig(8 * scale, 6 * scale, fx_px=80 * scale)
    expected = depth_m.repeat(scale, axis=0).repeat(scale, axis=1)
    np.testing.assert_allclose(DepthRegistration(source, target, np.eye(4)).register(depth_m), expected, rtol=1e-6)
    level, aside = np.full_like(depth_m, 2.0), np.eye(4)
    aside[0, 3] = 2 * 2.0 / 80
    moved = DepthRegistration(source, target, aside).register(level)
    assert np.isnan(moved[:, : 2 * scale]).all()
    np.testing.assert_allclose(moved[:, 2 * scale :], 2.0)


SDK_COLOUR = {
    (1280, 720): (612.081787109375, 611.8679809570312, 637.7880249023438, 361.48492431640625),
    (1920, 1080): (918.1226196289062, 917.802001953125, 956.9320678710938, 542.4773559570312),
    (2048, 1536): (979.330810546875, 978.98876953125, 1020.7608642578125, 770.6759033203125),
}
SDK_DEPTH = {
    (320, 288): (252.1722869873047, 252.2073516845703, 160.15194702148438, 167.136474609375),
    (640, 576): (504.344574, 504.414703, 320.803894, 334.772949),
    (512, 512): (252.1722869873047, 252.2073516845703, 256.1519470214844, 257.136474609375),
}
"""fx, fy, cx, cy by ``k4a_calibration_get_from_raw``; of 640 x 576 as the unit's owner printed them."""


def test_cameras_are_those_of_the_sdk_in_every_mode() -> None:
    cameras = azure_kinect.cameras_of(json.loads((FOLDER / "calibration.json").read_text()), "calibration.json")
    for known, title, camera_of in ((SDK_COLOUR, "COLOR", colour_camera), (SDK_DEPTH, "DEPTH", depth_camera)):
        for size, numbers in known.items():
            camera = camera_of(cameras[title], size, "camera")
            assert camera.size_px == size
            np.testing.assert_allclose(camera.k[[0, 1, 0, 1], [0, 1, 2, 2]], numbers, atol=1e-3)
    expected = [6.084146022796631, 4.375491142272949, -5.5295702622970566e-05, 6.502933683805168e-05]
    expected += [0.2361859828233719, 6.408733367919922, 6.418295860290527, 1.220292091369629]
    np.testing.assert_allclose(depth_camera(cameras["DEPTH"], (640, 576), "camera").d, expected, rtol=1e-6)


def test_the_pose_is_that_of_the_sdk(tmp_path: Path) -> None:
    head = azure_kinect.KinectHead(kinect_recording(tmp_path))
    expected_mm = (64.50254821777344, 101.80186462402344, 1501.3963623046875)  # by k4a_calibration_3d_to_3d
    np.testing.assert_allclose(1000 * (head.colour_from_depth @ [0.1, -0.05, 1.5, 1])[:3], expected_mm, atol=1e-3)


def test_a_calibration_of_the_middle_rows_is_the_same_camera() -> None:
    """Of old firmware, whose sensor is said to have 16:9."""
    cameras = azure_kinect.cameras_of(json.loads((FOLDER / "calibration.json").read_text()), "calibration.json")
    colour = cameras["COLOR"]
    cx, cy, fx, fy, *others = colour["Intrinsics"]["ModelParameters"]
    middle = [cx, (cy * 3072 - 384) / 2304, fx, fy * 3072 / 2304, *others]
    old = {**colour, "SensorHeight": 2304, "Intrinsics": {"ModelParameters": middle}}
    for size in SDK_COLOUR:
        np.testing.assert_allclose(colour_camera(old, size, "old").k, colour_camera(colour, size, "new").k, rtol=1e-9)


def _changed(path: Path, before: bytes, after: bytes, count: int = 1) -> Path:
    assert len(before) == len(after)
    data = path.read_bytes()
    assert before in data
    path.write_bytes(data.replace(before, after, count))
    return path


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (b"DEPTH\x86", b"DEPTX\x86", ["no track DEPTH"]),
        (b"CALIBRATION_CameraLocationPV0", b"CALIBRATION_CameraLocationPV1", ["calibration.json", "LocationPV0"]),
        (b'"ModelParameters"', b'"ModelParameterx"', ["calibration.json", "ModelParameters"]),
        (b'"CalibrationInformation"', b'"CalibrationInformatiom"', ["calibration.json", "CalibrationInformation"]),
        (b'{"CalibrationInf', b'("CalibrationInf', ["calibration.json", "JSON"]),
        (b'"SensorWidth":4096', b'"SensorWidth":"a"5', ["calibration.json"]),
    ],
)
def test_what_is_wrong_with_a_recording_is_named(tmp_path: Path, before: bytes, after: bytes, words: list[str]) -> None:
    path = kinect_recording(tmp_path)
    if before.startswith(b"DEPTH"):
        before, after = before[:-1], after[:-1]
    with pytest.raises(VfoaError) as error:
        opened(_changed(path, before, after))
    assert str(error.value).startswith(str(path))
    assert [word for word in words if word not in str(error.value)] == []


def test_a_recording_that_was_cut_off_has_the_frames_before(tmp_path: Path) -> None:
    path = kinect_recording(tmp_path)
    path.write_bytes(path.read_bytes()[:-250_000])
    clip = opened(path)
    assert list(clip.frames) == [1]
    assert clip.frame(1).depth_m is not None


def test_a_film_of_one_camera_is_none(tmp_path: Path) -> None:
    path = kinect_recording(tmp_path)
    assert AzureKinectClip.recognise(path, {})
    other = _changed(path, b"K4A_", b"K4B_", -1)
    assert AzureKinectClip.recognise(other, {}) == ()
