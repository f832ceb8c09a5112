"""One rig, written as different programs would; every file must give the same rectified pair."""

from __future__ import annotations

import codecs
import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.read import METRES, Options, Unit, find_calibrations, read_cameras
from harness.sources.rectification import RawCalibration, RawCamera, Rectifier, rectify_pose
from tests import calibrations
from tests.calibrations import RIG, SIZE, Rig, opencv_nodes, rectification, write_opencv, write_yaml
from tests.disk import write_text
from vfoa.errors import VfoaError
from vfoa.types import Float

SPELLED = {"K1": "cameraMatrix1", "D1": "distCoeffs1", "K2": "cameraMatrix2", "D2": "distCoeffs2", "R": "R", "T": "T"}
SIDED = {"K1": "camera_matrix_left", "D1": "dist_left", "K2": "camera_matrix_right", "D2": "dist_right"}
SHORTENED = {"K1": "camera_mat_left", "D1": "distortion_left", "K2": "camera_mat_right", "D2": "distortion_right"} | {
    "R": "rotation_mat",
    "T": "translation_vec",
}
POSED = SIDED | {"R": "Stereo_Rotation", "T": "stereo_translation"}
FISHEYE = replace(
    RIG, model="equidistant", d=(np.array([0.02, -0.01, 0.004, -0.001]), np.array([0.025, -0.008, 0.003, -0.002]))
)


def _size() -> tuple[int, int]:
    return SIZE


def _renamed(nodes: dict[str, Float], names: dict[str, str]) -> dict[str, Float]:
    return {names.get(name, name): value for name, value in nodes.items()}


def _sample(root: Path) -> list[Path]:
    """The two files of OpenCV's own stereo calibration sample; neither tells the size."""
    nodes = _renamed(opencv_nodes(RIG), {"K1": "M1", "K2": "M2"})
    inner = {name: value for name, value in nodes.items() if name[-1] in "12"}
    outer = {"R": nodes["R"], "T": nodes["T"], **rectification(RIG), "Q": np.eye(4)}
    return [write_opencv(root / "intrinsics.yml", inner), write_opencv(root / "extrinsics.yml", outer)]


def _lists(root: Path) -> list[Path]:
    nodes = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    return [write_yaml(root / "c.yaml", {**nodes, "image_size": list(SIZE), "rms": 0.3})]


def _as_text(path: Path) -> Path:
    return path.rename(path.with_suffix(".txt"))


def _below(root: Path) -> Path:
    root.mkdir(parents=True, exist_ok=True)
    return root


def _as_d_robotics(root: Path, *, is_rational: bool) -> Path:
    """Their chain in a table, or with OpenCV's rational model, and then without camera_model."""
    chain = yaml.safe_load(calibrations.write_kalibr(root / "c.yaml", RIG).read_text(encoding="utf-8"))
    if not is_rational:
        return write_yaml(root / "c.yaml", {"stereo0": chain})
    for camera in chain.values():
        del camera["camera_model"]
        camera |= {"distortion_model": "rational_polynomial"}
        camera["distortion_coeffs"] += [0.0] * (8 - len(camera["distortion_coeffs"]))
    return write_yaml(root / "c.yaml", chain)


NOT_COMPUTED = {"R1": np.zeros((3, 3)), "R2": np.zeros((3, 3)), "P1": np.zeros((3, 4)), "P2": np.zeros((3, 4))}
"""What a program writes for a rectification that it did not compute."""

FORMATS: dict[str, Callable[[Path], list[Path]]] = {
    "opencv yaml": lambda root: [write_opencv(root / "c.yml", opencv_nodes(RIG), SIZE)],
    "opencv xml": lambda root: [write_opencv(root / "c.xml", _renamed(opencv_nodes(RIG), SPELLED))],
    "opencv yaml, as text": lambda root: [_as_text(write_opencv(root / "c.yml", opencv_nodes(RIG), SIZE))],
    "opencv xml, as text": lambda root: [_as_text(write_opencv(root / "c.xml", opencv_nodes(RIG), SIZE))],
    "opencv json, as text": lambda root: [_as_text(write_opencv(root / "c.json", opencv_nodes(RIG), SIZE))],
    "opencv by sides": lambda root: [write_opencv(root / "c.yml", _renamed(opencv_nodes(RIG), SIDED), SIZE)],
    "opencv, shortened": lambda root: [write_opencv(root / "c.yml", _renamed(opencv_nodes(RIG), SHORTENED), SIZE)],
    "opencv, a stereo pose": lambda root: [write_opencv(root / "c.yml", _renamed(opencv_nodes(RIG), POSED), SIZE)],
    "opencv rectified": lambda root: [write_opencv(root / "c.yml", opencv_nodes(RIG) | rectification(RIG), SIZE)],
    "opencv not rectified": lambda root: [write_opencv(root / "c.yml", opencv_nodes(RIG) | NOT_COMPUTED, SIZE)],
    "opencv's sample": _sample,
    "rotation vector": lambda root: [write_opencv(root / "c.yml", opencv_nodes(RIG) | {"R": RIG.rotation_vector})],
    "plain lists": _lists,
    "ros": lambda root: calibrations.write_ros(root, RIG),
    "ros 1, echo": lambda root: calibrations.write_ros_echo(root, RIG, is_ros_2=False),
    "ros 2, echo": lambda root: calibrations.write_ros_echo(root, RIG, is_ros_2=True),
    "ros, ost.txt": lambda root: [calibrations.write_ros_text(root / "ost.txt", RIG)],
    "ros, two .ini": lambda root: calibrations.write_ros_ini(root, RIG),
    "kalibr": lambda root: [calibrations.write_kalibr(root / "camchain.yaml", RIG)],
    "zed": lambda root: [calibrations.write_zed(root / "SN1.conf", RIG)],
    "depthai": lambda root: [calibrations.write_depthai(root / "oak.json", RIG)],
    "orb-slam 2": lambda root: [calibrations.write_orb_slam_2(root / "mine.yaml", RIG)],
    "orb-slam 3": lambda root: [calibrations.write_orb_slam_3(root / "mine.yaml", RIG)],
    "kalibr, as D-Robotics nests it": lambda root: [_as_d_robotics(root, is_rational=False)],
    "kalibr, as D-Robotics converts it": lambda root: [_as_d_robotics(root, is_rational=True)],
    "openvins": lambda root: [calibrations.write_openvins(root / "camchain.yaml", RIG)],
    "kalibr, in the imu's frame": lambda root: [
        calibrations.write_openvins(root / "camchain.yaml", RIG, is_inverse=True)
    ],
    "vins-fusion": lambda root: [calibrations.write_vins(root / "mine_config.yaml", RIG)],
    "basalt": lambda root: [calibrations.write_basalt(root / "mine.json", RIG)],
    "icub": lambda root: [calibrations.write_icub(root / "outputCalib.ini", RIG)],
    "opencv lists, yaml": lambda root: [calibrations.write_opencv_lists(_below(root) / "c.yml", RIG)],
    "opencv lists, xml": lambda root: [calibrations.write_opencv_lists(_below(root) / "c.xml", RIG)],
    "opencv lists, json": lambda root: [calibrations.write_opencv_lists(_below(root) / "c.json", RIG)],
    "matlab": lambda root: [calibrations.write_matlab(root / "mine.json", RIG)],
    "matlab's matrices": lambda root: [calibrations.write_matlab_matrices(root / "mine.yml", RIG)],
    "matlab for opencv": lambda root: [calibrations.write_matlab_for_opencv(root / "mine.json", RIG)],
}


