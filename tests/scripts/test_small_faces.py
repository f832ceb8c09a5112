"""``python -m scripts.measure small_faces``: sizes of shrunk faces, and turns of answers that are known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from scripts.measure.small_faces import HEIGHTS_PX, measure, shrunk, small_faces_table
from vfoa.heads.yunet import YuNet
from vfoa.types import Float, Head, Image, StereoFrame

WHITE = 200


def _extent(image: Image) -> tuple[int, int, int, int]:
    rows, columns = np.nonzero((image > WHITE).all(axis=2))
    return int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1


class WhiteFaces(YuNet):
    """A white square is a face, if it has at least 30 pixels."""

    def __init__(self) -> None:
        pass

    def faces(self, frame: StereoFrame) -> tuple[Head, ...]:
        box = np.array(_extent(frame.left), np.float64)
        return (Head(box_px=box, score=1.0),) if box[3] - box[1] >= 30 else ()


def _by_height(frame: StereoFrame, head: Head) -> Float:
    """A direction that turns as a face gets smaller: to the left by as many degrees as it is below 240 pixels."""
    turn = np.radians((240 - (head.box_px[3] - head.box_px[1])) / 10)
    return np.array([-np.sin(turn), 0, -np.cos(turn)])


@pytest.fixture
def photograph(tmp_path: Path) -> Path:
    image = np.zeros((600, 500, 3), np.uint8)
    image[100:340, 60:260] = 255
    cv2.imwrite(str(tmp_path / "face.png"), image)
    return tmp_path / "face.png"


def test_a_shrunk_face_stays_in_the_middle(photograph: Path) -> None:
    image = cv2.imread(str(photograph))
    assert image is not None
    for factor in (1.0, 0.5, 0.25):
        left, top, right, bottom = _extent(shrunk(image, (60, 100, 260, 340), factor))
        assert (right - left, bottom - top) == pytest.approx((200 * factor, 240 * factor), abs=2)
        assert ((left + right) / 2, (top + bottom) / 2) == pytest.approx((450, 450), abs=1.5)


def test_turns_are_those_from_the_photograph(photograph: Path) -> None:
    found = measure(photograph, {"turns": _by_height, "none": lambda *_: None}, WhiteFaces())
    assert [height for height, turns in found.items() if turns is None] == [24]
    for height_px in HEIGHTS_PX[:-1]:
        turns = found[height_px]
        assert turns is not None
        assert turns == {"turns": pytest.approx((240 - height_px) / 10, abs=0.25)}
    first, *_, last = small_faces_table([found], ["turns", "none"]).rows
    assert first[:2] == ("120", "1 of 1")
    assert float(first[2]) == pytest.approx(12, abs=0.25)
    assert last[1] == "0 of 1"
