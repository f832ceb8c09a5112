"""Calibrations that programs with OpenCV write, under many names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.documents import METRES, Unit
from harness.sources.calibration_files.read import Options, find_calibrations, read_cameras
from tests.calibration_formats import (
    FISHEYE,
    assert_rows_match_and_depths_come_back,
    points_ahead,
    projection,
    read_raw,
    read_rectified,
    size_px,
)
from tests.calibrations import RIG, SIZE, opencv_nodes, rectification, write_opencv, write_yaml
from tests.disk import write_text
from vfoa.errors import VfoaError


@pytest.mark.parametrize(
    "size",
    [
        {"image_size": {"width": 1280, "height": 720}},
        {"imageSizeWidth": 1280, "imageSizeHeight": 720},
        {"resolution": "1280x720"},
        {"image_shape": [720, 1280, 3]},
        {"img_w": 1280, "img_h": 720},
        {"img_size_px": [1280, 720]},
        {"sizel": [1280, 720], "sizer": [1280, 720]},
        {"left": {"width": 1280, "height": 720}, "right": {"width": 1280, "height": 720}},
        {"camera1": {"image_size": {"width": 1280, "height": 720}}, "camera2": {}},
    ],
)
def test_the_size_that_a_file_says_is_that_of_its_calibration(tmp_path: Path, size: dict[str, Any]) -> None:
    """Images of half the size must not be rectified by the matrices as they are."""
    lists = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    path = write_text(tmp_path / "c.json", json.dumps(lists | size))
    assert read_raw([path]).left.size_px == SIZE


LISTS = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
_POSE = {"R": LISTS["R"], "T": LISTS["T"]}


def _of_cameras(*names: str, of_matrix: str = "K", of_lens: str = "dist", **more: Any) -> dict[str, Any]:
    """A table for each camera."""
    return {
        name: {of_matrix: LISTS[f"K{number}"], of_lens: LISTS[f"D{number}"], **more}
        for number, name in enumerate(names, start=1)
    }


@pytest.mark.parametrize(
    "document",
    [
        {**_of_cameras("cam0", "cam1", of_matrix="mtx"), "stereo": {**_POSE, "E": LISTS["R"], "F": LISTS["R"]}},
        {**_of_cameras("CAM_1", "CAM_2"), **_POSE},
        {**_of_cameras("camera1", "camera2", of_matrix="camera_matrix", of_lens="distortion"), "extrinsics": _POSE},
        {
            **_of_cameras("left_camera", "right_camera", of_matrix="matrix", of_lens="distortion"),
            "stereo_params": {"rotation_matrix": LISTS["R"], "translation_vector": LISTS["T"]},
        },
        {"date": "2026-05-01", "stereo_calibration": {**_of_cameras("left", "right"), **_POSE}},
        {"calibration": LISTS},
        {
            **{name: LISTS[name] for name in ("K1", "D1", "K2", "D2")},
            "R_stereo": LISTS["R"],
            "T_stereo": LISTS["T"],
            "baseline": 0.1199,
        },
        {
            **{f"intrinsics-{n}": LISTS[f"K{n}"] for n in (1, 2)},
            **{f"DistCoefficient-{n}": LISTS[f"D{n}"] for n in (1, 2)},
            **_POSE,
        },
    ],
)
def test_names_and_tables_of_people_s_scripts(tmp_path: Path, document: dict[str, Any]) -> None:
    path = write_text(tmp_path / "c.json", json.dumps(document))
    assert_rows_match_and_depths_come_back(read_raw([path]), RIG, points_ahead(4))


_RECTIFIED = {"fx": 700.0, "fy": 700.0, "cx": 640.0, "cy": 360.0}


@pytest.mark.parametrize(
    ("document", "baseline_m"),
    [
        (
            {  # as scripts with the ZED's SDK save its rectified cameras
                "serial_number": 1234,
                "resolution": {"width": 1280, "height": 720},
                "left_cam": {**_RECTIFIED, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.0, "h_fov": 84.9},
                "right_cam": {**_RECTIFIED, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, "k3": 0.0, "h_fov": 84.9},
                "baseline": 0.12,
            },
            0.12,
        ),
        (
            {
                **{f"{side}_cam": {**_RECTIFIED, "disto": [0.0] * 12} for side in ("left", "right")},
                "stereo_baseline_mm": 63.0,
            },
            0.063,
        ),
        (
            {  # a RealSense's infrared pair
                "intrinsics": {
                    side: {
                        "fx": 700.0,
                        "fy": 700.0,
                        "ppx": 640.0,
                        "ppy": 360.0,
                        "coeffs": [0.0] * 5,
                        "model": "distortion.brown_conrady",
                    }
                    for side in ("left", "right")
                },
                "baseline_m": 0.05,
            },
            0.05,
        ),
        ({"K_left": LISTS["K1"], "K_right": LISTS["K1"], "baseline": 0.1, "baseline_mm": 100.0}, 0.1),
    ],
)
def test_two_rectified_cameras_and_their_baseline(tmp_path: Path, document: dict[str, Any], baseline_m: float) -> None:
    path = write_text(tmp_path / "c.json", json.dumps(document))
    found = read_cameras([path], size_px)
    assert isinstance(found, Calibration)
    fx_px = LISTS["K1"][0][0] if "K_left" in document else 700.0
    assert (found.fx_px, found.baseline_m) == pytest.approx((fx_px, baseline_m))


@pytest.mark.parametrize("beside", [{"baseline": 0.12}, {"baseline_mm": 120}, {}])
def test_tables_of_numbers_are_the_lenses_of_raw_images(tmp_path: Path, beside: dict[str, float]) -> None:
    """The file's R and T count, not the baseline alone."""
    names = ("k1", "k2", "p1", "p2", "k3")
    tables = {
        side: {
            "fx": LISTS[f"K{n}"][0][0],
            "fy": LISTS[f"K{n}"][1][1],
            "cx": LISTS[f"K{n}"][0][2],
            "cy": LISTS[f"K{n}"][1][2],
            **dict(zip(names, np.ravel(LISTS[f"D{n}"]).tolist(), strict=False)),
        }
        for n, side in ((1, "left"), (2, "right"))
    }
    path = write_text(tmp_path / "c.json", json.dumps({**tables, **_POSE, **beside}))
    assert_rows_match_and_depths_come_back(read_raw([path]), RIG, points_ahead(4))
    path = write_text(tmp_path / "c.json", json.dumps({**tables, **beside}))
    with pytest.raises(VfoaError, match="K1 D1 K2 D2"):
        read_cameras([path], size_px)