def _raw(paths: list[Path], options: Options = Options()) -> RawCalibration:  # noqa: B008
    cameras = read_cameras(paths, _size, options)
    assert isinstance(cameras, RawCalibration)
    return cameras


def _rectified_points(camera: RawCamera, pixels: Float) -> Float:
    """Positions of pixels (N, 2) after rectification."""
    undistort = cv2.fisheye.undistortPoints if camera.model == "equidistant" else cv2.undistortPoints
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
    found = undistort(pixels[:, None], camera.k, camera.d, R=camera.r, P=camera.p, criteria=stop)
    return np.asarray(found[:, 0], dtype=np.float64)


def _assert_rows_match_and_depths_come_back(cameras: RawCalibration, rig: Rig, points: Float) -> None:
    left, right = (
        _rectified_points(camera, pixels)
        for camera, pixels in zip((cameras.left, cameras.right), rig.project(points), strict=True)
    )
    calibration = cameras.rectified()
    depth = (points @ cameras.left.r.T)[:, 2]
    disparity = left[:, 0] - right[:, 0] + calibration.cx_right_px - calibration.cx_px
    assert np.abs(left[:, 1] - right[:, 1]).max() < 1e-3
    assert np.abs(disparity - calibration.fx_px * calibration.baseline_m / depth).max() < 1e-3


def _points(seed: int, count: int = 40) -> Float:
    """Points within half a metre of the axis, one to five metres away."""
    random = np.random.default_rng(seed)
    depth = random.uniform(1, 5, (count, 1))
    return np.hstack([random.uniform(-0.4, 0.4, (count, 2)) * depth, depth])


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_found_beside_the_images_and_says_the_same_rig(tmp_path: Path, name: str) -> None:
    """Later coefficients are 0; a byte-order mark, line ends of Windows and capitals change nothing."""
    paths = FORMATS[name](tmp_path / "calibration")
    write_text(tmp_path / "notes.txt", "P2 is at the door")
    write_yaml(tmp_path / "other.yaml", {"K1": 3})
    names = tuple(path.relative_to(tmp_path).as_posix() for path in paths)
    assert find_calibrations(tmp_path, _size) == ([names], [])
    cameras = _raw(paths)
    for camera, k, d in zip((cameras.left, cameras.right), RIG.k, RIG.d, strict=True):
        np.testing.assert_allclose(camera.k, k)
        np.testing.assert_allclose(camera.d, [*d, *[0] * 10][: len(camera.d)])
        assert camera.model == "plumb_bob"
    found, expected = cameras.rectified(), rectification(RIG)
    assert found.baseline_m == pytest.approx(np.linalg.norm(RIG.translation_m), rel=1e-6)
    assert (found.fx_px, found.cx_px, found.cy_px) == pytest.approx(expected["P1"][[0, 0, 1], [0, 2, 2]], rel=1e-6)
    assert (found.cx_right_px, found.size_px) == (pytest.approx(found.cx_px), SIZE)
    _assert_rows_match_and_depths_come_back(cameras, RIG, _points(0))
    for path in paths:
        path.write_bytes(codecs.BOM_UTF8 + path.read_bytes().replace(b"\n", b"\r\n"))
    loud = [path.rename(path.with_suffix(path.suffix.upper())) for path in paths]
    assert find_calibrations(tmp_path, _size) == ([tuple(path.relative_to(tmp_path).as_posix() for path in loud)], [])
    assert _raw(loud).rectified() == found


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
        read_cameras([path], _size)


@pytest.mark.parametrize("rig", [RIG, FISHEYE], ids=["plumb bob", "fisheye"])
def test_a_rectified_pair_shows_only_what_both_cameras_saw(rig: Rig) -> None:
    """A white world leaves no black border."""
    bent = tuple(np.array([-0.15, 0.02, 0, 0]) for _ in range(2))
    lenses = (RawCamera(size_px=SIZE, k=k, d=d, model=rig.model) for k, d in zip(rig.k, bent, strict=True))  # type: ignore[arg-type]
    cameras = rectify_pose(*lenses, rig.rotation, rig.translation_m, "rig")
    white = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    for view in Rectifier(cameras).rectify(white, white):
        assert (view[2:-2, 2:-2] == 255).mean() > 0.995


