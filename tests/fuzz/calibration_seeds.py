"""Whole calibrations to begin with: each function writes one at a path, by the writers of the tests."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tests import calibrations
from tests.disk import write_text

RIG, SIZE = calibrations.RIG, calibrations.SIZE


def opencv(path: Path) -> None:
    calibrations.write_opencv(path, calibrations.opencv_nodes(RIG), SIZE)


def opencv_rectified(path: Path) -> None:
    calibrations.write_opencv(path, calibrations.opencv_nodes(RIG) | calibrations.rectification(RIG), SIZE)


def opencv_inner(path: Path) -> None:
    nodes = calibrations.opencv_nodes(RIG)
    calibrations.write_opencv(path, {name: nodes[name] for name in ("K1", "D1", "K2", "D2")}, SIZE)


def ros(path: Path) -> None:
    path.write_bytes(calibrations.write_ros(path.parent / "ros", RIG)[0].read_bytes())


def euroc(path: Path) -> None:
    _euroc(path, 0)


def _euroc(path: Path, camera: int) -> None:
    pose = np.eye(4)
    pose[0, 3] = 0.12 * camera
    document = {
        "sensor_type": "camera",
        "T_BS": {"cols": 4, "rows": 4, "data": pose.ravel().tolist()},
        "camera_model": "pinhole",
        "intrinsics": RIG.k[camera][[0, 1, 0, 1], [0, 1, 2, 2]].tolist(),
        "distortion_model": "radial-tangential",
        "distortion_coefficients": RIG.d[camera].tolist(),
        "resolution": list(SIZE),
        "rate_hz": 20,
    }
    calibrations.write_yaml(path, document)


def other_calibration(path: Path) -> None:
    """The whole file beside a damaged one, by its name."""
    nodes = calibrations.opencv_nodes(RIG)
    if path.name == "extrinsics.yml":
        calibrations.write_opencv(path, {name: nodes[name] for name in ("R", "T")})
    elif path.name == "right.yaml":
        path.write_bytes(calibrations.write_ros(path.parent / "ros", RIG)[1].read_bytes())
    else:
        _euroc(path, 1)


def kalibr(path: Path) -> None:
    calibrations.write_kalibr(path, RIG)


def zed(path: Path) -> None:
    calibrations.write_zed(path, RIG)


def kitti(path: Path) -> None:
    write_text(path, "P2: 700 0 600 0 0 700 180 0 0 0 1 0\nP3: 700 0 600 -370 0 700 180 0 0 0 1 0\n")


def middlebury(path: Path) -> None:
    first, second = (f"[3997.684 0 {cx}; 0 3997.684 1011.728; 0 0 1]" for cx in (1176.728, 1307.839))
    write_text(path, f"cam0={first}\ncam1={second}\ndoffs=131.111\nbaseline=193.001\nwidth=1280\nheight=720\n")


def matrix(path: Path) -> None:
    write_text(path, "600 0 320\n0 610 240\n0 0 1\n")


def foundation(path: Path) -> None:
    write_text(path, "754.6 0.0 489.3 0.0 754.6 265.2 0.0 0.0 1.0\n0.063\n")


def four_numbers(path: Path) -> None:
    write_text(path, "# fx fy cx cy\n600, 610, 320, 240\n")


def open3d(path: Path) -> None:
    k = [600.0, 0, 0, 0, 610, 0, 320, 240, 1]
    write_text(path, json.dumps({"width": SIZE[0], "height": SIZE[1], "intrinsic_matrix": k}))


def realsense(path: Path) -> None:
    write_text(path, json.dumps({"width": SIZE[0], "height": SIZE[1], "fx": 600, "fy": 610, "ppx": 320, "ppy": 240}))


def npy_camera(path: Path) -> None:
    np.save(path, np.array([600.0, 610, 320, 240]))
