"""Calibrations of an iCub."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.sources.calibration_files.read import find_calibrations, read_cameras
from harness.sources.rectification import RawCalibration
from tests.calibration_formats import size_px
from tests.disk import write_text
from vfoa.errors import VfoaError

ICUB = """
[CAMERA_CALIBRATION_RIGHT]
w 320
h 240
fx 215.483
fy 214.935
cx 174.868
cy 105.63
k1 -0.343166
k2 0.0987467
p1 -0.00180031
p2 -0.000303536

[CAMERA_CALIBRATION_LEFT]
w 320
h 240
fx 215.622
fy 215.056
cx 163.367
cy 111.212
k1 -0.367522
k2 0.132343
p1 -0.000399841
p2 -0.00016906

[STEREO_DISPARITY]
HN (0.996239 -0.016423 -0.0850726 -0.0667909 0.0189257 0.999409 0.0286955 -0.00388152 0.084551 -0.0301976 0.995961 -0.0128745 0 0 0 1)
QL ( 0.000000\t 0.000000\t 0.000000\t-0.020714\t-0.001918\t 0.000767\t-0.000575\t-0.000048)
"""  # noqa: E501
"""Of an iCub, as its stereoCalib wrote it."""


def test_an_icub_s_own_calibration(tmp_path: Path) -> None:
    """Its eyes are 68 mm apart; that the pose is right_from_left makes the baseline positive."""
    cameras = read_cameras([write_text(tmp_path / "outputCalib.ini", ICUB)], lambda: (640, 480))
    assert isinstance(cameras, RawCalibration)
    assert cameras.left.size_px == (320, 240)
    assert cameras.rectified().baseline_m == pytest.approx(0.0681, abs=1e-4)
    assert find_calibrations(tmp_path, lambda: (640, 480)) == ([("outputCalib.ini",)], [])


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("HN (", "H (", r"\[STEREO_DISPARITY\] has no HN"),
        (" 0 0 0 1)", ")", r"\[STEREO_DISPARITY\] HN: found .*expected 16 numbers"),
        ("fy 214.935", "fy", r"\[CAMERA_CALIBRATION_RIGHT\] fy: found None; expected a number"),
        ("CALIBRATION_LEFT", "CALIBRATION_TOP", r"\[CAMERA_CALIBRATION_LEFT\] w: found None"),
    ],
)
def test_what_an_icub_s_calibration_lacks_is_named(tmp_path: Path, before: str, after: str, message: str) -> None:
    path = write_text(tmp_path / "outputCalib.ini", ICUB.replace(before, after))
    with pytest.raises(VfoaError, match=message) as error:
        read_cameras([path], size_px)
    assert str(error.value).startswith(str(path))
    assert find_calibrations(tmp_path, size_px) == ([], [str(error.value)])