@pytest.mark.parametrize("turned_deg", [(0, 0, 0), (0.3, 0.2, -0.1), (1, 2, 1), (4, 8, -5)])
@pytest.mark.parametrize("translation_m", [(-0.064, 0, 0), (-0.2, 0.02, 0.03)])
def test_the_view_of_wide_fisheye_lenses_is_about_the_axis(
    turned_deg: tuple[float, ...], translation_m: tuple[float, ...]
) -> None:
    """Lenses of 80 degrees and more to each side, as of a RealSense T265, where OpenCV's view is beside the images."""
    k = tuple(calibrations.matrix(fx, fx, *middle) for fx, middle in ((428, (631, 365.0)), (427, (645, 355.0))))
    d = tuple(np.array([k1, 0.0387, -0.0365, 0.0059]) for k1 in (-0.0049, -0.0035))
    turn = np.radians(turned_deg)
    rig = Rig(k=k, d=d, rotation_vector=turn, translation_m=np.array(translation_m), model="equidistant")  # type: ignore[arg-type]
    lenses = (RawCamera(size_px=SIZE, k=k, d=d, model="equidistant") for k, d in zip(rig.k, rig.d, strict=True))
    cameras = rectify_pose(*lenses, rig.rotation, rig.translation_m, "rig")
    found = cameras.rectified()
    assert (found.cx_px, found.cy_px, found.cx_right_px) == ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, (SIZE[0] - 1) / 2)
    assert found.baseline_m == pytest.approx(np.linalg.norm(translation_m))
    assert 0.5 * 428 < found.fx_px < 428
    _assert_rows_match_and_depths_come_back(cameras, rig, _points(0) @ cameras.left.r)
    white = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    for view in Rectifier(cameras).rectify(white, white):
        assert (view[2:-2, 2:-2] == 255).mean() > 0.9  # corners lie beyond the middles of the edges


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"left": RawCamera(size_px=SIZE, k=np.zeros((3, 3)), d=RIG.d[0])}, "left: K: found focal lengths"),
        ({"right": RawCamera(size_px=SIZE, k=np.eye(2), d=RIG.d[0])}, "right: K: found shape"),
        ({"right": RawCamera(size_px=SIZE, k=RIG.k[1], d=np.zeros(3))}, "right: D: found 3 "),
        (
            {"right": RawCamera(size_px=SIZE, k=RIG.k[1], d=RIG.d[1], model="equidistant")},
            "left is plumb_bob, right equidistant",
        ),
        ({"rotation": np.ones((3, 3))}, "R: not a rotation"),
        ({"translation": np.zeros(3)}, r"T: found \[0.0, 0.0, 0.0\]"),
        ({"translation": np.array([-0.1, np.nan, 0])}, r"T: found .*nan"),
        ({"translation": np.array([-0.1, 0])}, r"T: found .* three"),
        ({"translation": np.array([0.01, -0.1, 0])}, r"T: .* above each other"),
        ({"translation": np.array([0.01, 0.1, 0])}, r"T: .* above each other"),
        ({"translation": np.array([0.1, 0.01, 0])}, "expected a positive one"),
        ({"translation": np.array([-0.1, 0.02, 0.15])}, r"T: .* one behind the other.*failed"),  # of few boards
    ],
)
def test_cameras_that_are_no_pair_side_by_side_are_refused(changes: dict[str, Any], message: str) -> None:
    left, right = (RawCamera(size_px=SIZE, k=k, d=d) for k, d in zip(RIG.k, RIG.d, strict=True))
    given = {"left": left, "right": right, "rotation": np.eye(3), "translation": RIG.translation_m, **changes}
    with pytest.raises(VfoaError, match=message):
        rectify_pose(**given, where="rig")


@pytest.mark.parametrize("along_m", [-0.01, 0.01])
def test_fisheye_lenses_above_each_other_are_refused(along_m: float) -> None:
    """OpenCV would turn their images by a quarter."""
    left, right = (RawCamera(size_px=SIZE, k=k, d=d, model="equidistant") for k, d in zip(RIG.k, RIG.d, strict=True))
    with pytest.raises(VfoaError, match=r"T: .* above each other"):
        rectify_pose(left, right, np.eye(3), np.array([along_m, -0.1, 0]), "rig")


def test_fisheye_lenses_of_every_program(tmp_path: Path) -> None:
    kalibr = _raw([calibrations.write_kalibr(tmp_path / "camchain.yaml", FISHEYE)])
    opencv = _raw([write_opencv(tmp_path / "c.yml", opencv_nodes(FISHEYE), SIZE)], Options(fisheye=True))
    zed = _raw([calibrations.write_zed(tmp_path / "SN1.conf", FISHEYE)])
    oak = _raw([calibrations.write_depthai(tmp_path / "oak.json", FISHEYE)])
    orb_slam = _raw([calibrations.write_orb_slam_3(tmp_path / "mine.yaml", FISHEYE)])
    basalt = _raw([calibrations.write_basalt(tmp_path / "mine.json", FISHEYE)])
    vins = _raw([calibrations.write_vins(tmp_path / "vins.yaml", FISHEYE)])
    assert kalibr.rectified() == opencv.rectified()
    for found in (kalibr, zed, oak, orb_slam, basalt, vins):
        _assert_rows_match_and_depths_come_back(found, FISHEYE, _points(1))


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
        _assert_rows_match_and_depths_come_back(found, rig, _points(3))


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
    assert _raw([path]).left.d.tolist() == expected


def test_a_message_of_a_part_of_the_sensor_is_of_that_part(tmp_path: Path) -> None:
    paths = calibrations.write_ros_echo(tmp_path, RIG, is_ros_2=True)
    whole = _raw(paths)
    for path in paths:
        text = path.read_text(encoding="utf-8").replace("binning_x: 0", "binning_x: 2")
        write_text(path, text.replace("y_offset: 0", "y_offset: 40"))
    part, (width, height) = _raw(paths), whole.left.size_px
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
        read_cameras([path], _size)
    assert str(error.value).startswith(str(path))
    assert find_calibrations(tmp_path, _size) == ([], [str(error.value)])


def test_ros_s_text_beside_the_files_of_both_cameras_is_no_second_calibration(tmp_path: Path) -> None:
    calibrations.write_ros_text(tmp_path / "ost.txt", RIG)
    calibrations.write_ros(tmp_path, RIG)
    assert find_calibrations(tmp_path, _size) == ([("left.yaml", "right.yaml")], [])


def test_an_oak_whose_extrinsics_were_never_set_is_refused(tmp_path: Path) -> None:
    def unset(found: Any) -> None:
        for number in (1, 2):
            found["cameraData"][number][1]["extrinsics"].update(rotationMatrix=[[0] * 3] * 3, toCameraSocket=0)

    with pytest.raises(VfoaError, match=r"oak\.json: camera 2: extrinsics: found zeros"):
        read_cameras(_depthai(tmp_path, unset), _size)


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
        read_cameras([path], _size)
    found, faults = find_calibrations(tmp_path, _size)
    assert found == []
    assert any(re.search(message, fault) for fault in faults)


