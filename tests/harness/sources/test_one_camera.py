"""Files with the calibration of one camera, each as the program that is named writes it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from harness.sources.calibration_files.depth_unit import counts_per_metre
from harness.sources.calibration_files.one_camera import read_one_camera
from harness.sources.calibration_files.read import Options, read_cameras
from tests.disk import write_text
from vfoa.errors import VfoaError

SIZE = (640, 480)
K = np.array([[600.0, 0, 320], [0, 610, 240], [0, 0, 1]])
ROS = """
image_width: 640
image_height: 480
camera_name: color
camera_matrix: {rows: 3, cols: 3, data: [600, 0, 320, 0, 610, 240, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.1, -0.2, 0, 0, 0]}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
projection_matrix: {rows: 3, cols: 4, data: [600, 0, 320, 0, 0, 610, 240, 0, 0, 0, 1, 0]}
"""
ECHO = """
header: {seq: 1, stamp: {secs: 1, nsecs: 2}, frame_id: color}
height: 480
width: 640
distortion_model: "plumb_bob"
D: [0.1, -0.2, 0.0, 0.0, 0.0]
K: [600.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0]
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [600.0, 0.0, 320.0, 0.0, 0.0, 610.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: False}
---
"""
REALSENSE = {
    "width": 640,
    "height": 480,
    "fx": 600.0,
    "fy": 610.0,
    "ppx": 320.0,
    "ppy": 240.0,
    "model": "distortion.inverse_brown_conrady",
    "coeffs": [0.0] * 5,
}
ROS_INI = """# Camera intrinsics

[image]

width
640

height
480

[color]

camera matrix
600.00000 0.00000 320.00000
0.00000 610.00000 240.00000
0.00000 0.00000 1.00000

distortion
0.10000 -0.20000 0.00000 0.00000 0.00000

rectification
1.00000 0.00000 0.00000
0.00000 1.00000 0.00000
0.00000 0.00000 1.00000

