"""Solve for both cameras and the pose between them from views of a board, and write the calibration as a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from harness.sources.calibrate.views import BoardView
from harness.sources.calibration import ProjectionError
from harness.sources.rectification import RawCalibration, RawCamera, Rectifier, rectify_pose
from vfoa.errors import VfoaError
from vfoa.types import Float, Image

MIN_VIEWS = 3
"""Zhang's method needs three poses of the plane for all intrinsics."""

OUTLIER_FACTOR, OUTLIER_FLOOR_PX = 4.0, 1.0
"""A view is bad if one of its errors exceeds this multiple of the median, and this many pixels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewErrors:
    """Errors of one view, pixels: re-projection RMS of the worse camera, mean distance from epipolar lines."""

    rms_px: float
    epipolar_px: float


@dataclass(frozen=True, kw_only=True)
class StereoCalibration:
    """The pair in OpenCV's terms: x_right = R x_left + T, metres.

    ``rms_px`` is stereoCalibrate's re-projection error over all views; ``errors`` are those of each used frame,
    ``dropped`` the reasons of the others.
    """

    size_px: tuple[int, int]
    K1: Float
    D1: Float
    K2: Float
    D2: Float
    R: Float
    T: Float
    rms_px: float
    errors: dict[int, ViewErrors]
    dropped: dict[int, str]

    @cached_property
    def rectification(self) -> RawCalibration:
        """The pair with R1 R2 P1 P2; :class:`VfoaError` if the cameras are not side by side, left before right."""
        left, right = (
            RawCamera(size_px=self.size_px, k=k, d=d.ravel()) for k, d in ((self.K1, self.D1), (self.K2, self.D2))
        )
        try:
            return rectify_pose(left, right, self.R, self.T.ravel(), "calibration")
        except ProjectionError as error:  # the corners of the board say that the views are exchanged
            raise VfoaError(f"{error} (left and right swapped?)") from None

    @property
    def epipolar_px(self) -> float:
        """Mean epipolar error over the used frames, pixels."""
        return float(np.mean([error.epipolar_px for error in self.errors.values()]))


def solve(views: Sequence[BoardView], size_px: tuple[int, int]) -> StereoCalibration:
    """Calibrate; while a view stands out by its errors, drop the worst and solve again.

    Raises
    ------
    VfoaError
        If there are fewer than three views, or fewer remain, or OpenCV finds no solution.
    """
    kept = list(views)
    dropped: dict[int, str] = {}
    while True:
        if len(kept) < MIN_VIEWS:
            raise VfoaError(
                f"found {len(kept)} usable views of the board; expected at least {MIN_VIEWS}: check --columns and "
                "--rows (and --dictionary of ChArUco), or take more pictures"
            )
        calibration = _solve(kept, size_px, dropped)
        worst = _worst(calibration.errors)
        if not worst:
            return calibration
        dropped |= worst
        kept = [view for view in kept if view.number not in worst]


def _worst(errors: dict[int, ViewErrors]) -> dict[int, str]:
    """Return the view that exceeds its limit most, relative to the limit, and the reason; empty if none does."""
    worst, excess = dict[int, str](), 1.0
    for kind, name in (("rms_px", "re-projection"), ("epipolar_px", "epipolar")):
        values = {number: float(getattr(view_errors, kind)) for number, view_errors in errors.items()}
        limit = max(OUTLIER_FLOOR_PX, OUTLIER_FACTOR * float(np.median([*values.values()])))
        for number, value in values.items():
            if value / limit > excess:
                excess = value / limit
                worst = {number: f"{name} error {value:.2f} px; expected at most {limit:.2f}"}
    return worst


def _solve(views: Sequence[BoardView], size_px: tuple[int, int], dropped: dict[int, str]) -> StereoCalibration:
    points = [view.points_m.astype(np.float32) for view in views]
    left = [view.left_px.astype(np.float32)[:, None] for view in views]
    right = [view.right_px.astype(np.float32)[:, None] for view in views]
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-6)
    flags, threads = cv2.CALIB_USE_INTRINSIC_GUESS, cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)  # with several, the last digits differ from run to run
        _, K1, D1, *_ = cv2.calibrateCamera(points, left, size_px, None, None)
        _, K2, D2, *_ = cv2.calibrateCamera(points, right, size_px, None, None)
        rms, K1, D1, K2, D2, R, T, _, F, _, _, errors = cv2.stereoCalibrateExtended(
            points, left, right, K1, D1, K2, D2, size_px, np.eye(3), np.zeros((3, 1)), criteria=stop, flags=flags
        )
    except cv2.error as error:
        raise VfoaError(f"OpenCV finds no calibration for {len(views)} views: {error.err}; add other poses") from None
    finally:
        cv2.setNumThreads(threads)
    return StereoCalibration(
        size_px=size_px,
        K1=K1,
        D1=D1,
        K2=K2,
        D2=D2,
        R=R,
        T=T,
        rms_px=float(rms),
        errors={
            view.number: ViewErrors(rms_px=float(max(of_view)), epipolar_px=_epipolar_px(view, K1, D1, K2, D2, F))
            for view, of_view in zip(views, errors, strict=True)
        },
        dropped=dropped,
    )


def _epipolar_px(view: BoardView, K1: Float, D1: Float, K2: Float, D2: Float, F: Float) -> float:
    """Mean distance of undistorted corners from their partners' lines, over both pictures."""
    left = cv2.undistortPoints(view.left_px[:, None], K1, D1, P=K1)[:, 0]
    right = cv2.undistortPoints(view.right_px[:, None], K2, D2, P=K2)[:, 0]
    left, right = (np.hstack([points, np.ones((len(points), 1))]) for points in (left, right))
    lines_right, lines_left = left @ F.T, right @ F
    product = np.abs(np.sum(right * lines_right, axis=1))
    to_right, to_left = (product / np.hypot(lines[:, 0], lines[:, 1]) for lines in (lines_right, lines_left))
    return float(np.mean([to_right, to_left]))


def format_calibration(calibration: StereoCalibration) -> str:
    """Return a file's text: size, intrinsics, distortion, pose, rectification; metres."""
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in zip(("image_width", "image_height"), calibration.size_px, strict=True):
        storage.write(name, value)
    for name in ("K1", "D1", "K2", "D2", "R", "T"):
        storage.write(name, getattr(calibration, name))
    left, right = calibration.rectification.left, calibration.rectification.right
    for name, matrix in {"R1": left.r, "R2": right.r, "P1": left.p, "P2": right.p}.items():
        storage.write(name, matrix)
    return str(storage.releaseAndGetString())


def rectified_preview(rectifier: Rectifier, left: Image, right: Image) -> Image:
    """The rectified pair side by side (H, 2 W, 3) RGB, with 16 green rows."""
    picture = np.hstack(rectifier.rectify(left, right))
    for row in np.linspace(0, picture.shape[0] - 1, 18)[1:-1].astype(int):
        cv2.line(picture, (0, int(row)), (picture.shape[1] - 1, int(row)), (0, 255, 0), 1)
    return picture