def test_the_rational_model_of_camodocal_is_opencv_s(tmp_path: Path) -> None:
    path = calibrations.write_vins(tmp_path / "vins.yaml", RIG)
    expected = np.array([-0.17, 0.03, 0.0004, -0.0003, 0.01, 0.02, -0.03, 0.04])
    for file in tmp_path.glob("lens*.yaml"):
        text = file.read_text(encoding="utf-8").replace("PINHOLE", "PINHOLE_FULL")
        lens = "".join(f"   k{n}: {expected[n + 1]}\n" for n in range(3, 7))
        write_text(file, text.replace("distortion_parameters:\n", f"distortion_parameters:\n{lens}"))
    assert np.array_equal(_raw([path]).left.d, expected)


def test_a_realsense_s_two_cameras_say_what_to_give(tmp_path: Path) -> None:
    lens = {"width": 1280, "height": 720, "fx": 640.0, "fy": 640.0, "ppx": 640.0, "ppy": 360.0}
    cameras = {"left": lens, "right": lens}
    for name, content in (("a.json", cameras), ("b.json", {"intrinsics": cameras, "baseline": 0.05})):
        path = write_text(tmp_path / name, json.dumps(content))
        with pytest.raises(VfoaError, match=rf"{name}: found .*left.*--baseline"):
            read_cameras([path], _size)
    assert len(find_calibrations(tmp_path, _size)[1]) == 2


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("camera.yaml", "fx: 700.0\nfy: 700.0\ncx: 640.0\ncy: 360.0\nbaseline: 0.12\n"),
        ("zed.json", '{"left_camera": {"fx": 700.0, "cx": 640.0}, "baseline_mm": 120}'),
        ("rig.json", '{"K": [[700, 0, 640], [0, 700, 360], [0, 0, 1]], "baseline": 0.12}'),
        ("intrinsics.yaml", "camera_matrix: [700, 0, 640, 0, 700, 360, 0, 0, 1]\ndist_coeffs: [0.1, 0, 0, 0]\n"),
    ],
)
def test_the_numbers_of_one_camera_are_named_with_the_options_for_them(name: str, content: str, tmp_path: Path) -> None:
    """As people's scripts write them for depth from rectified images; the file alone does not say that they are."""
    path = write_text(tmp_path / name, content)
    with pytest.raises(VfoaError, match=rf"{name}: found .* and no matrices of a pair.*--fx --cx --cy and --baseline"):
        read_cameras([path], _size)
    assert len(find_calibrations(tmp_path, _size)[1]) == 1


def test_poses_that_vins_fusion_refines_need_the_distance_of_the_cameras(tmp_path: Path) -> None:
    """As of its own configuration of a D455, whose poses are 35 mm apart, and the cameras 95 mm."""
    path = calibrations.write_vins(tmp_path / "vins.yaml", RIG)
    write_text(path, path.read_text(encoding="utf-8").replace("extrinsic: 0   # accurate", "extrinsic: 1"))
    with pytest.raises(VfoaError, match=r"vins\.yaml: estimate_extrinsic: found 1: .* first guess.*--baseline METRES"):
        read_cameras([path], _size)
    assert _raw([path], Options(baseline_m=0.095)).rectified().baseline_m == pytest.approx(0.095)


def test_cameras_of_camodocal_need_the_configuration_that_names_them(tmp_path: Path) -> None:
    path = calibrations.write_vins(tmp_path / "vins.yaml", RIG)
    with pytest.raises(VfoaError, match=r"vins\.yaml: the baseline is -0\.1199"):
        read_cameras([path], _size, Options(calibration_cameras=(1, 0)))
    path.unlink()
    found, faults = find_calibrations(tmp_path, _size)
    assert found == []
    assert all("lens" in fault and "body_T_cam0" in fault for fault in faults)


def test_kalibr_s_chain_is_followed_and_turned_round(tmp_path: Path) -> None:
    """cam0 stands right of cam1, which stands right of cam2, 0.1 m each, so that cam2 and cam0 are 0.2 m apart."""
    step = np.eye(4)
    step[0, 3] = 0.1  # x_cam1 = x_cam0 + 0.1: cam1 is to the left
    camera = {"camera_model": "pinhole", "intrinsics": [500, 500, 320, 240], "resolution": [640, 480]}
    camera |= {"distortion_model": "none", "distortion_coeffs": []}
    left_of = {**camera, "T_cn_cnm1": step.tolist()}
    path = write_yaml(tmp_path / "chain.yaml", {"cam0": camera, "cam1": left_of, "cam2": left_of})
    assert _raw([path], Options(calibration_cameras=(1, 0))).rectified().baseline_m == pytest.approx(0.1)
    assert _raw([path], Options(calibration_cameras=(2, 0))).rectified().baseline_m == pytest.approx(0.2)
    with pytest.raises(VfoaError, match=r"chain\.yaml: the baseline is -0\.1 m"):
        read_cameras([path], _size)
    with pytest.raises(VfoaError, match=r"no cam3; .*cam0, cam1, cam2"):
        read_cameras([path], _size, Options(calibration_cameras=(3, 0)))


@pytest.mark.parametrize("write", [calibrations.write_matlab_for_opencv, calibrations.write_toolbox])
def test_small_matrices_of_matlab_s_own_files_are_read(tmp_path: Path, write: Callable[[Path, Rig], Path]) -> None:
    cameras = _raw([write(tmp_path / "data" / "mine.mat", RIG)])
    assert cameras.left.size_px == SIZE
    _assert_rows_match_and_depths_come_back(cameras, RIG, _points(5))
    assert find_calibrations(tmp_path, _size) == ([("data/mine.mat",)], [])


