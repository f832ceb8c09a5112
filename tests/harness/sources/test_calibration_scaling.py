"""A calibration for images of another resolution."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from harness.sources.rectification import RawCalibration, RawCamera, rectify_pose, scaled_to, scaling_note
from tests.calibrations import RIG, SIZE
from vfoa.errors import VfoaError

HALF = (SIZE[0] // 2, SIZE[1] // 2)


def _cameras() -> RawCalibration:
    left, right = (RawCamera(size_px=SIZE, k=k, d=d) for k, d in zip(RIG.k, RIG.d, strict=True))
    return rectify_pose(left, right, RIG.rotation, RIG.translation_m, "rig")


def test_points_of_half_size_images_are_rectified_to_half_the_place() -> None:
    cameras = _cameras()
    points = np.random.default_rng(0).uniform((-0.3, -0.3, 1.2), (0.3, 0.3, 1.8), (50, 3))
    half = scaled_to(cameras, HALF)
    assert isinstance(half, RawCalibration)
    for camera, small, seen in zip(
        (cameras.left, cameras.right), (half.left, half.right), RIG.project(points), strict=True
    ):
        whole = cv2.undistortPoints(seen[:, None], camera.k, camera.d, R=camera.r, P=camera.p)[:, 0]
        of_half = (seen + 0.5) / 2 - 0.5
        found = cv2.undistortPoints(of_half[:, None], small.k, small.d, R=small.r, P=small.p)[:, 0]
        np.testing.assert_allclose(found, (whole + 0.5) / 2 - 0.5, atol=1e-4)
    assert half.rectified().baseline_m == pytest.approx(cameras.rectified().baseline_m)


def test_its_own_size_changes_nothing() -> None:
    cameras = _cameras()
    assert scaled_to(cameras, SIZE) is cameras
    assert scaling_note(cameras, SIZE) == ()


@pytest.mark.parametrize("size", [(640, 480), (1280, 719 - 10), (720, 1280)])
def test_another_aspect_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(VfoaError, match="another aspect"):
        scaled_to(_cameras(), size)
