"""Both cameras and the pose between them from views of a board; views that do not fit are dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from harness.calibration.corners import Board, Dropped, View
from vfoa.errors import VfoaError
from vfoa.types import Float

MIN_VIEWS = 3
"""Zhang's method needs three poses of the plane for all intrinsics."""

OUTLIER_FACTOR, OUTLIER_FLOOR_PX = 4.0, 1.0
"""A view is bad if its epipolar error exceeds this many medians, and this many pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoCalibration:
    """The pair as OpenCV has it: x_right = R x_left + T, metres; R1 R2 P1 P2 rectify it.

    ``rms_px`` is stereoCalibrate's re-projection error over all views. ``epipolar_px`` is, per used frame, the mean
    distance of a corner from the epipolar line of its partner.
    """

    size_px: tuple[int, int]
    K1: Float
    D1: Float
    K2: Float
    D2: Float
    R: Float
    T: Float
    R1: Float
    R2: Float
    P1: Float
    P2: Float
    rms_px: float
    epipolar_px: dict[int, float]
    dropped: tuple[Dropped, ...] = ()


def solve(views: Sequence[View], board: Board, size_px: tuple[int, int]) -> StereoCalibration:
    """Calibrate; while a view stands out by its epipolar error, drop the worst and solve again.

    Raises
    ------
    VfoaError
        If fewer than three views are there or remain.
    """
    kept = list(views)
    dropped: list[Dropped] = []
    while True:
        if len(kept) < MIN_VIEWS:
            reasons = "".join(f"; frame {each.number}: {each.reason}" for each in dropped)
            raise VfoaError(f"{len(kept)} usable views of the board; expected at least {MIN_VIEWS}{reasons}")
        found = _solve(kept, board, size_px, tuple(dropped))
        worst = max(kept, key=lambda view: found.epipolar_px[view.number])
        error = found.epipolar_px[worst.number]
        if error <= max(OUTLIER_FLOOR_PX, OUTLIER_FACTOR * float(np.median([*found.epipolar_px.values()]))):
            return found
        kept.remove(worst)
        dropped.append(Dropped(number=worst.number, reason=f"epipolar error {error:.2f} px, far above the others'"))


def rectified_rows_px(calibration: StereoCalibration, view: View) -> Float:
    """Row differences (N,), pixels, of a view's corners after rectification: right minus left."""
    c = calibration
    left = cv2.undistortPoints(view.left_px[:, None], c.K1, c.D1, R=c.R1, P=c.P1)[:, 0, 1]
    right = cv2.undistortPoints(view.right_px[:, None], c.K2, c.D2, R=c.R2, P=c.P2)[:, 0, 1]
    return np.asarray(right - left, dtype=np.float64)


def _solve(
    views: Sequence[View], board: Board, size_px: tuple[int, int], dropped: tuple[Dropped, ...]
) -> StereoCalibration:
    points = [board.points_m().astype(np.float32)] * len(views)
    left = [view.left_px.astype(np.float32)[:, None] for view in views]
    right = [view.right_px.astype(np.float32)[:, None] for view in views]
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-6)
    _, K1, D1, *_ = cv2.calibrateCamera(points, left, size_px, None, None)
    _, K2, D2, *_ = cv2.calibrateCamera(points, right, size_px, None, None)
    rms, K1, D1, K2, D2, R, T, _, F = cv2.stereoCalibrate(
        points, left, right, K1, D1, K2, D2, size_px, criteria=stop, flags=cv2.CALIB_USE_INTRINSIC_GUESS
    )
    R1, R2, P1, P2, *_ = cv2.stereoRectify(K1, D1, K2, D2, size_px, R, T, alpha=0)
    return StereoCalibration(
        size_px=size_px,
        K1=K1,
        D1=D1,
        K2=K2,
        D2=D2,
        R=R,
        T=T,
        R1=R1,
        R2=R2,
        P1=P1,
        P2=P2,
        rms_px=float(rms),
        epipolar_px={view.number: _epipolar_px(view, K1, D1, K2, D2, F) for view in views},
        dropped=dropped,
    )


def _epipolar_px(view: View, K1: Float, D1: Float, K2: Float, D2: Float, F: Float) -> float:
    """Mean distance of undistorted corners from their partners' lines, over both pictures."""
    left = cv2.undistortPoints(view.left_px[:, None], K1, D1, P=K1)[:, 0]
    right = cv2.undistortPoints(view.right_px[:, None], K2, D2, P=K2)[:, 0]
    left, right = (np.hstack([points, np.ones((len(points), 1))]) for points in (left, right))
    lines_right, lines_left = left @ F.T, right @ F
    product = np.abs(np.sum(right * lines_right, axis=1))
    to_right, to_left = (product / np.hypot(lines[:, 0], lines[:, 1]) for lines in (lines_right, lines_left))
    return float(np.mean([to_right, to_left]))
