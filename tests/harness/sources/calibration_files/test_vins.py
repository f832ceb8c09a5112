"""Configurations of VINS-Fusion, and its cameras of camodocal."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from harness.sources.calibration_files.read import Options, find_calibrations, read_cameras
from tests import calibrations
from tests.calibration_formats import read_raw, size_px
from tests.calibrations import RIG
from tests.disk import write_text
from vfoa.errors import VfoaError


@pytest.mark.parametrize(
    ("name", "before", "after", "message"),
    [
        ("vins.yaml", "extrinsic: 0", "extrinsic: 2", r"vins\.yaml: estimate_extrinsic: found 2"),
        ("vins.yaml", "body_T_cam1", "body_T_cam2", r"vins\.yaml: no body_T_cam1; expected"),
        ("vins.yaml", "lens1", "none", r"vins\.yaml: cam1_calib: no file .*none\.yaml"),
        ("lens1.yaml", "PINHOLE", "MEI", r"lens1\.yaml: model_type: found 'MEI'.*PINHOLE"),
        ("lens1.yaml", "   fx:", "   f:", r"lens1\.yaml: projection_parameters: no fx"),
        ("lens0.yaml", "   p2:", "   p3:", r"lens0\.yaml: distortion_parameters: no p2"),
    ],
)
def test_what_is_wrong_in_vins_fusion_s_files_is_named(
    tmp_path: Path, name: str, before: str, after: str, message: str
) -> None:
    path = calibrations.write_vins(tmp_path / "vins.yaml", RIG)
    text = (tmp_path / name).read_text(encoding="utf-8")
    assert before in text
    write_text(tmp_path / name, text.replace(before, after, 1))
    with pytest.raises(VfoaError, match=message):
        read_cameras([path], size_px)
    found, faults = find_calibrations(tmp_path, size_px)
    assert found == []
    assert any(re.search(message, fault) for fault in faults)


def test_the_rational_model_of_camodocal_is_opencv_s(tmp_path: Path) -> None:
    path = calibrations.write_vins(tmp_path / "vins.yaml", RIG)
    expected = np.array([-0.17, 0.03, 0.0004, -0.0003, 0.01, 0.02, -0.03, 0.04])
    for file in tmp_path.glob("lens*.yaml"):
        text = file.read_text(encoding="utf-8").replace("PINHOLE", "PINHOLE_FULL")
        lens = "".join(f"   k{n}: {expected[n + 1]}\n" for n in range(3, 7))
        write_text(file, text.replace("distortion_parameters:\n", f"distortion_parameters:\n{lens}"))
    assert np.array_equal(read_raw([path]).left.d, expected)


def test_poses_that_vins_fusion_refines_need_the_distance_of_the_cameras(tmp_path: Path) -> None:
    """As of its own configuration of a D455, whose poses are 35 mm apart, and the cameras 95 mm."""
    path = calibrations.write_vins(tmp_path / "vins.yaml", RIG)
    write_text(path, path.read_text(encoding="utf-8").replace("extrinsic: 0   # accurate", "extrinsic: 1"))
    with pytest.raises(VfoaError, match=r"vins\.yaml: estimate_extrinsic: found 1: .* first guess.*--baseline METRES"):
        read_cameras([path], size_px)
    assert read_raw([path], Options(baseline_m=0.095)).rectified().baseline_m == pytest.approx(0.095)


def test_cameras_of_camodocal_need_the_configuration_that_names_them(tmp_path: Path) -> None:
    path = calibrations.write_vins(tmp_path / "vins.yaml", RIG)
    with pytest.raises(VfoaError, match=r"vins\.yaml: the baseline is -0\.1199"):
        read_cameras([path], size_px, Options(calibration_cameras=(1, 0)))
    path.unlink()
    found, faults = find_calibrations(tmp_path, size_px)
    assert found == []
    assert all("lens" in fault and "body_T_cam0" in fault for fault in faults)
