"""``python -m scripts.measure turned_faces``: labels, and angles of answers that are known."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from scripts.measure.turned_faces import labelled_direction, measure, turned_faces_table
from vfoa.heads.yunet import YuNet
from vfoa.types import Float, Head, StereoFrame


class OneFace(YuNet):
    """A face in the middle of every photograph."""

    def __init__(self) -> None:
        pass

    def faces(self, frame: StereoFrame) -> tuple[Head, ...]:
        u, v = frame.rig.cx_px, frame.rig.cy_px
        box = np.array([u - 10, v - 10, u + 10, v + 10])
        return (Head(box_px=box, score=1.0, face_box_px=box),)


def left_by(deg: float) -> Float:
    return np.array([-np.sin(np.radians(deg)), 0, -np.cos(np.radians(deg))])


def test_angles_are_those_to_the_camera_the_label_and_the_mirror_image(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "face.jpg"), np.zeros((101, 121, 3), np.uint8))
    (tmp_path / "pose.json").write_text(json.dumps({"face": {"yaw_deg": 30, "pitch_deg": 0}}))
    turn, (always_left, silent) = measure(
        tmp_path / "face.jpg",
        {"left": lambda frame, head: left_by(20), "quiet": lambda frame, head: left_by(0), "none": lambda *_: None},
        OneFace(),
    )
    assert turn == pytest.approx(30)
    # what looks left in both images is 40 degrees off in the mirror
    assert (always_left.turned, always_left.to_head, always_left.to_mirror) == pytest.approx((20, 10, 40))
    assert (silent.turned, silent.to_head, silent.to_mirror) == pytest.approx((0, 30, 0), abs=1e-5)
    assert turned_faces_table([("face", turn, always_left)]).rows == (("face", "left", "30.0", "20.0", "10.0", "40.0"),)


def test_a_photograph_without_a_label_has_none(tmp_path: Path) -> None:
    assert labelled_direction(tmp_path / "other.jpg") is None
    (tmp_path / "pose.json").write_text(json.dumps({"up": {"yaw_deg": 0, "pitch_deg": 90}}))
    assert labelled_direction(tmp_path / "other.jpg") is None
    np.testing.assert_allclose(labelled_direction(tmp_path / "up.jpg"), (0, -1, 0), atol=1e-9)
