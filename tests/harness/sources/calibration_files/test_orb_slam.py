"""Settings of ORB-SLAM2 and 3."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.documents import read_document
from harness.sources.calibration_files.read import Options, find_calibrations, read_cameras
from harness.sources.rectification import RawCalibration
from tests.calibration_formats import assert_rows_match_and_depths_come_back, points_ahead, read_raw, size_px
from tests.calibrations import RIG, Rig, opencv_nodes, write_yaml
from tests.disk import write_text
from vfoa.errors import VfoaError

EUROC = """%YAML:1.0

# Camera calibration and distortion parameters (OpenCV)
Camera.type: "PinHole"
Camera.fx: 435.2046959714599
Camera.fy: 435.2046959714599
Camera.cx: 367.4517211914062
Camera.cy: 252.2008514404297
Camera.k1: 0.0
Camera.width: 752
Camera.height: 480
Camera.fps: 20.0
Camera.bf: 47.90639384423901
ThDepth: 35
"""
LEFT_AND_RIGHT = """LEFT.height: 480
LEFT.width: 752
LEFT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0]
LEFT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [458.654, 0.0, 367.215, 0.0, 457.296, 248.375, 0.0, 0.0, 1.0]
LEFT.R:  !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [0.999966347530033, -0.001422739138722922, 0.008079580483432283, 0.001365741834644127, 0.9999741760894847,
     0.007055629199258132, -0.008089410156878961, -0.007044357138835809, 0.9999424675829176]
LEFT.P:  !!opencv-matrix
   rows: 3
   cols: 4
   dt: d
   data: [435.2046959714599, 0, 367.4517211914062, 0,  0, 435.2046959714599, 252.2008514404297, 0,  0, 0, 1, 0]
RIGHT.height: 480
RIGHT.width: 752
RIGHT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[-0.28368365, 0.07451284, -0.00010473, -3.555907e-05, 0.0]
RIGHT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [457.587, 0.0, 379.999, 0.0, 456.134, 255.238, 0.0, 0.0, 1]
RIGHT.R:  !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [0.9999633526194376, -0.003625811871560086, 0.007755443660172947, 0.003680398547259526, 0.9999684752771629,
     -0.007035845251224894, -0.007729688520722713, 0.007064130529506649, 0.999945173484644]
RIGHT.P:  !!opencv-matrix
   rows: 3
   cols: 4
   dt: d
   data: [435.2046959714599, 0, 367.4517211914062, -47.90639384423901, 0, 435.2046959714599, 252.2008514404297, 0,
     0, 0, 1, 0]
