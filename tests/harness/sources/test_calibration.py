"""Two projection matrices as the calibration of a rectified pair, and those that are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.sources.calibration import Calibration, from_projections
from vfoa.errors import VfoaError
from vfoa.types import Float

LEFT = np.array([[700.0, 0, 310, 35], [0, 720.0, 230, 0], [0, 0, 1, 0]])
RIGHT = np.array([[700.0, 0, 325, -49], [0, 720.0, 230, 0], [0, 0, 1, 0]])


def changed(matrix: Float, row: int, column: int, value: float) -> Float:
    matrix = matrix.copy()
    matrix[row, column] = value
    return matrix


def test_every_number_is_taken_from_its_place() -> None:
    assert from_projections(LEFT, RIGHT, "calib", (640, 480)) == Calibration(
        fx_px=700.0,
        fy_px=720.0,
        cx_px=310.0,
        cy_px=230.0,
        cx_right_px=325.0,
        baseline_m=(35 + 49) / 700,
        size_px=(640, 480),
    )


def test_the_last_digit_that_a_file_writes_may_differ() -> None:
    right = changed(changed(RIGHT, 0, 0, 700.0005), 1, 2, 230.0009)
    assert from_projections(LEFT, right, "calib").fx_px == 700.0


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (changed(LEFT, 0, 2, np.nan), RIGHT, "finite matrices"),
        (LEFT, changed(RIGHT, 0, 2, np.nan), "finite matrices"),
        (changed(LEFT, 0, 0, 0), RIGHT, "positive focal lengths"),
        (changed(LEFT, 1, 1, 0), RIGHT, "positive focal lengths"),
        (LEFT, changed(RIGHT, 0, 0, 700.1), "fx is 700 left and 700.1 right"),
        (LEFT, changed(RIGHT, 1, 1, 720.1), "fy is 720 left and 720.1 right"),
        (LEFT, changed(RIGHT, 1, 2, 231), "cy is 230 left and 231 right"),
        (LEFT, changed(RIGHT, 0, 3, 35), "the baseline is 0 m"),
        (LEFT, changed(changed(RIGHT, 0, 3, 35), 1, 3, -3), "stand above each other"),
        (RIGHT, LEFT, r"baseline is -0\.12 m"),
    ],
)
def test_what_is_no_rectified_pair_is_refused(left: Float, right: Float, message: str) -> None:
    with pytest.raises(VfoaError, match=f"calib: .*{message}"):
        from_projections(left, right, "calib")


@pytest.mark.parametrize(
    ("size_px", "changes", "said"),
    [
        ((2, 2), {}, r"2 x 2 pixels.*4 to 16383"),
        ((8, 20_000), {}, "images of 8 x 20000 pixels"),
        ((16_384, 64), {}, "images of 16384 x 64 pixels"),
        ((640, 480), {"fx_px": 1e-308}, "fx, fy: found 1e-308, 720"),
        ((640, 480), {"cy_px": 1e300}, r"cx, cy: found 310, 1e\+300"),
        ((640, 480), {"baseline_m": 1e-300}, "baseline: found 1e-300 m"),
    ],
)
def test_what_no_camera_has_is_refused(size_px: tuple[int, int], changes: dict[str, float], said: str) -> None:
    calibration = replace(from_projections(LEFT, RIGHT, "calib"), **changes)
    with pytest.raises(VfoaError, match=said):
        calibration.rig(*size_px)
