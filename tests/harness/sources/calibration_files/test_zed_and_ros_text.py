"""Calibrations in text: the ZED's, and those of ROS's calibrator."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.sources.calibration_files.read import find_calibrations, read_cameras
from harness.sources.rectification import RawCalibration
from tests import calibrations
from tests.calibration_formats import read_raw, size_px
from tests.calibrations import RIG
from tests.disk import write_text
from vfoa.errors import VfoaError

ZED_SIZES = {
    "4K": (3840, 2160),
    "QHDPLUS": (3200, 1800),
    "2K": (2208, 1242),
    "FHD1200": (1920, 1200),
    "FHD": (1920, 1080),
    "HD": (1280, 720),
    "SVGA": (960, 600),
    "VGA": (672, 376),
}
"""Stereolabs' names of the resolutions of all their cameras."""


@pytest.mark.parametrize("name", ZED_SIZES)
def test_a_zed_s_resolutions_have_the_maker_s_names(tmp_path: Path, name: str) -> None:
    """In lower case, as the first models' files have them."""
    text = calibrations.write_zed(tmp_path / "SN1.conf", RIG).read_text().replace("_HD", f"_{name}").lower()
    found = read_cameras([write_text(tmp_path / "SN1.conf", text)], lambda: ZED_SIZES[name])
    assert isinstance(found, RawCalibration)
    assert found.left.size_px == ZED_SIZES[name]
    np.testing.assert_allclose(found.left.k, RIG.k[0])


@pytest.mark.parametrize(
    ("coefficients", "expected"),
    [
        ("k1=0.1 k2=0.02", [0.1, 0.02, 0, 0, 0]),
        (
            "k1=0.1 k2=0.02 k3=0.03 k4=0.04 k5=0.05 k6=0.06 p1=0.001 p2=0.002",
            [0.1, 0.02, 0.001, 0.002, 0.03, 0.04, 0.05, 0.06],
        ),
    ],
    ids=["the first ZED", "rational"],
)
def test_a_zed_has_as_many_coefficients_as_its_file(tmp_path: Path, coefficients: str, expected: list[float]) -> None:
    lens = ["fx=700", "fy=700", "cx=640", "cy=360", *coefficients.split()]
    pose = ["[STEREO]", "Baseline=120", "TY=0", "TZ=0", "CV_HD=0", "RX_HD=0", "RZ_HD=0"]
    path = write_text(tmp_path / "SN1.conf", "\n".join(["[LEFT_CAM_HD]", *lens, "[RIGHT_CAM_HD]", *lens, *pose]))
    assert read_raw([path]).left.d.tolist() == expected


def test_a_message_of_a_part_of_the_sensor_is_of_that_part(tmp_path: Path) -> None:
    paths = calibrations.write_ros_echo(tmp_path, RIG, is_ros_2=True)
    whole = read_raw(paths)
    for path in paths:
        text = path.read_text(encoding="utf-8").replace("binning_x: 0", "binning_x: 2")
        write_text(path, text.replace("y_offset: 0", "y_offset: 40"))
    part, (width, height) = read_raw(paths), whole.left.size_px
    assert part.left.size_px == (width // 2, height - 40)
    to_part = np.array([[0.5, 0, -0.25], [0, 1, -40], [0, 0, 1]])
    np.testing.assert_allclose(part.left.k, to_part @ whole.left.k)
    np.testing.assert_allclose(part.right.p, to_part @ whole.right.p)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("[narrow_stereo/right]", "[narrow_stereo]", r"found \[narrow_stereo/left\], \[narrow_stereo\]; expected both"),
        ("0.000500 0.000000", "0.000500", r"\[narrow_stereo/right\]: distortion: found 4 .*left\.yaml"),
        ("rectification", "rectified", r"\[narrow_stereo/left\]: no rectification; expected"),
        ("\n1280\n", "\n1280 720\n", r"\[narrow_stereo/left\]: width: found 2 numbers; expected 1"),
    ],
)
def test_what_ros_s_text_lacks_is_named(tmp_path: Path, before: str, after: str, message: str) -> None:
    path = calibrations.write_ros_text(tmp_path / "ost.txt", RIG)
    write_text(path, path.read_text(encoding="utf-8").replace(before, after, 1))
    with pytest.raises(VfoaError, match=message) as error:
        read_cameras([path], size_px)
    assert str(error.value).startswith(str(path))
    assert find_calibrations(tmp_path, size_px) == ([], [str(error.value)])


def test_ros_s_text_beside_the_files_of_both_cameras_is_no_second_calibration(tmp_path: Path) -> None:
    calibrations.write_ros_text(tmp_path / "ost.txt", RIG)
    calibrations.write_ros(tmp_path, RIG)
    assert find_calibrations(tmp_path, size_px) == ([("left.yaml", "right.yaml")], [])