Viewer.PointSize:2
"""
"""ORB-SLAM2's and 3's ``Examples/Stereo/EuRoC.yaml`` without comments and settings of other things."""


@pytest.mark.parametrize("is_raw", [True, False])
def test_orb_slam_s_settings_for_euroc(tmp_path: Path, is_raw: bool) -> None:
    path = write_text(tmp_path / "EuRoC.yaml", EUROC + LEFT_AND_RIGHT * is_raw)
    found = read_cameras([path], lambda: (752, 480))
    assert isinstance(found, RawCalibration) == is_raw
    rectified = found.rectified() if isinstance(found, RawCalibration) else found
    assert (rectified.fx_px, rectified.cx_px, rectified.size_px) == (435.2046959714599, 367.4517211914062, (752, 480))
    assert rectified.baseline_m == pytest.approx(0.110078, abs=1e-6)  # |T| of EuRoC's own files
    if isinstance(found, RawCalibration):
        pose = found.right.r.T @ found.left.r
        k, d = (found.left.k, found.right.k), (found.left.d[:4], found.right.d[:4])
        rotation, shift = cv2.Rodrigues(pose)[0].ravel(), found.right.r.T @ np.array([-rectified.baseline_m, 0, 0])
        rig = Rig(k=k, d=d, rotation_vector=rotation, translation_m=shift)
        assert_rows_match_and_depths_come_back(found, rig, points_ahead(3))


def _stella(document: dict[str, Any], *, is_raw: bool) -> dict[str, dict[str, Any]]:
    """The settings of ORB-SLAM2 as stella_vslam has them: lists of numbers in tables."""
    names = {"bf": "focal_x_baseline", "width": "cols", "height": "rows"}
    kept = {key.removeprefix("Camera."): value for key, value in document.items() if key.startswith("Camera.")}
    camera = {names.get(name, name): value for name, value in kept.items() if name != "type"}
    tables = {
        "Camera": {"name": "EuRoC", "setup": "stereo", "model": "perspective", **camera},
        "Feature": {"name": "a"},
    }
    rectifier = {
        f"{role}_{side}": document[f"{side.upper()}.{role}"].ravel().tolist()
        for side in ("left", "right")
        for role in ("KDR" if is_raw else "")
    }
    return tables | ({"StereoRectifier": rectifier} if is_raw else {})


@pytest.mark.parametrize("are_dotted", [False, True])
@pytest.mark.parametrize("is_raw", [True, False])
def test_stella_vslam_s_settings_are_those_of_orb_slam(tmp_path: Path, *, is_raw: bool, are_dotted: bool) -> None:
    """OpenVSLAM, from which it comes, has ``Camera.fx`` in place of tables."""
    path = write_text(tmp_path / "EuRoC.yaml", EUROC + LEFT_AND_RIGHT * is_raw)
    tables = _stella(read_document(path), is_raw=is_raw)
    dotted = {f"{name}.{inner}": value for name, table in tables.items() for inner, value in table.items()}
    stella = write_yaml(tmp_path / "EuRoC_stereo.yaml", dotted if are_dotted else tables)
    found, expected = (read_cameras([each], size_px) for each in (stella, path))
    assert (found if isinstance(found, Calibration) else found.rectified()) == (
        expected if isinstance(expected, Calibration) else expected.rectified()
    )
    if isinstance(found, RawCalibration) and isinstance(expected, RawCalibration):
        for matrix in "kdrp":
            np.testing.assert_array_equal(getattr(found.right, matrix), getattr(expected.right, matrix))
    (tmp_path / "EuRoC.yaml").unlink()
    assert find_calibrations(tmp_path, lambda: (752, 480)) == ([("EuRoC_stereo.yaml",)], [])


def test_stella_vslam_s_lenses_may_be_fisheye(tmp_path: Path) -> None:
    tables = _stella(read_document(write_text(tmp_path / "a.yaml", EUROC + LEFT_AND_RIGHT)), is_raw=True)
    tables["StereoRectifier"] |= {"model": "fisheye", "D_left": [0.1, 0, 0, 0], "D_right": [0.1, 0, 0, 0]}
    found = read_raw([write_yaml(tmp_path / "b.yaml", tables)])
    assert (found.left.model, found.right.model) == ("equidistant", "equidistant")


@pytest.mark.parametrize(
    ("table", "change", "message"),
    [
        ("Camera", {"setup": "RGBD"}, "Camera.setup: found 'RGBD'"),
        ("Camera", {"cols": None}, "no Camera.width; expected cols and rows"),
        ("StereoRectifier", {"D_left": [1, 2, 3]}, "D: found 3 coefficients"),
    ],
)
def test_stella_vslam_s_settings_of_no_pair_are_refused(
    tmp_path: Path, table: str, change: dict[str, Any], message: str
) -> None:
    tables = _stella(read_document(write_text(tmp_path / "a.yaml", EUROC + LEFT_AND_RIGHT)), is_raw=True)
    tables[table] |= change
    with pytest.raises(VfoaError, match=message):
        read_cameras([write_yaml(tmp_path / "b.yaml", tables)], size_px)


def test_orb_slam_s_settings_for_rectified_cameras(tmp_path: Path) -> None:
    """Numbers of ORB-SLAM3's ``Examples/Stereo/RealSense_D435i.yaml``."""
    lens = {"fx": 382.613, "fy": 382.613, "cx": 320.183, "cy": 236.455}
    lines = ["%YAML:1.0", 'File.version: "1.0"', 'Camera.type: "Rectified"', "Stereo.b: 0.0499585"]
    lines += [*(f"Camera1.{name}: {value}" for name, value in lens.items()), "Camera.width: 640", "Camera.height: 480"]
    path = write_text(tmp_path / "RealSense_D435i.yaml", "\n".join(lines))
    found = read_cameras([path], lambda: pytest.fail("asked"))
    assert isinstance(found, Calibration)
    assert (found.fx_px, found.cx_px, found.cy_px, found.size_px) == (382.613, 320.183, 236.455, (640, 480))
    assert found.baseline_m == pytest.approx(0.0499585)


def test_matrices_of_lenses_beside_orb_slam_s_rectified_camera_count(tmp_path: Path) -> None:
    """Of a script that appends both to ORB-SLAM's settings: the camera alone says that images are rectified."""
    settings = "Camera.fx: 640.0\nCamera.fy: 640.0\nCamera.cx: 600.0\nCamera.cy: 300.0\nCamera.bf: 76.8\n"
    lists = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    path = write_text(tmp_path / "mine.yml", f"{settings}{yaml.safe_dump(lists)}")
    assert_rows_match_and_depths_come_back(read_raw([path]), RIG, points_ahead(6))
    rectified = read_cameras([path], size_px, Options(rectified=True))
    assert isinstance(rectified, Calibration)
    assert (rectified.cx_px, rectified.baseline_m) == (600, pytest.approx(0.12))


def test_lenses_without_what_rectifies_leave_the_rectified_camera(tmp_path: Path) -> None:
    """ORB-SLAM's own values are complete, and OpenCV's are not."""
    lenses = {name: opencv_nodes(RIG)[name].tolist() for name in ("K1", "D1", "K2", "D2")}
    path = write_text(tmp_path / "mine.yml", f"{EUROC}{yaml.safe_dump(lenses)}")
    calibration = read_cameras([path], size_px)
    assert isinstance(calibration, Calibration)
    assert calibration.baseline_m == pytest.approx(0.110, abs=1e-3)
