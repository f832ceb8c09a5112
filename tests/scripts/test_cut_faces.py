"""``python -m scripts.measure cut_faces``: images that end within a face, and turns of answers that are known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from scripts.measure.cut_faces import SHARES, cut_at, cut_faces_table, measure
from scripts.measure.mirror import frame_of
from vfoa.geometry import pixel_ray
from vfoa.heads.yunet import YuNet
from vfoa.types import Float, Head, StereoFrame

FACE = np.array([60.0, 100, 260, 340])


class WhiteFaces(YuNet):
    """A white rectangle is a face, if at least six tenths of it are there."""

    def __init__(self) -> None:
        pass

    def faces(self, frame: StereoFrame) -> tuple[Head, ...]:
        rows, columns = np.nonzero((frame.left > 200).all(axis=2))
        if len(rows) < 0.55 * 200 * 240:
            return ()
        box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        return (Head(box_px=np.array(box, np.float64), score=1.0),)


def _by_area(frame: StereoFrame, head: Head) -> Float:
    """A direction that turns by a degree for each hundredth of the face that is not there."""
    turn = np.radians(100 * (1 - np.prod(head.box_px[2:] - head.box_px[:2]) / (200 * 240)))
    return np.array([-np.sin(turn), 0, -np.cos(turn)])


def _photograph(folder: Path) -> Path:
    image = np.zeros((600, 500, 3), np.uint8)
    image[100:340, 60:260] = 255
    cv2.imwrite(str(folder / "face.png"), image)
    return folder / "face.png"


@pytest.mark.parametrize(
    ("side", "first", "size"),
    [(0, (100, 0), (400, 600)), (1, (0, 148), (500, 452)), (2, (0, 0), (220, 600)), (3, (0, 0), (500, 292))],
)
def test_a_cut_image_has_the_same_camera(side: int, first: tuple[int, int], size: tuple[int, int]) -> None:
    frame = frame_of(np.random.default_rng(0).integers(0, 255, (600, 500, 3)).astype(np.uint8))
    cut = cut_at(frame, FACE, side, 0.2)
    (left, top), (width, height) = first, size
    np.testing.assert_array_equal(cut.left, frame.left[top : top + height, left : left + width])
    np.testing.assert_allclose(pixel_ray(30, 40, cut.rig), pixel_ray(30 + left, 40 + top, frame.rig))


def test_turns_are_those_from_the_photograph(tmp_path: Path) -> None:
    found = measure(_photograph(tmp_path), {"turns": _by_area, "none": lambda *_: None}, WhiteFaces())
    for share in SHARES[:-1]:
        assert found[share] == [{"turns": pytest.approx(100 * share, abs=0.6)}] * 4
    assert found[SHARES[-1]] == [None] * 4
    first, second, *_, last = cut_faces_table([found], ["turns", "none"]).rows
    assert first[:3] == ("0 %", "4 of 4", "0.0")
    assert float(second[2]) == pytest.approx(10, abs=0.6)
    assert last[1] == "0 of 4"