@pytest.mark.parametrize(
    "change",
    [
        {"k4": 0.1, "k1": 0.1},  # cv2.fisheye's four
        {"coeffs": [0.1, 0.0, 0.0, 0.0, 0.0], "model": "inverse_brown_conrady"},
        {"lens_coefficients": [0.1, 0.0, 0.0, 0.0, 0.0]},  # not a name that is known
        {"fx": 705.0},
    ],
)
def test_other_tables_are_no_rectified_pair(tmp_path: Path, change: dict[str, Any]) -> None:
    cameras = {"left": _RECTIFIED, "right": {**_RECTIFIED, **change}}
    path = write_text(tmp_path / "c.json", json.dumps({**cameras, "baseline": 0.12}))
    with pytest.raises(VfoaError):
        read_cameras([path], size_px)


def _camera_file(path: Path, number: int, **more: Any) -> Path:
    """What a script saves of one camera."""
    return write_text(path, json.dumps({"K": LISTS[f"K{number}"], "D": LISTS[f"D{number}"], **more}))


def test_a_file_for_each_camera_and_one_for_their_pose(tmp_path: Path) -> None:
    """The sizes are not those of the images, which are half as large."""
    size = {"width": SIZE[0], "height": SIZE[1]}
    lenses = [_camera_file(tmp_path / f"calib_{side}.json", n, **size) for n, side in ((1, "left"), (2, "right"))]
    rectified = {name: value.tolist() for name, value in rectification(RIG).items()}
    for values in (_POSE, {**_POSE, "E": LISTS["R"]}, rectified):
        pose = write_text(tmp_path / "stereo_params.json", json.dumps(values))
        found = read_raw([*lenses, pose])
        assert_rows_match_and_depths_come_back(found, RIG, points_ahead(4))
        assert found.left.size_px == SIZE
        assert find_calibrations(tmp_path, lambda: (640, 360)) == (
            [("calib_left.json", "calib_right.json", "stereo_params.json")],
            [],
        )
    with pytest.raises(VfoaError, match=r"found D1, D2, K1, K2 .*expected K1 D1 K2 D2 with R T"):
        read_raw(lenses)


