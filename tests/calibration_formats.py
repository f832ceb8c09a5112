"""One rig, written as different programs would, and how a test reads such a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import yaml

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.read import Options, read_cameras
from harness.sources.rectification import RawCalibration, RawCamera
from tests import calibrations
from tests.calibrations import RIG, SIZE, Rig, opencv_nodes, rectification, write_opencv, write_yaml
from tests.disk import write_text
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


def size_px() -> tuple[int, int]:
    return SIZE


def renamed(nodes: dict[str, Float], names: dict[str, str]) -> dict[str, Float]:
    return {names.get(name, name): value for name, value in nodes.items()}


def _sample(root: Path) -> list[Path]:
    """The two files of OpenCV's own stereo calibration sample; neither tells the size."""
    nodes = renamed(opencv_nodes(RIG), {"K1": "M1", "K2": "M2"})
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
    "opencv xml": lambda root: [write_opencv(root / "c.xml", renamed(opencv_nodes(RIG), SPELLED))],
    "opencv yaml, as text": lambda root: [_as_text(write_opencv(root / "c.yml", opencv_nodes(RIG), SIZE))],
    "opencv xml, as text": lambda root: [_as_text(write_opencv(root / "c.xml", opencv_nodes(RIG), SIZE))],
    "opencv json, as text": lambda root: [_as_text(write_opencv(root / "c.json", opencv_nodes(RIG), SIZE))],
    "opencv by sides": lambda root: [write_opencv(root / "c.yml", renamed(opencv_nodes(RIG), SIDED), SIZE)],
    "opencv, shortened": lambda root: [write_opencv(root / "c.yml", renamed(opencv_nodes(RIG), SHORTENED), SIZE)],
    "opencv, a stereo pose": lambda root: [write_opencv(root / "c.yml", renamed(opencv_nodes(RIG), POSED), SIZE)],
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


def read_raw(paths: list[Path], options: Options = Options()) -> RawCalibration:  # noqa: B008
    cameras = read_cameras(paths, size_px, options)
    assert isinstance(cameras, RawCalibration)
    return cameras


def _rectified_points(camera: RawCamera, pixels: Float) -> Float:
    """Positions of pixels (N, 2) after rectification."""
    undistort = cv2.fisheye.undistortPoints if camera.model == "equidistant" else cv2.undistortPoints
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
    found = undistort(pixels[:, None], camera.k, camera.d, R=camera.r, P=camera.p, criteria=stop)
    return np.asarray(found[:, 0], dtype=np.float64)


def assert_rows_match_and_depths_come_back(cameras: RawCalibration, rig: Rig, points: Float) -> None:
    left, right = (
        _rectified_points(camera, pixels)
        for camera, pixels in zip((cameras.left, cameras.right), rig.project(points), strict=True)
    )
    calibration = cameras.rectified()
    depth = (points @ cameras.left.r.T)[:, 2]
    disparity = left[:, 0] - right[:, 0] + calibration.cx_right_px - calibration.cx_px
    assert np.abs(left[:, 1] - right[:, 1]).max() < 1e-3
    assert np.abs(disparity - calibration.fx_px * calibration.baseline_m / depth).max() < 1e-3


def points_ahead(seed: int, count: int = 40) -> Float:
    """Points within half a metre of the axis, one to five metres away."""
    random = np.random.default_rng(seed)
    depth = random.uniform(1, 5, (count, 1))
    return np.hstack([random.uniform(-0.4, 0.4, (count, 2)) * depth, depth])


def changed(name: str, before: str, after: str) -> Callable[[Path], list[Path]]:
    """A format's file with one of its texts changed."""

    def write(root: Path) -> list[Path]:
        (path,) = FORMATS[name](root)
        text = path.read_text(encoding="utf-8")
        assert before in text
        return [write_text(path, text.replace(before, after, 1))]

    return write


def projection(fx: float, cx: float, tx: float = 0.0) -> Float:
    return np.array([[fx, 0, cx, tx], [0, fx, 23.5, 0], [0, 0, 1, 0]], dtype=np.float64)


def read_rectified(path: Path, options: Options = Options()) -> Calibration:  # noqa: B008
    cameras = read_cameras([path], lambda: (64, 48), options)
    assert isinstance(cameras, Calibration)
    return cameras


def kitti_rows(*matrices: Float, names: tuple[str, ...] = ("P2", "P3")) -> str:
    rows = (" ".join(f"{value:e}" for value in matrix.ravel()) for matrix in matrices)
    return "".join(f"{name}: {row}\n" for name, row in zip(names, rows, strict=True))
