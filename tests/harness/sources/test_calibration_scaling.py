"""A calibration for images of another resolution."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from harness.sources.calibration import Calibration
from harness.sources.rectification import (
    RawCalibration,
    RawCamera,
    rectify_pose,
    scaled_to,
    scaling_note,
    shrinking_note,
)
from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from tests.calibrations import RIG, SIZE, write_opencv
from tests.disk import write_image
from vfoa.errors import VfoaError
from vfoa.validation import parse

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


@pytest.mark.parametrize("size", [HALF, (3 * SIZE[0], 3 * SIZE[1])])
def test_a_rectified_pair_scales_as_its_cameras_do(size: tuple[int, int]) -> None:
    cameras = _cameras()
    found, expected = scaled_to(cameras.rectified(), size), scaled_to(cameras, size).rectified()
    assert isinstance(found, Calibration)
    assert found.size_px == expected.size_px == size
    assert asdict(replace(found, size_px=None)) == pytest.approx(asdict(replace(expected, size_px=None)))


def test_its_own_size_changes_nothing() -> None:
    cameras = _cameras()
    assert scaled_to(cameras, SIZE) is cameras
    assert scaling_note(cameras, SIZE) == ()


@pytest.mark.parametrize(("focal_px", "is_noted"), [(190.0, True), (400.0, False)])
def test_what_rectification_takes_of_a_wide_lens_is_noted(tmp_path: Path, focal_px: float, is_noted: bool) -> None:
    """A fisheye lens of 154 degrees across its images, and one of 73."""
    k = np.array([[focal_px, 0, 255.5], [0, focal_px, 255.5], [0, 0, 1]])
    lens = RawCamera(size_px=(512, 512), k=k, d=np.zeros(4), model="equidistant")
    cameras = rectify_pose(lens, lens, np.eye(3), np.array([-0.1, 0, 0]), "rig")
    assert bool(shrinking_note(cameras)) == is_noted
    assert (cameras.left.p[0, 0] < focal_px / 2) == is_noted
    assert shrinking_note(cameras.rectified()) == ()
    for side in ("left", "right"):
        write_image(tmp_path / side / "0001.png", np.full((512, 512, 3), 128, np.uint8))
    nodes = {"K1": k, "K2": k, "D1": lens.d, "D2": lens.d, "R": np.eye(3), "T": np.array([-0.1, 0, 0])}
    write_opencv(tmp_path / "rig.yml", nodes)
    source = {"left": "left", "right": "right", "calibration": "rig.yml", "fisheye": True}
    clip = StereoFolderClip(parse(StereoFolderSettings, source, "source"), tmp_path)
    assert set(shrinking_note(cameras)) == {note for note in clip.notes if "rectification" in note}


@pytest.mark.parametrize("size", [(640, 480), (1280, 719 - 10), (720, 1280)])
def test_another_aspect_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(VfoaError, match="another aspect"):
        scaled_to(_cameras(), size)
