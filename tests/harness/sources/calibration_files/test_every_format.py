"""One rig, written as different programs would; every file must give the same rectified pair."""

from __future__ import annotations

import codecs
import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from harness.sources.calibration_files.read import Options, find_calibrations, read_cameras
from harness.sources.rectification import RawCalibration
from tests import calibrations
from tests.calibration_formats import (
    FISHEYE,
    FORMATS,
    assert_rows_match_and_depths_come_back,
    changed,
    kitti_rows,
    points_ahead,
    projection,
    read_raw,
    read_rectified,
    size_px,
)
from tests.calibrations import RIG, SIZE, opencv_nodes, rectification, write_opencv, write_yaml
from tests.disk import write_text
from vfoa.errors import VfoaError


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_found_beside_the_images_and_says_the_same_rig(tmp_path: Path, name: str) -> None:
    """Later coefficients are 0; a byte-order mark, line ends of Windows and capitals change nothing."""
    paths = FORMATS[name](tmp_path / "calibration")
    write_text(tmp_path / "notes.txt", "P2 is at the door")
    write_yaml(tmp_path / "other.yaml", {"K1": 3})
    names = tuple(path.relative_to(tmp_path).as_posix() for path in paths)
    assert find_calibrations(tmp_path, size_px) == ([names], [])
    cameras = read_raw(paths)
    for camera, k, d in zip((cameras.left, cameras.right), RIG.k, RIG.d, strict=True):
        np.testing.assert_allclose(camera.k, k)
        np.testing.assert_allclose(camera.d, [*d, *[0] * 10][: len(camera.d)])
        assert camera.model == "plumb_bob"
    found, expected = cameras.rectified(), rectification(RIG)
    assert found.baseline_m == pytest.approx(np.linalg.norm(RIG.translation_m), rel=1e-6)
    assert (found.fx_px, found.cx_px, found.cy_px) == pytest.approx(expected["P1"][[0, 0, 1], [0, 2, 2]], rel=1e-6)
    assert (found.cx_right_px, found.size_px) == (pytest.approx(found.cx_px), SIZE)
    assert_rows_match_and_depths_come_back(cameras, RIG, points_ahead(0))
    for path in paths:
        path.write_bytes(codecs.BOM_UTF8 + path.read_bytes().replace(b"\n", b"\r\n"))
    loud = [path.rename(path.with_suffix(path.suffix.upper())) for path in paths]
    assert find_calibrations(tmp_path, size_px) == ([tuple(path.relative_to(tmp_path).as_posix() for path in loud)], [])
    assert read_raw(loud).rectified() == found


@pytest.mark.parametrize("suffix", ["yml", "xml"])
def test_what_the_file_tells_and_nobody_needs_is_not_read(tmp_path: Path, suffix: str) -> None:
    """The images' size where the file has it, and numbers that are none among others."""
    errors = np.array([[np.nan, np.inf, -np.inf]])
    path = write_opencv(tmp_path / f"c.{suffix}", opencv_nodes(RIG) | {"errors": errors}, SIZE)
    cameras = read_cameras([path], lambda: pytest.fail("asked"))
    assert isinstance(cameras, RawCalibration)
    assert cameras.left.size_px == SIZE
    path = write_opencv(tmp_path / f"c.{suffix}", opencv_nodes(RIG) | {"T": errors.T}, SIZE)
    with pytest.raises(VfoaError, match=r"T: .*finite"):
        read_cameras([path], size_px)


def test_fisheye_lenses_of_every_program(tmp_path: Path) -> None:
    kalibr = read_raw([calibrations.write_kalibr(tmp_path / "camchain.yaml", FISHEYE)])
    opencv = read_raw([write_opencv(tmp_path / "c.yml", opencv_nodes(FISHEYE), SIZE)], Options(fisheye=True))
    zed = read_raw([calibrations.write_zed(tmp_path / "SN1.conf", FISHEYE)])
    oak = read_raw([calibrations.write_depthai(tmp_path / "oak.json", FISHEYE)])
    orb_slam = read_raw([calibrations.write_orb_slam_3(tmp_path / "mine.yaml", FISHEYE)])
    basalt = read_raw([calibrations.write_basalt(tmp_path / "mine.json", FISHEYE)])
    vins = read_raw([calibrations.write_vins(tmp_path / "vins.yaml", FISHEYE)])
    assert kalibr.rectified() == opencv.rectified()
    for found in (kalibr, zed, oak, orb_slam, basalt, vins):
        assert_rows_match_and_depths_come_back(found, FISHEYE, points_ahead(1))