@pytest.mark.parametrize("unit", ["m", "cm", "mm"])
def test_a_unit_that_is_said_replaces_that_of_matlab_s_file(tmp_path: Path, unit: Unit) -> None:
    """MATLAB writes millimetres wherever nobody has said the unit of the board's squares."""
    path = calibrations.write_matlab(tmp_path / "c.json", RIG)
    expected = 1000 * METRES[unit] * np.linalg.norm(RIG.translation_m)
    assert _raw([path], Options(calibration_unit=unit)).rectified().baseline_m == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("number", "values", "message"),
    [
        (None, {"RotationOfCamera2": None}, "no RotationOfCamera2"),
        (None, {"CameraParameters2": None}, "no CameraParameters2"),
        (2, {"IntrinsicMatrix": None}, "camera 2: no IntrinsicMatrix"),
        (1, {"RadialDistortion": [0.1]}, "camera 1: .*found 1 radial and 2 tangential coefficients"),
        (1, {"K": [700, 3, 630, 0, 700, 360, 0, 0, 1]}, "left: K: .*skew of 3 px"),
    ],
)
def test_what_is_wrong_in_matlab_s_file_is_named(
    tmp_path: Path, number: int | None, values: dict[str, Any], message: str
) -> None:
    struct = calibrations.matlab_struct(RIG)
    changed = struct if number is None else struct[f"CameraParameters{number}"]
    changed.update(values)
    for name in [name for name, value in values.items() if value is None]:
        del changed[name]
    with pytest.raises(VfoaError, match=message) as error:
        _raw([write_text(tmp_path / "c.json", json.dumps(struct))])
    assert str(error.value).startswith(str(tmp_path / "c.json"))


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("c.yml", lambda path, rig: calibrations.write_opencv(path, calibrations.opencv_nodes(rig))),
        ("c.json", calibrations.write_matlab),
        ("c.json", calibrations.write_matlab_for_opencv),
        ("Calib_Results_stereo.mat", calibrations.write_toolbox),
        ("K.txt", lambda path, rig: write_text(path, " ".join(map(str, rig.k[1].ravel())) + "\n0.12\n")),
    ],
)
def test_oblique_axes_are_refused_because_opencv_ignores_them(
    tmp_path: Path, name: str, write: Callable[[Path, calibrations.Rig], Path]
) -> None:
    skew = np.array([[0.0, 8, 0], [0, 0, 0], [0, 0, 0]])
    path = write(tmp_path / name, replace(RIG, k=(RIG.k[0], RIG.k[1] + skew)))
    with pytest.raises(VfoaError, match=rf"{name}.*skew of 8 px"):
        read_cameras([path], _size)


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
        read_cameras([path], _size)
    assert str(error.value).startswith(str(path))
    assert find_calibrations(tmp_path, _size) == ([], [str(error.value)])


@pytest.mark.parametrize(
    "size",
    [
        {"image_size": {"width": 1280, "height": 720}},
        {"imageSizeWidth": 1280, "imageSizeHeight": 720},
        {"resolution": "1280x720"},
        {"image_shape": [720, 1280, 3]},
    ],
)
def test_the_size_that_a_file_says_is_that_of_its_calibration(tmp_path: Path, size: dict[str, Any]) -> None:
    """Images of half the size must not be rectified by the matrices as they are."""
    lists = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    path = write_text(tmp_path / "c.json", json.dumps(lists | size))
    assert _raw([path]).left.size_px == SIZE


def test_cameras_0_and_1_are_a_pair(tmp_path: Path) -> None:
    nodes = opencv_nodes(RIG)
    from_0 = {f"{name[0]}{int(name[1]) - 1}" if name[1:] else name: value for name, value in nodes.items()}
    found, expected = (_raw([write_opencv(tmp_path / "c.yml", each)]) for each in (from_0, nodes))
    assert (found.left, found.right) == (expected.left, expected.right)
    with pytest.raises(VfoaError, match="three cameras"):
        _raw([write_opencv(tmp_path / "c.yml", from_0 | nodes)])


def test_a_camera_matrix_of_rows_times_matrices_is_refused(tmp_path: Path) -> None:
    nodes = opencv_nodes(RIG)
    path = write_opencv(tmp_path / "c.yml", nodes | {"K1": nodes["K1"].T, "K2": nodes["K2"].T})
    with pytest.raises(VfoaError, match=r"left: K: found .*expected \[fx 0 cx; 0 fy cy; 0 0 1\]"):
        _raw([path])


def test_a_camera_matrix_that_was_computed_is_read(tmp_path: Path) -> None:
    nodes = opencv_nodes(RIG)
    path = write_opencv(tmp_path / "c.yml", nodes | {"K1": nodes["K1"] + 1e-13 * np.ones((3, 3))}, SIZE)
    _assert_rows_match_and_depths_come_back(_raw([path]), RIG, _points(6))


def test_a_matrix_without_numbers_is_not_set(tmp_path: Path) -> None:
    """As cv2.FileStorage writes a Mat that nobody filled: the right lens would be one without distortion."""
    path = write_opencv(tmp_path / "c.yml", opencv_nodes(RIG) | {"D2": np.zeros((0, 0))})
    with pytest.raises(VfoaError, match=r"c\.yml: found D1, K1, K2, R, T, and zeros or nothing as D2; expected K1 D1"):
        _raw([path])


@pytest.mark.parametrize("said", [{"fisheye": True}, {"camera_model": "fisheye"}, {"distortion_model": "equidistant"}])
def test_a_file_that_says_so_is_of_fisheye_lenses(tmp_path: Path, said: dict[str, Any]) -> None:
    values = {name: value.tolist() for name, value in opencv_nodes(FISHEYE).items()}
    cameras = _raw([write_text(tmp_path / "c.json", json.dumps({**values, **said}))])
    _assert_rows_match_and_depths_come_back(cameras, FISHEYE, _points(3))


def test_the_unit_of_the_translation_is_said(tmp_path: Path) -> None:
    nodes = opencv_nodes(RIG)
    path = write_opencv(tmp_path / "c.yml", nodes | {"T": nodes["T"] * 1000}, SIZE)
    found = _raw([path], Options(calibration_unit="mm"))
    assert found.rectified().baseline_m == pytest.approx(np.linalg.norm(RIG.translation_m))
    _assert_rows_match_and_depths_come_back(found, RIG, _points(2))


