from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from disk import HEIGHT, WIDTH, picture
from numpy.typing import NDArray
from recordings import Camera, Family, Pixels, rectified_camera, write_pairs

from harness.adapters.mcap.clip import McapClip, McapSettings

LEFT = rectified_camera(WIDTH, HEIGHT, fx=100.0, cx=31.5, cy=23.5)
RIGHT = rectified_camera(WIDTH, HEIGHT, fx=100.0, cx=30.0, cy=23.5, baseline_m=0.12)
START_NS = 1_700_000_000_000_000_007
STEP_NS = 40_000_000


def stamp(number: int) -> int:
    return START_NS + (number - 1) * STEP_NS


def pairs(
    numbers: range = range(1, 6),
) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8], Camera, Camera]]:
    for n in numbers:
        yield stamp(n), picture(n), picture(1000 + n), LEFT, RIGHT


def open_clip(path: Path, **settings: object) -> McapClip:
    return McapClip(McapSettings.model_validate({"recording": path.name, **settings}), path.parent)


@pytest.mark.parametrize("pixels", ["raw", "png"])
@pytest.mark.parametrize("family", ["ros2", "protobuf", "json"])
def test_every_family_gives_back_what_was_recorded(tmp_path: Path, family: Family, pixels: Pixels) -> None:
    clip = open_clip(write_pairs(tmp_path / "a.mcap", pairs(), family, pixels))
    assert list(clip.frames) == [1, 2, 3, 4, 5]
    assert clip.rate_hz == 25.0
    assert clip.notes == ()
    for n in (4, 1, 5):
        frame = clip.frame(n)
        assert frame.time_ns == stamp(n)
        assert np.array_equal(frame.left, picture(n))
        assert np.array_equal(frame.right, picture(1000 + n))
        rig = frame.rig
        assert (rig.fx_px, rig.cx_px, rig.cx_right_px, rig.cy_px) == (100.0, 31.5, 30.0, 23.5)
        assert rig.baseline_m == pytest.approx(0.12)


def test_jpeg_is_close(tmp_path: Path) -> None:
    smooth = cv2.GaussianBlur(picture(3), (0, 0), 6)
    clip = open_clip(
        write_pairs(tmp_path / "a.mcap", [(stamp(1), smooth, smooth, LEFT, RIGHT)], pixels="jpeg"),
    )
    assert np.abs(clip.frame(1).left.astype(int) - smooth).mean() < 2
