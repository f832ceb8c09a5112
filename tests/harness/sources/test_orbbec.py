"""Recordings of Orbbec's SDK, written as its own code does."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest

from harness.clips.add import recognise
from harness.sources.recordings import orbbec
from harness.sources.recordings.clip import RecordingClip
from harness.sources.recordings.settings import RecordingSettings
from tests.adapter_contract import check_contract
from tests.disk import moving_picture
from tests.orbbec import Layout, Profile, image, write_sdk_bag
from vfoa.errors import VfoaError

COUNT = 3
START_NS, STEP_NS, LATE_NS = 1_738_000_000_000, 33_000_000, 1_310_000
COLOUR = Profile(size_px=(160, 120), fx=120.0, cx=80.5, cy=59.5)
# The pose of a Femto Bolt: its rows are no unit vectors (an issue of the SDK's repository quotes it).
TURN = (0.993813, 0.000713588, -0.00148801, -0.00054392, 0.993814, 0.111057, 0.00155805, -0.111056, 0.993813)
MOVED_MM = -32.5317, -1.03079, 1.90774
DEPTH = Profile(size_px=(80, 64), fx=60.0, cx=40.0, cy=32.0, rotation=TURN, translation_mm=MOVED_MM)
DEPTH_MM = np.full((64, 80), 1500, np.uint16)
PICTURES = [moving_picture(number, 160, 120) for number in range(COUNT)]


def jpeg(picture: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()


def write(path: Path, layout: Layout, depth: Profile = DEPTH, colour: Profile = COLOUR, form: str = "mjpg") -> Path:
    images = []
    for number, picture in enumerate(PICTURES):
        content = jpeg(picture) if form == "mjpg" else picture.tobytes()
        shown = image(layout, colour.size_px, form.upper() if form == "mjpg" else form, 480, content)
        measured = image(layout, depth.size_px, "mono16", 160, DEPTH_MM.tobytes())
        images += [(START_NS + number * STEP_NS, 2, shown), (START_NS + number * STEP_NS + LATE_NS, 3, measured)]
        images.append((START_NS + number * STEP_NS, 1, image(layout, (80, 64), "mono16", 160, DEPTH_MM.tobytes())))
    return write_sdk_bag(path, images, {2: colour, 3: depth})


def open_clip(path: Path, **settings: object) -> RecordingClip:
    return RecordingClip(RecordingSettings.model_validate({"recording": path.name, **settings}), path.parent)


def in_colour(u: int, v: int, depth_m: float) -> tuple[int, int, float]:
    """The pixel of the colour image, and the depth there, of a pixel of the depth image."""
    point = np.array([(u - DEPTH.cx) / DEPTH.fx, (v - DEPTH.cy) / DEPTH.fx, 1]) * depth_m
    angle = np.arctan2(0.111057, 0.993813)
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]]) @ point + np.array(MOVED_MM) / 1000
    return round(COLOUR.fx * x / z + COLOUR.cx), round(COLOUR.fx * y / z + COLOUR.cy), z


@pytest.mark.parametrize("layout", get_args(Layout))
def test_colour_and_depth_in_it_are_read(tmp_path: Path, layout: Layout) -> None:
    path = write(tmp_path / "a.bag", layout)
    adapter, found = recognise(path, None, {})
    assert adapter == "rosbag"
    clip = RecordingClip(RecordingSettings.model_validate(found.source), found.root)
    assert [clip.time_ns(number) for number in clip.frames] == [START_NS + n * STEP_NS for n in range(COUNT)]
    for number, picture in zip(clip.frames, PICTURES, strict=True):
        frame = clip.frame(number)
        assert np.abs(frame.left.astype(int) - picture).mean() < 4
        assert (frame.rig.fx_px, frame.rig.cx_px, frame.rig.cy_px) == (120.0, 80.5, 59.5)
        assert frame.depth_m is not None
        for u, v in ((40, 32), (20, 20), (60, 40), (30, 10)):
            column, row, expected_m = in_colour(u, v, 1.5)
            assert frame.depth_m[row, column] == pytest.approx(expected_m, abs=0.01)
    check_contract(pickle.loads(pickle.dumps(clip)))


def test_pixels_that_are_not_compressed_are_read(tmp_path: Path) -> None:
    clip = open_clip(write(tmp_path / "a.bag", "content", form="rgb8"))
    assert np.array_equal(clip.frame(2).left, PICTURES[1])


def test_coefficients_are_in_the_order_of_the_sdk() -> None:
    d = (16.1704, 8.44953, 0.324469, 16.4805, 13.9441, 1.99604, 5.92792e-05, -1.46558e-05)
    camera = orbbec.camera_of(replace(DEPTH, d=d).message(), "a")
    assert camera.d.tolist() == pytest.approx([d[0], d[1], d[6], d[7], *d[2:6]])
    assert camera.model == "plumb_bob"
    fisheye = orbbec.camera_of(replace(DEPTH, d=d, model=5).message(), "a")
    assert fisheye.d.tolist() == pytest.approx(d[:4])
    assert fisheye.model == "equidistant"


@pytest.mark.parametrize(
    ("depth", "colour", "said"),
    [
        (replace(DEPTH, rotation=(0.0,) * 9), COLOUR, r"is not aligned with"),
        (replace(DEPTH, rotation=(1e25, *TURN[1:])), COLOUR, r"/camera/depth/camera_info: rotationMatrix: found"),
        (DEPTH, replace(COLOUR, fx=0.0), r"/camera/color/camera_info: found 160 x 120 pixels and fx 0; expected"),
    ],
)
def test_a_calibration_that_is_not_set_is_told(tmp_path: Path, depth: Profile, colour: Profile, said: str) -> None:
    with pytest.raises(VfoaError, match=rf"a\.bag: .*{said}"):
        open_clip(write(tmp_path / "a.bag", "content", depth, colour)).frame(1)


def test_a_message_of_another_layout_is_told(tmp_path: Path) -> None:
    whole = image("content", (160, 120), "mjpg", 480, jpeg(PICTURES[0]))
    path = write_sdk_bag(tmp_path / "a.bag", [(START_NS, 2, whole[:200])], {2: COLOUR})
    with pytest.raises(VfoaError, match=r"/camera/color/image_raw: not a sensor_msgs/msg/Image in orbbec"):
        open_clip(path)
