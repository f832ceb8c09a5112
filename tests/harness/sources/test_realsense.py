"""Recordings that RealSense's SDK wrote (realsense/record.py), and what may be missing in them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from harness.sources.recordings.clip import RecordingClip
from harness.sources.recordings.settings import RecordingSettings
from tests.depth_recordings import Lens, messages
from tests.disk import HEIGHT, WIDTH, moving_picture
from vfoa.errors import VfoaError

FOLDER = Path(__file__).parent / "realsense"
SDK = "sdk_2.56.bag", "sdk_2.59.db3"
LENS = Lens(width=WIDTH, height=HEIGHT, fx=60.0, cx=31.5, cy=23.5)
COLOUR, DEPTH = "/device_0/sensor_1/Color_0", "/device_0/sensor_0/Depth_0"


def _open(name: str, **settings: object) -> RecordingClip:
    return RecordingClip(RecordingSettings.model_validate({"recording": name, **settings}), FOLDER)


@pytest.mark.parametrize("name", SDK)
def test_a_recording_of_the_sdk_is_colour_with_depth_in_it(name: str) -> None:
    clip = _open(name)
    assert list(clip.frames) == [1, 2, 3]
    for number in clip.frames:
        frame = clip.frame(number)
        assert frame.left.shape == (60, 80, 3)
        assert np.unique(frame.left).tolist() == [100 + number]
        assert (frame.rig.fx_px, frame.rig.cx_px, frame.rig.cy_px) == (60.0, 40.5, 29.0)
        assert frame.depth_m is not None
        for u, v, depth_m in ((10, 24, 1.5), (5, 10, 1.5), (50, 24, 1.2), (45, 40, 1.2)):
            column, row, expected_m = _in_colour(u, v, depth_m)
            assert frame.depth_m[row, column] == pytest.approx(expected_m, abs=1e-3)


def _in_colour(u: int, v: int, depth_m: float) -> tuple[int, int, float]:
    """The pixel of the colour image, and the depth there, of a pixel of the depth image, by record.py's numbers."""
    x, y = (u - 31) / 40 * depth_m, (v - 24) / 40 * depth_m
    cos, sin = math.cos(0.05), math.sin(0.05)
    x_c, y_c, z_c = x + 0.015, cos * y - sin * depth_m, sin * y + cos * depth_m
    return round(60 * x_c / z_c + 40.5), round(60 * y_c / z_c + 29), z_c


@pytest.mark.parametrize("name", SDK)
def test_the_unit_of_depth_is_the_recording_s_or_the_given_one(name: str) -> None:
    assert [note for note in _open(name).notes if "4000 counts a metre" in note]
    given = _open(name, depth_scale=2000)
    assert [note for note in given.notes if "counts a metre" in note] == []
    depth_m = given.frame(1).depth_m
    assert depth_m is not None
    assert np.nanmax(depth_m) == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize("name", SDK)
def test_the_infrared_pair_has_the_baseline_of_its_poses(name: str) -> None:
    names = {side: f"/device_0/sensor_0/Infrared_{n}/image/data" for n, side in ((1, "left"), (2, "right"))}
    if name.endswith("db3"):
        names = {side: f"{topic}/compressed" for side, topic in names.items()}
    frame = _open(name, **names).frame(2)
    assert frame.right is not None
    assert (frame.rig.fx_px, frame.left[0, 0, 0]) == (40.0, 62)
    assert frame.rig.baseline_m == pytest.approx(0.05)
    assert _open(name, **names, baseline_m=0.06).frame(2).rig.baseline_m == pytest.approx(0.06)


def _written(tmp_path: Path, frame_id: str) -> RecordingClip:
    """A recording with the SDK's topics, but without its poses and its unit."""
    with messages(tmp_path, "bag") as (path, write):
        for stream in (COLOUR, DEPTH):
            write.camera(f"{stream}/info/camera_info", 10**9, LENS, frame_id)
        write.image(f"{COLOUR}/image/data", 10**9, moving_picture(1), "rgb8", frame_id)
        write.image(f"{DEPTH}/image/data", 10**9, np.full((HEIGHT, WIDTH), 1250, np.uint16), "mono16", frame_id)
    return RecordingClip(RecordingSettings(recording=path.name), path.parent)


def test_a_recording_without_poses_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"Depth_0/image/data.*not aligned"):
        _written(tmp_path, "0")


def test_frames_with_names_are_those_of_another_program(tmp_path: Path) -> None:
    """Then one frame of both is aligned depth, and without the SDK's unit integers are millimetres."""
    depth_m = _written(tmp_path, "color").frame(1).depth_m
    assert depth_m is not None
    assert np.unique(depth_m).tolist() == [1.25]