@pytest.mark.parametrize("said", [{"baseline_mm": 119.9}, {"baseline_cm": 12}, {"calculated_baseline_m": 0.1199}])
@pytest.mark.parametrize("unit", METRES)
def test_a_baseline_with_its_unit_says_that_of_the_matrices(tmp_path: Path, said: dict[str, float], unit: Unit) -> None:
    """People's scripts save it beside T, in a unit of its own."""
    lists = {name: (value / (METRES[unit] if name == "T" else 1)).tolist() for name, value in opencv_nodes(RIG).items()}
    path = write_text(tmp_path / "c.json", json.dumps({**lists, **said}))
    _assert_rows_match_and_depths_come_back(_raw([path]), RIG, _points(4))
    given = _raw([path], Options(calibration_unit="m")).rectified().baseline_m
    assert given == pytest.approx(np.linalg.norm(RIG.translation_m) / METRES[unit])
    write_text(path, json.dumps({**lists, "baseline_mm": 40}))
    with pytest.raises(VfoaError, match=r"c\.json: baseline_mm: found 40, and cameras .*calibration_unit"):
        _raw([path])
    assert _raw([path], Options(baseline_m=0.3)).rectified().baseline_m == pytest.approx(0.3)


def test_where_the_right_camera_stands_is_not_its_translation(tmp_path: Path) -> None:
    """Written by hand, or of a program whose poses go from camera to room, T begins with the positive baseline."""
    nodes = opencv_nodes(RIG)
    path = write_yaml(tmp_path / "c.yaml", {name: value.tolist() for name, value in nodes.items()} | {
        "T": (-nodes["R"].T @ nodes["T"].reshape(3)).tolist()
    })  # fmt: skip
    with pytest.raises(VfoaError, match=r"c\.yaml: .* baseline is -0\.1199.*x_right = R x_left \+ T.*T = -R times it"):
        read_cameras([path], _size)


def test_matrices_of_lenses_beside_orb_slam_s_rectified_camera_count(tmp_path: Path) -> None:
    """Of a script that appends both to ORB-SLAM's settings: the camera alone says that images are rectified."""
    settings = "Camera.fx: 640.0\nCamera.fy: 640.0\nCamera.cx: 600.0\nCamera.cy: 300.0\nCamera.bf: 76.8\n"
    lists = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    path = write_text(tmp_path / "mine.yml", f"{settings}{yaml.safe_dump(lists)}")
    _assert_rows_match_and_depths_come_back(_raw([path]), RIG, _points(6))
    rectified = read_cameras([path], _size, Options(rectified=True))
    assert isinstance(rectified, Calibration)
    assert (rectified.cx_px, rectified.baseline_m) == (600, pytest.approx(0.12))


def test_a_translation_is_in_the_unit_of_its_name(tmp_path: Path) -> None:
    lists = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    translation_mm = (1000 * np.array(lists.pop("T"))).tolist()
    for said in ({"translation_mm": translation_mm}, {"extrinsics": {"T_mm": translation_mm}}):
        path = write_text(tmp_path / "c.json", json.dumps({**lists, **said}))
        _assert_rows_match_and_depths_come_back(_raw([path]), RIG, _points(5))


def test_a_chain_beside_the_images_may_begin_with_the_right_camera(tmp_path: Path) -> None:
    path = FORMATS["kalibr"](tmp_path)[0]
    chain = yaml.safe_load(path.read_text(encoding="utf-8"))
    left_from_right = np.linalg.inv(chain["cam1"].pop("T_cn_cnm1")).tolist()
    turned = {"cam0": chain["cam1"], "cam1": chain["cam0"] | {"T_cn_cnm1": left_from_right}}
    write_text(path, yaml.safe_dump(turned))
    assert find_calibrations(tmp_path, _size)[0] == []
    assert find_calibrations(tmp_path, _size, Options(calibration_cameras=(1, 0)))[0] == [(path.name,)]


def test_numbers_of_cameras_hold_for_kitti_s_files_alone(tmp_path: Path) -> None:
    rows = _kitti(*(_projection(50, 30, -50 * b) for b in (0, 0.1, 0, 0.3)), names=("P0", "P1", "P2", "P3"))
    write_text(tmp_path / "calib.txt", rows)
    write_opencv(tmp_path / "c.yml", {"P1": _projection(50, 30), "P2": _projection(50, 30, -10)})
    found, _ = find_calibrations(tmp_path, _size, Options(calibration_cameras=(0, 1)))
    assert found == [("c.yml",), ("calib.txt",)]
    (tmp_path / "c.yml").unlink()
    assert find_calibrations(tmp_path, _size) == ([("calib.txt",)], [])


@pytest.mark.parametrize("name", ["opencv yaml", "ros", "kalibr", "zed", "depthai"])
def test_a_calibration_for_another_size_is_named(tmp_path: Path, name: str) -> None:
    paths = FORMATS[name](tmp_path)
    calibrations, (fault,) = find_calibrations(tmp_path, lambda: (64, 48))
    assert calibrations == []
    assert str(paths[0]) in fault


