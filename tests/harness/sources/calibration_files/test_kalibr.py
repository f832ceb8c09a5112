"""Kalibr's chains of cameras."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from harness.sources.calibration_files.read import Options, find_calibrations, read_cameras
from tests.calibration_formats import (
    FORMATS,
    assert_rows_match_and_depths_come_back,
    points_ahead,
    read_raw,
    size_px,
)
from tests.calibrations import RIG, opencv_nodes, write_yaml
from tests.disk import write_text
from vfoa.errors import VfoaError


def test_kalibr_s_chain_is_followed_and_turned_round(tmp_path: Path) -> None:
    """cam0 stands right of cam1, which stands right of cam2, 0.1 m each, so that cam2 and cam0 are 0.2 m apart."""
    step = np.eye(4)
    step[0, 3] = 0.1  # x_cam1 = x_cam0 + 0.1: cam1 is to the left
    camera = {"camera_model": "pinhole", "intrinsics": [500, 500, 320, 240], "resolution": [640, 480]}
    camera |= {"distortion_model": "none", "distortion_coeffs": []}
    left_of = {**camera, "T_cn_cnm1": step.tolist()}
    path = write_yaml(tmp_path / "chain.yaml", {"cam0": camera, "cam1": left_of, "cam2": left_of})
    assert read_raw([path], Options(calibration_cameras=(1, 0))).rectified().baseline_m == pytest.approx(0.1)
    assert read_raw([path], Options(calibration_cameras=(2, 0))).rectified().baseline_m == pytest.approx(0.2)
    with pytest.raises(VfoaError, match=r"chain\.yaml: the baseline is -0\.1 m"):
        read_cameras([path], size_px)
    with pytest.raises(VfoaError, match=r"no cam3; .*cam0, cam1, cam2"):
        read_cameras([path], size_px, Options(calibration_cameras=(3, 0)))


def test_a_table_of_something_else_of_the_cameras_is_no_chain(tmp_path: Path) -> None:
    serials = {"cam0": {"serial": 4011}, "cam1": {"serial": 4012}}
    matrices = {name: value.tolist() for name, value in opencv_nodes(RIG).items()}
    opencv = write_yaml(tmp_path / "c.yaml", matrices | {"cameras": serials})
    assert_rows_match_and_depths_come_back(read_raw([opencv]), RIG, points_ahead(3))
    nested = FORMATS["kalibr, as D-Robotics nests it"](tmp_path)[0]
    write_yaml(nested, {"cameras": serials, **yaml.safe_load(nested.read_text(encoding="utf-8"))})
    assert_rows_match_and_depths_come_back(read_raw([nested]), RIG, points_ahead(3))


def test_a_chain_beside_the_images_may_begin_with_the_right_camera(tmp_path: Path) -> None:
    path = FORMATS["kalibr"](tmp_path)[0]
    chain = yaml.safe_load(path.read_text(encoding="utf-8"))
    left_from_right = np.linalg.inv(chain["cam1"].pop("T_cn_cnm1")).tolist()
    turned = {"cam0": chain["cam1"], "cam1": chain["cam0"] | {"T_cn_cnm1": left_from_right}}
    write_text(path, yaml.safe_dump(turned))
    assert find_calibrations(tmp_path, size_px)[0] == []
    assert find_calibrations(tmp_path, size_px, Options(calibration_cameras=(1, 0)))[0] == [(path.name,)]