def test_a_file_for_each_camera_with_its_rectification(tmp_path: Path) -> None:
    found = {name: value.tolist() for name, value in rectification(RIG).items()}
    paths = [
        _camera_file(tmp_path / f"{side}.json", n, R=found[f"R{n}"], P=found[f"P{n}"])
        for n, side in ((1, "left"), (2, "right"))
    ]
    assert_rows_match_and_depths_come_back(read_raw(paths), RIG, points_ahead(4))
    write_text(tmp_path / "stereo.json", json.dumps(_POSE))
    assert find_calibrations(tmp_path, size_px) == ([("left.json", "right.json")], [])


def test_of_three_files_that_are_incomplete_one_note_is_left(tmp_path: Path) -> None:
    for number, side in ((1, "left"), (2, "right")):
        _camera_file(tmp_path / f"{side}_calib.json", number)
    write_text(tmp_path / "stereo_calib.json", json.dumps({"R": LISTS["R"]}))
    calibrations, (note,) = find_calibrations(tmp_path, size_px)
    assert calibrations == []
    assert "found D1, D2, K1, K2, R; expected" in note


@pytest.mark.parametrize("indent", [None, 2])
def test_settings_of_block_matching_are_no_calibration(tmp_path: Path, indent: int | None) -> None:
    """As in the manifest of a run, which is found from a working directory."""
    write_text(tmp_path / "runs" / "first" / "manifest.json", json.dumps({"p1": 8, "p2": 32, "mode": 1}, indent=indent))
    assert find_calibrations(tmp_path, size_px) == ([], [])
    write_text(tmp_path / "mine.json", json.dumps({"P1": [8], "P2": [32]}, indent=indent))
    assert [note for note in find_calibrations(tmp_path, size_px)[1] if "mine.json" in note]


def test_tables_of_three_cameras_are_no_pair(tmp_path: Path) -> None:
    path = write_text(tmp_path / "c.json", json.dumps({**_of_cameras("camera1", "camera2"), "camera0": {}, **_POSE}))
    with pytest.raises(VfoaError, match=r"found R, T \(and, not known, camera1_K"):
        read_raw([path])


def test_cameras_0_and_1_are_a_pair(tmp_path: Path) -> None:
    nodes = opencv_nodes(RIG)
    from_0 = {f"{name[0]}{int(name[1]) - 1}" if name[1:] else name: value for name, value in nodes.items()}
    found, expected = (read_raw([write_opencv(tmp_path / "c.yml", each)]) for each in (from_0, nodes))
    assert (found.left, found.right) == (expected.left, expected.right)
    with pytest.raises(VfoaError, match="three cameras"):
        read_raw([write_opencv(tmp_path / "c.yml", from_0 | nodes)])


def test_a_camera_matrix_of_rows_times_matrices_is_refused(tmp_path: Path) -> None:
    nodes = opencv_nodes(RIG)
    path = write_opencv(tmp_path / "c.yml", nodes | {"K1": nodes["K1"].T, "K2": nodes["K2"].T})
    with pytest.raises(VfoaError, match=r"left: K: found .*expected \[fx 0 cx; 0 fy cy; 0 0 1\]"):
        read_raw([path])


def test_a_camera_matrix_that_was_computed_is_read(tmp_path: Path) -> None:
    nodes = opencv_nodes(RIG)
    path = write_opencv(tmp_path / "c.yml", nodes | {"K1": nodes["K1"] + 1e-13 * np.ones((3, 3))}, SIZE)
    assert_rows_match_and_depths_come_back(read_raw([path]), RIG, points_ahead(6))


def test_a_matrix_without_numbers_is_not_set(tmp_path: Path) -> None:
    """As cv2.FileStorage writes a Mat that nobody filled: the right lens would be one without distortion."""
    path = write_opencv(tmp_path / "c.yml", opencv_nodes(RIG) | {"D2": np.zeros((0, 0))})
    with pytest.raises(VfoaError, match=r"c\.yml: found D1, K1, K2, R, T, and zeros or nothing as D2; expected K1 D1"):
        read_raw([path])


