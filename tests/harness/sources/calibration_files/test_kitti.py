"""Calibrations of KITTI."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.sources.calibration_files.read import Options, find_calibrations
from tests.calibration_formats import kitti_rows, projection, read_rectified, size_px
from tests.calibrations import write_opencv
from tests.disk import write_text


def test_numbers_of_cameras_hold_for_kitti_s_files_alone(tmp_path: Path) -> None:
    rows = kitti_rows(*(projection(50, 30, -50 * b) for b in (0, 0.1, 0, 0.3)), names=("P0", "P1", "P2", "P3"))
    write_text(tmp_path / "calib.txt", rows)
    write_opencv(tmp_path / "c.yml", {"P1": projection(50, 30), "P2": projection(50, 30, -10)})
    found, _ = find_calibrations(tmp_path, size_px, Options(calibration_cameras=(0, 1)))
    assert found == [("c.yml",), ("calib.txt",)]
    (tmp_path / "c.yml").unlink()
    assert find_calibrations(tmp_path, size_px) == ([("calib.txt",)], [])


def test_a_camera_that_stands_ahead_of_the_other_does_not_change_the_baseline(tmp_path: Path) -> None:
    """As KITTI's colour cameras do, by some mm; P = K [I | -C] of a camera at C (Hartley and Zisserman, 6.1.2)."""
    k = projection(700, 600)[:, :3]
    places = [[-0.06, 0.0, 0.0], [0.47, 0.004, 0.003]]
    left, right = (k @ np.column_stack([np.eye(3), -np.array(place)]) for place in places)
    write_text(tmp_path / "calib.txt", kitti_rows(left, right))
    assert read_rectified(tmp_path / "calib.txt").baseline_m == pytest.approx(0.53, abs=1e-9)


def test_kitti_s_baseline_is_the_difference_of_the_fourth_columns(shared_data: Path) -> None:
    calibration = read_rectified(shared_data / "kitti_pair" / "calib.txt")
    assert calibration.baseline_m == pytest.approx(0.532, abs=0.002)
    assert calibration.fx_px == 721.5377
    assert calibration.cx_px == calibration.cx_right_px == 609.5593
    gray = read_rectified(shared_data / "kitti_pair" / "calib.txt", Options(calibration_cameras=(0, 1)))
    assert gray.baseline_m == pytest.approx(0.537, abs=0.001)


@pytest.mark.parametrize(
    ("names", "options", "size"),
    [(("P_rect_02", "P_rect_03"), Options(), (64, 48)), (("P0", "P1"), Options(calibration_cameras=(0, 1)), None)],
    ids=["raw", "gray"],
)
def test_kitti_s_rows_are_read(
    tmp_path: Path, names: tuple[str, str], options: Options, size: tuple[int, int] | None
) -> None:
    """Among others, with a byte-order mark and line ends of Windows."""
    text = kitti_rows(projection(50, 30), projection(50, 32, -10), names=names)
    text = f"\ufeffcalib_time: 09-Jan-2012 13:57:47\nS_rect_02: 6.4e1 4.8e1\n{text}".replace("\n", "\r\n")
    calibration = read_rectified(write_text(tmp_path / "c.txt", text), options)
    assert (calibration.baseline_m, calibration.cx_px, calibration.cx_right_px) == (0.2, 30.0, 32.0)
    assert calibration.size_px == size