def test_a_realsense_s_two_cameras_say_what_to_give(tmp_path: Path) -> None:
    lens = {"width": 1280, "height": 720, "fx": 640.0, "fy": 640.0, "ppx": 640.0, "ppy": 360.0}
    cameras = {"left": lens, "right": lens}
    for name, content in (("a.json", cameras), ("b.json", {"intrinsics": cameras})):
        path = write_text(tmp_path / name, json.dumps(content))
        with pytest.raises(VfoaError, match=rf"{name}: found .*left.*--baseline"):
            read_cameras([path], size_px)
    assert len(find_calibrations(tmp_path, size_px)[1]) == 2


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("camera.yaml", "fx: 700.0\nfy: 700.0\ncx: 640.0\ncy: 360.0\n"),
        ("camera_intrinsics.txt", "fx: 700.0\nfy: 700.0\ncx: 640.0\ncy: 360.0\n"),
        ("camera.json", '{"fx": 700, "fy": 700, "cx": 640, "cy": 360, "k1": -0.2, "baseline": 0.12}'),
        ("zed.json", '{"left_camera": {"fx": 700.0, "cx": 640.0}, "baseline_mm": 120}'),
        ("rig.json", '{"K": [[700, 0, 640], [0, 700, 360], [0, 0, 1]], "D": [-0.2, 0, 0, 0], "baseline": 0.12}'),
        ("intrinsics.yaml", "camera_matrix: [700, 0, 640, 0, 700, 360, 0, 0, 1]\ndist_coeffs: [0.1, 0, 0, 0]\n"),
    ],
)
def test_the_numbers_of_one_camera_are_named_with_the_options_for_them(name: str, content: str, tmp_path: Path) -> None:
    """Without a baseline, or with the distortion of a lens, the file does not say that the images are rectified."""
    path = write_text(tmp_path / name, content)
    with pytest.raises(VfoaError, match=rf"{name}: found .* and no matrices of a pair.*--fx --cx --cy and --baseline"):
        read_cameras([path], size_px)
    assert len(find_calibrations(tmp_path, size_px)[1]) == 1


@pytest.mark.parametrize("name", ["opencv yaml", "ros", "kalibr", "zed", "depthai"])
def test_a_calibration_for_another_size_is_named(tmp_path: Path, name: str) -> None:
    paths = FORMATS[name](tmp_path)
    calibrations, (fault,) = find_calibrations(tmp_path, lambda: (64, 48))
    assert calibrations == []
    assert str(paths[0]) in fault


def _kalibr(root: Path, **changes: Any) -> list[Path]:
    """Kalibr's file with changes of the right camera; None: without that key."""
    (path,) = FORMATS["kalibr"](root)
    chain = yaml.safe_load(path.read_text())
    chain["cam1"] = {key: value for key, value in {**chain["cam1"], **changes}.items() if value is not None}
    return [write_yaml(path, chain)]


def _euroc_without_pose(root: Path) -> list[Path]:
    """Both files as a template has them: poses of zeros."""
    pose = {"rows": 4, "cols": 4, "data": [0.0] * 16}
    lens = {"camera_model": "pinhole", "distortion_model": "none", "intrinsics": [700, 700, 640, 360]}
    camera = {**lens, "resolution": list(SIZE), "T_BS": pose}
    return [write_yaml(root / f"cam{number}" / "sensor.yaml", camera) for number in (0, 1)]


def _zed_without_k2(root: Path) -> list[Path]:
    (path,) = FORMATS["zed"](root)
    return [write_text(path, path.read_text().replace("k2=", "k_2="))]


def _mono(text: str) -> Callable[[Path], list[Path]]:
    return lambda root: [write_text(root / "mono.yaml", "%YAML:1.0\n" + text)]