def test_an_oak_camera_s_pair_is_rectified_as_its_own_program_does(tmp_path: Path) -> None:
    """Numbers of a BW1098OBC (depthai-core, examples/calib_data_v53.json, July 2021), copied by hand."""
    left = [[858.9890747, 0, 646.7761230], [0, 859.7152710, 411.6924744], [0, 0, 1]]
    right = [[865.6600952, 0, 639.4890747], [0, 866.1361084, 409.4836121], [0, 0, 1]]
    d_left = [-4.8373399, 14.9179058, -0.0004877, -0.0001378, -15.1229658, -4.8896589, 15.1347094, -15.3369112]
    d_right = [28.8575439, -87.7545319, 0.0012091, 0.0011757, 380.5861206, 28.9347706, -90.3639221, 387.0883790]
    right_from_left = [
        [0.9999335408210754, -0.0020758542232215405, 0.011339202523231506],
        [0.0019991763401776552, 0.9999750852584839, 0.006769340950995684],
        [-0.011352972127497196, -0.006746221799403429, 0.9999127984046936],
    ]
    rectified_from_left = [
        [0.9995151162147522, 0.031031876802444458, 0.0025566520635038614],
        [-0.031040119007229805, 0.9995128512382507, 0.0032499704975634813],
        [-0.0024545539636164904, -0.003327753394842148, 0.9999914765357971],
    ]
    rectified_from_right = [
        [0.9994133114814758, 0.03304661810398102, -0.009000386111438274],
        [-0.03307604789733887, 0.9994478821754456, -0.0031408509239554405],
        [0.00889162253588438, 0.003436705330386758, 0.9999545812606812],
    ]
    shift = {"x": -7.459310054779053, "y": -0.24664966762065887, "z": 0.06717608124017715}
    leads = {"rotationMatrix": right_from_left, "toCameraSocket": 2, "translation": shift}
    nowhere = {"rotationMatrix": [], "toCameraSocket": -1, "translation": {"x": 0.0, "y": 0.0, "z": 0.0}}
    size = {"height": 800, "width": 1280}
    cameras = [
        [1, {"distortionCoeff": [*d_left, *[0.0] * 6], "intrinsicMatrix": left, "extrinsics": leads, **size}],
        [2, {"distortionCoeff": [*d_right, *[0.0] * 6], "intrinsicMatrix": right, "extrinsics": nowhere, **size}],
    ]
    path = write_text(tmp_path / "calib.json", json.dumps({"cameraData": cameras}))
    pair = read_cameras([path], lambda: (1280, 800))
    assert isinstance(pair, RawCalibration)
    np.testing.assert_allclose(pair.left.r, rectified_from_left, atol=1e-6)
    np.testing.assert_allclose(pair.right.r, rectified_from_right, atol=1e-6)
    assert pair.rectified().baseline_m == pytest.approx(0.0746, abs=1e-4)
    cut = read_cameras([path], lambda: (640, 360))
    assert isinstance(cut, RawCalibration)
    assert cut.left.size_px == (1280, 720)
    assert cut.left.k[1, 2] == pytest.approx(left[1][2] - 40)


def _depthai(root: Path, change: Callable[[Any], object]) -> list[Path]:
    (path,) = FORMATS["depthai"](root)
    document = json.loads(path.read_text())
    change(document)
    return [write_text(path, json.dumps(document))]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda found: found.update(cameraData=[3]), "cameraData: expected pairs"),
        (lambda found: found["stereoRectificationData"].update(leftCameraSocket=7), r"left camera \(socket 7\)"),
        (lambda found: found["stereoRectificationData"].update(leftCameraSocket=[]), r"left camera \(socket \[\]\)"),
        (lambda found: found["cameraData"][1][1].pop("width"), "camera 1: no width"),
        (lambda found: found["cameraData"][2][1].update(intrinsicMatrix=[1, 2]), "camera 2: intrinsicMatrix: found 2"),
        (lambda found: found["cameraData"][1][1]["extrinsics"].pop("translation"), "extrinsics: no translation"),
        (lambda found: found["cameraData"][1][1]["extrinsics"].update(translation=3), "extrinsics: no x"),
        (lambda found: found["cameraData"][1][1]["extrinsics"].update(toCameraSocket=-1), "no common camera"),
    ],
)
def test_what_is_wrong_in_an_oak_camera_s_file_is_named(
    tmp_path: Path, change: Callable[[Any], object], message: str
) -> None:
    with pytest.raises(VfoaError, match=rf"oak\.json.*{message}"):
        read_cameras(_depthai(tmp_path, change), _size)


def test_the_ways_of_an_oak_s_cameras_meet_in_a_third_one(tmp_path: Path) -> None:
    """Both lead to the colour camera, as those of later ones do; without a pair in the file, sockets 1 and 2."""
    plain = _raw(FORMATS["depthai"](tmp_path)).rectified()

    def lead_to_colour(found: Any) -> None:
        del found["stereoRectificationData"]
        right = found["cameraData"][2][1]["extrinsics"]
        shift = RIG.translation_m * 100 + np.array([*right["translation"].values()])
        left = {"rotationMatrix": RIG.rotation.tolist(), "translation": dict(zip("xyz", shift.tolist(), strict=True))}
        found["cameraData"][1][1]["extrinsics"] = {**left, "toCameraSocket": 0}

    met = _raw(_depthai(tmp_path, lead_to_colour)).rectified()
    assert (met.fx_px, met.baseline_m) == pytest.approx((plain.fx_px, plain.baseline_m))


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