@pytest.mark.parametrize(
    "said",
    [
        {"fisheye": True},
        {"use_fisheye": True},
        {"camera_model": "fisheye"},
        {"distortion_model": "equidistant"},
        {"opencv_model": "cv2.fisheye / Kannala-Brandt 4"},
        {"left": {"camera_type": "Pinhole Fisheye"}},
    ],
)
def test_a_file_that_says_so_is_of_fisheye_lenses(tmp_path: Path, said: dict[str, Any]) -> None:
    values = {name: value.tolist() for name, value in opencv_nodes(FISHEYE).items()}
    cameras = read_raw([write_text(tmp_path / "c.json", json.dumps({**values, **said}))])
    assert_rows_match_and_depths_come_back(cameras, FISHEYE, points_ahead(3))


@pytest.mark.parametrize("is_archive", [False, True])
def test_a_column_of_four_coefficients_is_not_taken_for_granted(tmp_path: Path, *, is_archive: bool) -> None:
    """cv2.fisheye returns it, and scripts save it without a word; cv2.stereoCalibrate returns five coefficients."""
    columns = {name: value.T if name[0] == "D" else value for name, value in opencv_nodes(FISHEYE).items()}
    lists = {name: value.tolist() for name, value in columns.items()}
    path = tmp_path / ("c.npz" if is_archive else "c.json")

    def write(**said: Any) -> None:
        np.savez(path, **columns, **said) if is_archive else write_text(path, json.dumps(lists | said))

    write()
    with pytest.raises(VfoaError, match=r"D1: found a column of 4 .*fisheye = true in \[source\], or fisheye = false"):
        read_raw([path])
    assert_rows_match_and_depths_come_back(read_raw([path], Options(fisheye=True)), FISHEYE, points_ahead(3))
    assert read_raw([path], Options(fisheye=False)).left.model == "plumb_bob"
    for said, model in (({"model": "pinhole"}, "plumb_bob"), ({"is_fisheye": True}, "equidistant")):
        write(**said)
        assert read_raw([path]).left.model == model


@pytest.mark.parametrize(
    ("d", "is_asked"),
    [
        ([0.15522498, -0.1554219, 0.10805718, -0.04531632], True),  # of a public calibration by cv2.fisheye
        ([-0.2834, 0.0739, 0.0002, 0.0000176], False),  # EuRoC
        ([-0.2834, 0.0739, 0.012, -0.008], False),
    ],
)
def test_four_coefficients_in_a_list_are_those_of_a_lens_with_small_tangential_ones(
    d: list[float], *, is_asked: bool, tmp_path: Path
) -> None:
    lists = {name: value.tolist() for name, value in opencv_nodes(RIG).items()} | {"D1": d, "D2": d}
    path = write_text(tmp_path / "c.json", json.dumps(lists))
    if is_asked:
        with pytest.raises(VfoaError, match=r"D1: .*fisheye = true in \[source\], or fisheye = false"):
            read_raw([path])
    options = Options(fisheye=False) if is_asked else Options()
    assert read_raw([path], options).left.model == "plumb_bob"


def test_a_column_without_distortion_is_of_no_fisheye_lens(tmp_path: Path) -> None:
    zeros = {"D1": np.zeros((4, 1)), "D2": np.zeros((4, 1))}
    assert read_raw([write_opencv(tmp_path / "c.yml", opencv_nodes(RIG) | zeros, SIZE)]).left.model == "plumb_bob"


def test_the_unit_of_the_translation_is_said(tmp_path: Path) -> None:
    nodes = opencv_nodes(RIG)
    path = write_opencv(tmp_path / "c.yml", nodes | {"T": nodes["T"] * 1000}, SIZE)
    found = read_raw([path], Options(calibration_unit="mm"))
    assert found.rectified().baseline_m == pytest.approx(np.linalg.norm(RIG.translation_m))
    assert_rows_match_and_depths_come_back(found, RIG, points_ahead(2))


@pytest.mark.parametrize("said", [{"baseline_mm": 119.9}, {"baseline_cm": 12}, {"calculated_baseline_m": 0.1199}])
@pytest.mark.parametrize("unit", METRES)
def test_a_baseline_with_its_unit_says_that_of_the_matrices(tmp_path: Path, said: dict[str, float], unit: Unit) -> None:
    """People's scripts save it beside T, in a unit of its own."""
    lists = {name: (value / (METRES[unit] if name == "T" else 1)).tolist() for name, value in opencv_nodes(RIG).items()}
    path = write_text(tmp_path / "c.json", json.dumps({**lists, **said}))
    assert_rows_match_and_depths_come_back(read_raw([path]), RIG, points_ahead(4))
    given = read_raw([path], Options(calibration_unit="m")).rectified().baseline_m
    assert given == pytest.approx(np.linalg.norm(RIG.translation_m) / METRES[unit])
    write_text(path, json.dumps({**lists, "baseline_mm": 40}))
    with pytest.raises(VfoaError, match=r"c\.json: baseline_mm: found 40, and cameras .*calibration_unit"):
        read_raw([path])
    assert read_raw([path], Options(baseline_m=0.3)).rectified().baseline_m == pytest.approx(0.3)