def _two_zeds(root: Path) -> list[Path]:
    return [calibrations.write_zed(root / f"SN{number}.conf", RIG) for number in (1, 2)]


FIRST = Options(calibration_cameras=(0, 1))
IN_COLUMNS = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [-0.12, 0, 0, 1]]
"""A pose by columns."""


@pytest.mark.parametrize(
    ("files", "options", "message"),
    [
        (
            partial(_kalibr, resolution=[640, 400]),
            Options(),
            "a left camera of 1280 x 720 pixels and a right one of 640 x 400",
        ),
        (partial(_kalibr, intrinsics=[1, 2, 3]), Options(), r"cam1: intrinsics: found 3 .*4 finite"),
        (
            partial(_kalibr, distortion_coeffs=[0, 0, 0, np.inf]),
            Options(),
            r"cam1: distortion_coeffs: found inf among 4 .*4 finite",
        ),
        (partial(_kalibr, intrinsics=None), Options(), "cam1: no intrinsics"),
        (partial(_kalibr, distortion_model="fov"), Options(), "cam1: model pinhole-fov"),
        # poses that were not set
        (
            partial(_kalibr, T_cn_cnm1=np.zeros((4, 4)).tolist()),
            Options(calibration_cameras=(1, 0)),
            "T_cn_cnm1: .*zeros",
        ),
        (partial(_kalibr, T_cn_cnm1=np.ones((4, 4)).tolist()), Options(), "cam1: T_cn_cnm1: found .*a rotation"),
        (partial(_kalibr, T_cn_cnm1=IN_COLUMNS), Options(), "cam1: T_cn_cnm1: found .*by rows"),
        (_euroc_without_pose, Options(), r"sensor\.yaml: T_BS: found zeros \(not set\)"),
        (_zed_without_k2, Options(), r"SN1\.conf: .*K2: found None"),
        (changed("orb-slam 3", '"PinHole"', '"Pinhole"'), Options(), r"Camera\.type: no 'Pinhole'.*PinHole"),
        (changed("orb-slam 3", "Camera2.fx", "Camera2.f"), Options(), r"no Camera2\.fx; expected two cameras"),
        (changed("orb-slam 3", "Camera1.cy: ", "Camera1.cy: a"), Options(), r"Camera1\.cy: found 'a"),
        (changed("orb-slam 2", "RIGHT.P", "RIGHT.Q"), Options(), r"no RIGHT\.P"),
        (_mono("Camera.fx: 500"), Options(), r"no Camera\.bf"),
        (
            _mono("Camera.fx: 5\nCamera.fy: 5\nCamera.cx: 5\nCamera.cy: 5\nCamera.bf: 1\nCamera.k1: 0.1"),
            Options(),
            "LEFT",
        ),
        (changed("basalt", "pinhole-radtan8", "ds"), Options(), r"camera 0: camera_type: no 'ds'"),
        (changed("basalt", '"qw"', '"q"'), Options(), r"T_imu_cam: no qw"),
        (FORMATS["basalt"], Options(calibration_cameras=(0, 2)), r"no camera 2; found 2 cameras"),
        (
            changed("basalt", '"T_imu_cam": [', '"T_imu_cam": 1, "other": ['),
            Options(),
            r"no camera 0; found 0 cameras",
        ),
        (FORMATS["orb-slam 3"], FIRST, r"calibration_cameras: found \(0, 1\)"),
        (_two_zeds, Options(), r"SN2\.conf: a second "),
        # what means nothing for a file
        (FORMATS["opencv yaml"], FIRST, r"c\.yml: calibration_cameras: found \(0, 1\)"),
        (FORMATS["zed"], FIRST, r"SN1\.conf: calibration_cameras: found"),
        (FORMATS["ros"], Options(fisheye=True), r"right\.yaml: fisheye: found true"),
        (FORMATS["kalibr"], Options(fisheye=True), r"camchain\.yaml: fisheye: found true"),
        (FORMATS["depthai"], Options(rectified=True), r"oak\.json: rectified: found true"),
    ],
)
def test_cameras_and_options_that_are_wrong_are_named(
    tmp_path: Path, files: Callable[[Path], list[Path]], options: Options, message: str
) -> None:
    with pytest.raises(VfoaError, match=message):
        read_cameras(files(tmp_path), size_px, options)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("c.txt", "P2: 1 2 3\n", ":1: found '1 2 3'; expected 12 numbers"),
        ("c.txt", "P0: 1\nP2: 1 x\n", ":2: found '1 x'; expected 12 numbers"),
        ("c.txt", "nothing\n", ": no line P2: or P_rect_02:"),
        ("c.txt", kitti_rows(projection(50, 30), projection(50, 30, 5)), r": .*baseline is -0\.1 m"),
        ("c.txt", kitti_rows(projection(50, 30), projection(50, 30)), ": .*baseline is 0 m"),
        ("c.txt", kitti_rows(projection(50, 30), projection(51, 30, -5)), ": .*fx is 50 left and 51 right"),
        ("c.txt", kitti_rows(projection(-50, 30), projection(-50, 30, -5)), ": .*positive focal lengths"),
        ("c.yml", "%YAML:1.0\n---\na: 1\n", r": .*K1 D1 K2 D2 with R T"),
        ("c.yml", "%YAML:1.0\n---\na: [1,\n", ":4: not YAML: "),
        ("c.yml", "a: [1,\n", ":2: not YAML"),
        ("c.yml", "", ": not a table of names"),
        ("c.yml", "K1: {rows: 3}", r": K1: found \{'rows': 3\}"),
        ("c.yml", "K1: [1, x]", r": K1: found \[1, 'x'\]"),
        ("c.yml", "K1: !!opencv-matrix [1, 2]", ":1: not YAML: .*opencv-matrix"),
        ("c.yml", "K1: [1]\nM1: [1]", ": K1 and M1 both are K1"),
        ("c.yml", "K1: [1]\nD1: [1]\nxi1: [2.5]", r": xi1: found a camera of cv2\.omnidir"),
        ("c.json", '{"left": {"K": [1], "xi": 2.5}}', r": left_xi: found a camera of cv2\.omnidir"),
        (
            "c.xml",
            '<s><K1 type_id="opencv-matrix"><rows>3</rows><cols>3</cols><data>1 2</data></K1></s>',
            ": .*opencv-matrix .*rows x cols",
        ),
        ("c.xml", "<a>", ":1: not XML: "),
        ("c.xml", '<?xml version="1.0" encoding="klingon"?><a/>', ":1: not XML: .*klingon"),
        ("c.xml", '<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hostname">]><a>&b;</a>', ":1: not XML: undefined"),
        ("c.conf", "fx=1", ": cannot be parsed"),
        ("c.conf", "[STEREO]\nBaseline=120\n", r": .*64 x 48 pixels.*ZED's: "),
        ("c.yaml", "cam0: {camera_model: omni, distortion_model: radtan}", ": .*cam0: model omni-radtan"),
        ("c.json", '{"mtxL": [1], "kL": 2, "rotMat": 3}', r": mtxL and kL both are K1"),
        ("c.json", '{"mtxL": [1], "rotMat": 3, "rms": 1}', r": found K1 \(and, not known, rotMat, rms\); expected K1"),
        (
            "c.yaml",
            "".join(f"K{n}: [90, 0, 32, 0, 90, 24, 0, 0, 1]\nD{n}: [0, 0, 0, 0]\n" for n in "12")
            + "R: [0.346, 0.202, -0.214]\nT: [-0.1, 0, 0]\n",  # of OpenCV's chessboard pictures, in degrees
            r": R: found a rotation vector of length 0\.454; expected radians, at most .* differ by 26 degrees",
        ),
        (
            "c.yaml",
            "".join(f"P{n}: [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]\n" for n in "12"),
            ": found none of them, and zeros or nothing as P1, P2; expected K1",
        ),
        ("c.yaml", "camera_matrix: 1\nprojection_matrix: 2", ": one camera of ROS; expected the pair"),
    ],
)
def test_files_that_are_no_calibration_are_one_line(tmp_path: Path, name: str, content: str, message: str) -> None:
    with pytest.raises(VfoaError, match=re.escape(name) + message) as error:
        read_rectified(write_text(tmp_path / name, content))
    assert "\n" not in str(error.value)