def _changed(name: str, before: str, after: str) -> Callable[[Path], list[Path]]:
    """A format's file with one of its texts changed."""

    def write(root: Path) -> list[Path]:
        (path,) = FORMATS[name](root)
        text = path.read_text(encoding="utf-8")
        assert before in text
        return [write_text(path, text.replace(before, after, 1))]

    return write


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
            r"cam1: distortion_coeffs: found 4 .*4 finite",
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
        (_changed("orb-slam 3", '"PinHole"', '"Pinhole"'), Options(), r"Camera\.type: no 'Pinhole'.*PinHole"),
        (_changed("orb-slam 3", "Camera2.fx", "Camera2.f"), Options(), r"no Camera2\.fx; expected two cameras"),
        (_changed("orb-slam 3", "Camera1.cy: ", "Camera1.cy: a"), Options(), r"Camera1\.cy: found 'a"),
        (_changed("orb-slam 2", "RIGHT.P", "RIGHT.Q"), Options(), r"no RIGHT\.P"),
        (_mono("Camera.fx: 500"), Options(), r"no Camera\.bf"),
        (
            _mono("Camera.fx: 5\nCamera.fy: 5\nCamera.cx: 5\nCamera.cy: 5\nCamera.bf: 1\nCamera.k1: 0.1"),
            Options(),
            "LEFT",
        ),
        (_changed("basalt", "pinhole-radtan8", "ds"), Options(), r"camera 0: camera_type: no 'ds'"),
        (_changed("basalt", '"qw"', '"q"'), Options(), r"T_imu_cam: no qw"),
        (FORMATS["basalt"], Options(calibration_cameras=(0, 2)), r"no camera 2; found 2 cameras"),
        (
            _changed("basalt", '"T_imu_cam": [', '"T_imu_cam": 1, "other": ['),
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
        read_cameras(files(tmp_path), _size, options)


small = st.floats(-0.03, 0.03)


@given(
    rotation=st.tuples(small, small, small),
    shift=st.tuples(st.floats(-0.6, -0.05), small.map(lambda x: x / 3), small.map(lambda x: x / 3)),
    radial=st.tuples(st.floats(-0.2, 0.05), st.floats(-0.02, 0.05)),
    focal=st.floats(600, 900),
    seed=st.integers(0, 1000),
    is_fisheye=st.booleans(),
)
def test_any_rig_is_rectified(
    rotation: tuple[float, ...],
    shift: tuple[float, ...],
    radial: tuple[float, float],
    focal: float,
    seed: int,
    is_fisheye: bool,
) -> None:
    model: Any = "equidistant" if is_fisheye else "plumb_bob"
    k = calibrations.matrix(focal, focal * 1.01, 650, 350), calibrations.matrix(focal * 0.99, focal, 630, 365)
    d = np.array([*radial, 0.0003, -0.0002]), np.array([radial[0] * 0.9, radial[1], -0.0004, 0.0001])
    rig = Rig(k=k, d=d, rotation_vector=np.array(rotation), translation_m=np.array(shift), model=model)
    lenses = (RawCamera(size_px=SIZE, k=k_, d=d_, model=model) for k_, d_ in zip(k, d, strict=True))
    cameras = rectify_pose(*lenses, rig.rotation, rig.translation_m, "rig")
    _assert_rows_match_and_depths_come_back(cameras, rig, _points(seed))


def _projection(fx: float, cx: float, tx: float = 0.0) -> Float:
    return np.array([[fx, 0, cx, tx], [0, fx, 23.5, 0], [0, 0, 1, 0]], dtype=np.float64)


def _read(path: Path, options: Options = Options()) -> Calibration:  # noqa: B008
    cameras = read_cameras([path], lambda: (64, 48), options)
    assert isinstance(cameras, Calibration)
    return cameras


def _kitti(*matrices: Float, names: tuple[str, ...] = ("P2", "P3")) -> str:
    rows = (" ".join(f"{value:e}" for value in matrix.ravel()) for matrix in matrices)
    return "".join(f"{name}: {row}\n" for name, row in zip(names, rows, strict=True))


def test_a_camera_that_stands_ahead_of_the_other_does_not_change_the_baseline(tmp_path: Path) -> None:
    """As KITTI's colour cameras do, by some mm; P = K [I | -C] of a camera at C (Hartley and Zisserman, 6.1.2)."""
    k = _projection(700, 600)[:, :3]
    places = [[-0.06, 0.0, 0.0], [0.47, 0.004, 0.003]]
    left, right = (k @ np.column_stack([np.eye(3), -np.array(place)]) for place in places)
    write_text(tmp_path / "calib.txt", _kitti(left, right))
    assert _read(tmp_path / "calib.txt").baseline_m == pytest.approx(0.53, abs=1e-9)


def test_kitti_s_baseline_is_the_difference_of_the_fourth_columns(shared_data: Path) -> None:
    calibration = _read(shared_data / "kitti_pair" / "calib.txt")
    assert calibration.baseline_m == pytest.approx(0.532, abs=0.002)
    assert calibration.fx_px == 721.5377
    assert calibration.cx_px == calibration.cx_right_px == 609.5593
    gray = _read(shared_data / "kitti_pair" / "calib.txt", Options(calibration_cameras=(0, 1)))
    assert gray.baseline_m == pytest.approx(0.537, abs=0.001)


@pytest.mark.parametrize(
    ("names", "options", "size"),
    [(("P_rect_02", "P_rect_03"), Options(), (64, 48)), (("P0", "P1"), FIRST, None)],
    ids=["raw", "gray"],
)
def test_kitti_s_rows_are_read(
    tmp_path: Path, names: tuple[str, str], options: Options, size: tuple[int, int] | None
) -> None:
    """Among others, with a byte-order mark and line ends of Windows."""
    text = _kitti(_projection(50, 30), _projection(50, 32, -10), names=names)
    text = f"\ufeffcalib_time: 09-Jan-2012 13:57:47\nS_rect_02: 6.4e1 4.8e1\n{text}".replace("\n", "\r\n")
    calibration = _read(write_text(tmp_path / "c.txt", text), options)
    assert (calibration.baseline_m, calibration.cx_px, calibration.cx_right_px) == (0.2, 30.0, 32.0)
    assert calibration.size_px == size


def test_opencv_s_projections_are_read(tmp_path: Path) -> None:
    pair = {"P1": _projection(50, 30), "P2": _projection(50, 33, -5.0)}
    path = write_opencv(tmp_path / "c.yml", {**pair, "D1": np.zeros((1, 5))})
    calibration = _read(path)
    assert (calibration.baseline_m, calibration.cx_px, calibration.cx_right_px) == (0.1, 30.0, 33.0)
    assert _read(path, Options(calibration_unit="mm")).baseline_m == pytest.approx(1e-4)


def test_what_stereo_rectify_returns_is_read_back(tmp_path: Path) -> None:
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    rotation, _ = cv2.Rodrigues(np.array([0.01, 0.02, -0.01]))
    translation = np.array([[-0.12], [0.001], [0.002]])
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K, np.zeros(5), K, np.zeros(5), (640, 480), rotation, translation)
    nodes = {"R": rotation, "T": translation, "R1": R1, "R2": R2, "P1": P1, "P2": P2}
    path = write_opencv(tmp_path / "extrinsics.yml", nodes)
    with pytest.raises(VfoaError, match=r"extrinsics\.yml: .*R1.*rectified = true"):
        _read(path)
    calibration = _read(path, Options(rectified=True))
    assert calibration.baseline_m == pytest.approx(np.linalg.norm(translation))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("c.txt", "P2: 1 2 3\n", ":1: found '1 2 3'; expected 12 numbers"),
        ("c.txt", "P0: 1\nP2: 1 x\n", ":2: found '1 x'; expected 12 numbers"),
        ("c.txt", "nothing\n", ": no line P2: or P_rect_02:"),
        ("c.txt", _kitti(_projection(50, 30), _projection(50, 30, 5)), r": .*baseline is -0\.1 m"),
        ("c.txt", _kitti(_projection(50, 30), _projection(50, 30)), ": .*baseline is 0 m"),
        ("c.txt", _kitti(_projection(50, 30), _projection(51, 30, -5)), ": .*fx is 50 left and 51 right"),
        ("c.txt", _kitti(_projection(-50, 30), _projection(-50, 30, -5)), ": .*positive focal lengths"),
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
        _read(write_text(tmp_path / name, content))
    assert "\n" not in str(error.value)