def test_where_the_right_camera_stands_is_not_its_translation(tmp_path: Path) -> None:
    """Written by hand, or of a program whose poses go from camera to room, T begins with the positive baseline."""
    nodes = opencv_nodes(RIG)
    path = write_yaml(tmp_path / "c.yaml", {name: value.tolist() for name, value in nodes.items()} | {
        "T": (-nodes["R"].T @ nodes["T"].reshape(3)).tolist()
    })  # fmt: skip
    with pytest.raises(VfoaError, match=r"c\.yaml: .* baseline is -0\.1199.*x_right = R x_left \+ T.*T = -R times it"):
        read_cameras([path], size_px)


def test_a_translation_is_in_the_unit_of_its_name(tmp_path: Path) -> None:
    lists = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    translation_mm = (1000 * np.array(lists.pop("T"))).tolist()
    for said in ({"translation_mm": translation_mm}, {"extrinsics": {"T_mm": translation_mm}}):
        path = write_text(tmp_path / "c.json", json.dumps({**lists, **said}))
        assert_rows_match_and_depths_come_back(read_raw([path]), RIG, points_ahead(5))


@pytest.mark.parametrize("said", [{"T": [-0.1, 0, 0]}, {"T": [-100, 0, 0]}, {"translation_m": [-0.1, 0, 0]}, {}])
@pytest.mark.parametrize("more", [{"translation_mm": [-100, 0, 0]}, {"baseline_mm": -100}, {"baseline_mm": None}])
def test_a_translation_in_mm_may_stand_beside_matrices_in_another_unit(
    tmp_path: Path, said: dict[str, object], more: dict[str, object]
) -> None:
    """Scripts of people copy T[0], or all of T, in mm, to a name of its own."""
    pair = {"P1": projection(50, 30).tolist(), "P2": projection(50, 33, -5.0).tolist()}
    path = write_text(tmp_path / "c.json", json.dumps({**pair, **said, **more}))
    assert read_rectified(path, Options(rectified=True)).baseline_m == pytest.approx(0.1)


def test_opencv_s_projections_are_read(tmp_path: Path) -> None:
    pair = {"P1": projection(50, 30), "P2": projection(50, 33, -5.0)}
    path = write_opencv(tmp_path / "c.yml", {**pair, "D1": np.zeros((1, 5))})
    calibration = read_rectified(path)
    assert (calibration.baseline_m, calibration.cx_px, calibration.cx_right_px) == (0.1, 30.0, 33.0)
    assert read_rectified(path, Options(calibration_unit="mm")).baseline_m == pytest.approx(1e-4)


def test_what_stereo_rectify_returns_is_read_back(tmp_path: Path) -> None:
    K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    rotation, _ = cv2.Rodrigues(np.array([0.01, 0.02, -0.01]))
    translation = np.array([[-0.12], [0.001], [0.002]])
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K, np.zeros(5), K, np.zeros(5), (640, 480), rotation, translation)
    nodes = {"R": rotation, "T": translation, "R1": R1, "R2": R2, "P1": P1, "P2": P2}
    path = write_opencv(tmp_path / "extrinsics.yml", nodes)
    with pytest.raises(VfoaError, match=r"extrinsics\.yml: .*R1.*rectified = true"):
        read_rectified(path)
    calibration = read_rectified(path, Options(rectified=True))
    assert calibration.baseline_m == pytest.approx(np.linalg.norm(translation))


@pytest.mark.parametrize("xi", [0.0, None])
def test_an_xi_of_0_is_no_other_model(tmp_path: Path, xi: float | None) -> None:
    nodes = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    path = write_yaml(tmp_path / "c.yaml", {**nodes, "xi": xi, "image_size": list(SIZE)})
    assert read_raw([path]).rectified().baseline_m == pytest.approx(np.linalg.norm(RIG.translation_m))
