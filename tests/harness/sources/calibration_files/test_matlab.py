"""Calibrations of MATLAB."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.sources.calibration_files.documents import METRES, Unit
from harness.sources.calibration_files.read import Options, find_calibrations
from tests import calibrations
from tests.calibration_formats import assert_rows_match_and_depths_come_back, points_ahead, read_raw, size_px
from tests.calibrations import RIG, SIZE, Rig
from tests.disk import write_text
from vfoa.errors import VfoaError


@pytest.mark.parametrize("write", [calibrations.write_matlab_for_opencv, calibrations.write_toolbox])
def test_small_matrices_of_matlab_s_own_files_are_read(tmp_path: Path, write: Callable[[Path, Rig], Path]) -> None:
    cameras = read_raw([write(tmp_path / "data" / "mine.mat", RIG)])
    assert cameras.left.size_px == SIZE
    assert_rows_match_and_depths_come_back(cameras, RIG, points_ahead(5))
    assert find_calibrations(tmp_path, size_px) == ([("data/mine.mat",)], [])


@pytest.mark.parametrize("unit", ["m", "cm", "mm"])
def test_a_unit_that_is_said_replaces_that_of_matlab_s_file(tmp_path: Path, unit: Unit) -> None:
    """MATLAB writes millimetres wherever nobody has said the unit of the board's squares."""
    path = calibrations.write_matlab(tmp_path / "c.json", RIG)
    expected = 1000 * METRES[unit] * np.linalg.norm(RIG.translation_m)
    assert read_raw([path], Options(calibration_unit=unit)).rectified().baseline_m == pytest.approx(expected, rel=1e-6)


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
        read_raw([write_text(tmp_path / "c.json", json.dumps(struct))])
    assert str(error.value).startswith(str(tmp_path / "c.json"))