projection
600.00000 0.00000 320.00000 0.00000
0.00000 610.00000 240.00000 0.00000
0.00000 0.00000 1.00000 0.00000
"""
LISTS = {"camera_matrix": K.tolist(), "dist_coeff": [[0.0] * 5], "rms": 0.3}
FILES = {
    "camera_info.yaml": ROS,
    "echo.yaml": ECHO,
    "camera_intrinsic.json": json.dumps({"width": 640, "height": 480, "intrinsic_matrix": K.T.ravel().tolist()}),
    "realsense.json": json.dumps(REALSENSE),
    "intrinsics.json": json.dumps({"fx": 600, "fy": 610, "cx": 320, "cy": 240, "distance_m": 2}),
    "camera_intrinsics.json": json.dumps({"intrinsics": REALSENSE, "depth_scale": 0.001}),
    "cam_params.json": json.dumps({"camera": {"fx": 600, "fy": 610, "cx": 320, "cy": 240, "scale": 6553.5}}),
    "both.json": json.dumps({"color_intrinsics": REALSENSE, "depth_intrinsics": {**REALSENSE, "fx": 380}}),
    "all.json": json.dumps({"intrinsics": {"DEPTH": {**REALSENSE, "fx": 380}, "COLOR": REALSENSE}, "baseline": 0.05}),
    "to_depth.json": json.dumps({"color": {**REALSENSE, "fx": 900, "width": 1280}, "depth": REALSENSE}),
    "zed.json": json.dumps({"left_cam": REALSENSE, "right_cam": {**REALSENSE, "fx": 601}, "baseline": 120}),
    "of_number.yaml": "0: {fx: 600, fy: 610, cx: 320, cy: 240}\n",
    "camera.yaml": "fx: 600\nfy: 610\ncx: 320\ncy: 240\n",
    "opencv.json": json.dumps(LISTS),
    "ost.ini": ROS_INI,
    "K.txt": "600 0 320\n0 610 240\n0 0 1\n",
    "intrinsic_color.txt": "600 0 320 0\n0 610 240 0\n0 0 1 0\n0 0 0 1\n",
    "intrinsics.txt": "# by rows\n600, 0, 320, 0, 610, 240, 0, 0, 1\n",
}


def test_a_rotation_is_no_camera(tmp_path: Path) -> None:
    """R.txt beside K.txt, of cameras that do not differ: with a baseline it was a rectified pair."""
    path = tmp_path / "R.txt"
    np.savetxt(path, np.eye(3))
    with pytest.raises(VfoaError, match="expected a camera matrix"):
        read_one_camera(path, (640, 480))
    with pytest.raises(VfoaError, match="expected a camera matrix"):
        read_cameras([path], lambda: (640, 480), Options(baseline_m=0.1))


@pytest.mark.parametrize("name", FILES)
def test_each_format_gives_the_same_camera(tmp_path: Path, name: str) -> None:
    found = read_one_camera(write_text(tmp_path / name, FILES[name]), SIZE)
    assert found.size_px == SIZE
    assert np.array_equal(found.k, K)
    assert found.d.any() == (name in ("camera_info.yaml", "echo.yaml", "ost.ini"))
    assert not read_one_camera(tmp_path / name, SIZE, rectified=True).d.any()


def test_a_camera_by_names_may_have_opencv_s_for_the_rest(tmp_path: Path) -> None:
    named = {"fx": 600, "fy": 610, "cx": 320, "cy": 240, "image_width": 640, "image_height": 480}
    lens = [0.1, -0.2, 0.001, 0.002, 0.0]
    path = write_text(tmp_path / "a.json", json.dumps({**named, "dist_coeffs": lens}))
    found = read_one_camera(path, SIZE)
    assert (found.k.tolist(), found.d.tolist(), found.model) == (K.tolist(), lens, "plumb_bob")
    with pytest.raises(VfoaError, match=r"a\.json: .*1280.*640"):
        read_one_camera(path, (1280, 960))
    fisheye = write_text(tmp_path / "b.json", json.dumps({**named, "dist_coeffs": lens[:4], "fisheye": True}))
    assert read_one_camera(fisheye, SIZE).model == "equidistant"


@pytest.mark.parametrize(("said", "model"), [(True, "equidistant"), (False, "plumb_bob")])
def test_a_column_of_four_coefficients_is_asked_for(tmp_path: Path, *, said: bool, model: str) -> None:
    path, d = tmp_path / "camera.npz", np.array([[0.1], [-0.2], [0.001], [0.002]])
    np.savez(path, K=K, D=d)
    with pytest.raises(VfoaError, match=r"D: found a column of 4 .*fisheye = true in the file"):
        read_one_camera(path, SIZE)
    assert not read_one_camera(path, SIZE, rectified=True).d.any()
    np.savez(path, K=K, D=d, fisheye=said)
    assert read_one_camera(path, SIZE).model == model
    np.savez(path, K=K, D=d.T)
    assert read_one_camera(path, SIZE).model == "plumb_bob"


@pytest.mark.parametrize("suffix", ["yml", "xml", "json", "npz"])
@pytest.mark.parametrize(("fisheye", "model"), [({}, "plumb_bob"), ({"fisheye_model": 1}, "equidistant")])
def test_opencv_s_camera_is_read(tmp_path: Path, suffix: str, fisheye: dict[str, int], model: str) -> None:
    d, path = np.array([[0.1, -0.2, 0.001, 0.002]]), tmp_path / f"camera.{suffix}"
    values = {"image_width": 640, "image_height": 480, "camera_matrix": K, "distortion_coefficients": d, **fisheye}
    if suffix == "npz":
        np.savez(path, **values)
    else:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        for name, value in values.items():
            storage.write(name, value)
        storage.release()
    found = read_one_camera(path, SIZE)
    assert (found.model, found.size_px, found.k.tolist(), found.d.tolist()) == (model, SIZE, K.tolist(), d[0].tolist())


@pytest.mark.parametrize(
    ("model", "count", "expected"),
    [("distortion.brown_conrady", 5, "plumb_bob"), ("distortion.kannala_brandt4", 4, "equidistant")],
)
def test_the_lens_of_a_realsense_is_read(tmp_path: Path, model: str, count: int, expected: str) -> None:
    coefficients = [0.1, -0.2, 0.001, 0.002, 0.0]
    text = json.dumps({**REALSENSE, "model": model, "coeffs": coefficients})
    found = read_one_camera(write_text(tmp_path / "camera.json", text), SIZE)
    assert (found.model, found.d.tolist()) == (expected, coefficients[:count])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "{"),
        ("a.json", "[1]"),
        ("a.json", '{"fx": 1}'),
        ("a.json", FILES["camera_intrinsic.json"].replace("640", "320")),
        ("a.json", FILES["camera_intrinsic.json"].replace("[600.0, 0.0", "[600.0, [0.0]")),
        ("a.json", FILES["realsense.json"].replace("640", "320")),
        ("a.json", FILES["realsense.json"].replace("240.0", '"x"')),
        ("a.json", json.dumps({**REALSENSE, "cx": 320})),
        ("a.json", json.dumps({**REALSENSE, "model": [1], "coeffs": [0.1, 0, 0, 0, 0]})),
        ("a.json", json.dumps({**REALSENSE, "coeffs": [0.1, 0, 0]})),
        ("a.json", json.dumps({**REALSENSE, "k1": 0.1})),
        ("a.json", json.dumps({**REALSENSE, "dist_coeffs": [0.1, 0, 0, 0, 0]})),
        ("a.json", json.dumps({**LISTS, "dist_coeff": [0.1, 0.2, 0.3]})),
        ("a.json", json.dumps({**LISTS, "mtx": K.tolist()})),
        ("a.json", json.dumps({**LISTS, "k1": 0.1})),
        ("a.json", json.dumps({**LISTS, "xi": [1.2]})),
        ("a.json", json.dumps({**LISTS, "camera_matrix": K.T.tolist()})),
        ("a.json", json.dumps({"color": REALSENSE, "head": REALSENSE})),
        ("a.json", json.dumps({"color": {**REALSENSE, "width": 1280}, "depth": REALSENSE, "infra": REALSENSE})),
        ("a.ini", ROS_INI + ROS_INI),
        ("a.yaml", "[1, 2]"),
        ("a.yaml", "a: ["),
        ("a.yaml", "camera_matrix: 3"),
        ("a.txt", "1 2 3"),
        ("a.txt", "hello"),
        ("a.txt", "-600 0 320 0 610 240 0 0 1"),
    ],
)
def test_anything_else_is_one_line_with_the_file(tmp_path: Path, name: str, text: str) -> None:
    with pytest.raises(VfoaError, match=rf"^[^\n]*{name}[^\n]*$"):
        read_one_camera(write_text(tmp_path / name, text), SIZE)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ({"depth_scale": 0.00025}, 4000.0),
        ({"depth_scale": 0.0010000000474974513}, 1000.0),
        ({"depth_scale": 5000}, 5000.0),
        ({"scale": 100, "depth_scale_meters_per_unit": 0.0001}, 10_000.0),
        ({"depth_scale_mm": 0.25, 1: 2}, 4000.0),
        ({"intrinsics": REALSENSE, "depth_scale": 0.0001}, 10_000.0),
        ({"cam": {**REALSENSE, "png_depth_scale": 6553.5}}, 6553.5),
        ({"camera": {**REALSENSE, "scale": 6553.5}}, 6553.5),
        ({"depth_scale": 1.0}, None),
        ({"scale": 0.5}, None),
        (REALSENSE, None),
    ],
)
def test_the_unit_of_depth_that_scripts_save_beside_a_camera(
    tmp_path: Path, said: dict[str, object], expected: float | None
) -> None:
    assert counts_per_metre(write_text(tmp_path / "a.json", json.dumps(said))) == expected


def test_a_scale_of_depth_that_is_neither_is_asked_for(tmp_path: Path) -> None:
    """BOP's 0.1 is in millimetres per count."""
    with pytest.raises(VfoaError, match=r"a\.json: depth_scale: found 0\.1; .*depth_scale = in \[source\]"):
        counts_per_metre(write_text(tmp_path / "a.json", '{"depth_scale": 0.1}'))
