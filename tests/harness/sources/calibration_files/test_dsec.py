"""DSEC's calibration of two cameras of frames and two of events."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.read import Options, find_calibrations, read_cameras
from tests.calibrations import write_yaml
from vfoa.errors import VfoaError

EVENTS = Options(calibration_cameras=(0, 3))


def _camera(focal: float, cx: float, cy: float, size: list[int]) -> dict[str, Any]:
    return {"camera_model": "pinhole", "camera_matrix": [focal, focal, cx, cy], "resolution": size}


def _q(focal: float, cx: float, cy: float, baseline_m: float) -> list[list[float]]:
    return [[1.0, 0, 0, -cx], [0, 1.0, 0, -cy], [0, 0, 0, focal], [0, 0, 1 / baseline_m, 0]]


def _content() -> dict[str, Any]:
    """As in its files; the cameras before rectification are other ones, and must not count."""
    raw = {"distortion_model": "radtan", "distortion_coeffs": [-0.1, 0.2, 0, 0]}
    events, frames = _camera(570, 335, 221, [640, 480]), _camera(1164, 713, 570, [1440, 1080])
    before = {f"cam{n}": _camera(n + 500, 300, 200, [640, 480]) | raw for n in range(4)}
    return {
        "intrinsics": before | {"camRect0": events, "camRect1": frames, "camRect2": frames, "camRect3": events},
        "extrinsics": {"T_10": [[1, 0, 0, -0.04], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
        "disparity_to_depth": {"cams_03": _q(570, 335, 221, 0.6), "cams_12": _q(1164, 713, 570, 0.51)},
    }


def test_the_rectified_pair_is_read(tmp_path: Path) -> None:
    path = write_yaml(tmp_path / "cam_to_cam.yaml", _content())
    found = read_cameras([path], lambda: (1440, 1080))
    assert isinstance(found, Calibration)
    assert (found.fx_px, found.fy_px, found.cx_px, found.cy_px, found.cx_right_px) == (1164, 1164, 713, 570, 713)
    assert found.baseline_m == pytest.approx(0.51)
    assert found.size_px == (1440, 1080)
    events = read_cameras([path], lambda: (640, 480), EVENTS)
    assert isinstance(events, Calibration)
    assert (events.fx_px, events.baseline_m) == (570, pytest.approx(0.6))
    assert find_calibrations(tmp_path, lambda: (1440, 1080)) == ([(path.name,)], [])


@pytest.mark.parametrize(
    ("table", "name", "value", "options", "message"),
    [
        ("intrinsics", "camRect2", {}, Options(), r"camRect2: no camera_matrix"),
        ("disparity_to_depth", "cams_03", [0] * 16, EVENTS, r"cams_03: found 0 .*positive"),
        ("disparity_to_depth", "cams_12", [0] * 4, Options(), r"cams_12: found 4 numbers"),
        ("intrinsics", "other", {}, Options(calibration_cameras=(1, 3)), r"disparity_to_depth: no cams_13"),
    ],
)
def test_a_value_that_is_missing_or_wrong_is_named(
    table: str, name: str, value: object, options: Options, message: str, tmp_path: Path
) -> None:
    content = _content()
    content[table][name] = value
    path = write_yaml(tmp_path / "cam_to_cam.yaml", content)
    with pytest.raises(VfoaError, match=message):
        read_cameras([path], lambda: (1440, 1080), options)
