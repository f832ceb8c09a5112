from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from harness.sources.rectification import RawCalibration, RawCamera, Rectifier
from vfoa.errors import VfoaError
from vfoa.types import Float, Image

WIDTH, HEIGHT = 160, 120
NEW = np.array([[180.0, 0, 79.5], [0, 180.0, 59.5], [0, 0, 1]])
K = np.array([[150.0, 0, 82.0], [0, 152.0, 57.0], [0, 0, 1]])


def _camera(degrees: float, fourth: float, model: str = "plumb_bob", d: tuple[float, ...] = (-0.2, 0.05, 0.001, 0, 0)):
    r = cv2.Rodrigues(np.radians([degrees, -degrees, degrees / 2]))[0]
    p = np.column_stack([NEW, [fourth, 0, 0]])
    return RawCamera(size_px=(WIDTH, HEIGHT), k=K, d=np.array(d), r=r, p=p, model=model)


def _pair(model: str = "plumb_bob", d: tuple[float, ...] = (-0.2, 0.05, 0.001, 0, 0)) -> RawCalibration:
    return RawCalibration(left=_camera(3, 0, model, d), right=_camera(-2, -18.0, model, d), where="cameras")


def _far_scene(directions: Float) -> Image:
    """A smooth world at infinity: its colour depends on the direction (..., 3) in the rectified frame alone."""
    x, y = directions[..., 0] / directions[..., 2], directions[..., 1] / directions[..., 2]
    colours = np.stack([np.sin(6 * x), np.cos(5 * y), np.sin(4 * (x + y))], axis=-1)
    return np.round(127.5 + 100 * colours).astype(np.uint8)


def _pixels() -> Float:
    return np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).astype(np.float64)


def _seen_by(camera: RawCamera) -> Image:
    flat = _pixels().reshape(-1, 1, 2)
    undistort = cv2.fisheye.undistortPoints if camera.model == "equidistant" else cv2.undistortPoints
    rays = np.concatenate([undistort(flat, camera.k, camera.d)[:, 0], np.ones((flat.shape[0], 1))], axis=1)
    return _far_scene((rays @ camera.r.T).reshape(HEIGHT, WIDTH, 3))


@pytest.mark.parametrize(
    ("model", "d"), [("plumb_bob", (-0.2, 0.05, 0.001, 0, 0)), ("equidistant", (0.02, -0.01, 0.001, 0))]
)
def test_both_views_of_a_far_scene_become_the_same_pin_hole_image(model: str, d: tuple[float, ...]) -> None:
    calibration = _pair(model, d)
    views = Rectifier(calibration).rectify(_seen_by(calibration.left), _seen_by(calibration.right))
    rays = np.concatenate([_pixels(), np.ones((HEIGHT, WIDTH, 1))], axis=-1) @ np.linalg.inv(NEW).T
    expected = _far_scene(rays).astype(int)
    inside = np.s_[15:-15, 15:-15]
    for view in views:
        assert np.abs(view.astype(int) - expected)[inside].max() <= 3
    assert np.abs(_seen_by(calibration.left).astype(int) - expected)[inside].max() > 30


def test_the_right_camera_s_fourth_column_holds_the_baseline() -> None:
    calibration = Rectifier(_pair()).calibration
    assert calibration.baseline_m == pytest.approx(0.1)
    assert (calibration.fx_px, calibration.cx_px, calibration.size_px) == (180.0, 79.5, (WIDTH, HEIGHT))


def test_rectified_images_pass_untouched() -> None:
    def rectified(fourth: float) -> RawCamera:
        p = np.column_stack([NEW, [fourth, 0, 0]])
        return RawCamera(size_px=(WIDTH, HEIGHT), k=NEW, d=np.zeros(0), r=np.eye(3), p=p)

    image = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    pair = RawCalibration(left=rectified(0), right=rectified(-18), where="cameras")
    left, right = Rectifier(pair).rectify(image, image)
    assert left is image
    assert right is image


def test_a_rotation_of_four_decimals_is_one() -> None:
    camera = _camera(3, 0)
    rounded = dataclasses.replace(camera, r=camera.r.round(4))
    assert RawCalibration(left=rounded, right=_camera(-2, -18.0), where="cameras").left is rounded


def test_only_what_would_change_no_pixel_counts_as_rectified() -> None:
    straight = RawCamera(
        size_px=(WIDTH, HEIGHT), k=NEW, d=np.zeros(5), r=np.eye(3), p=np.column_stack([NEW, [-18.0, 0, 0]])
    )
    turned = cv2.Rodrigues(np.array([0.01, 0, 0]))[0]
    assert straight.is_rectified
    for change in ({"d": np.array([-0.1, 0, 0, 0])}, {"r": turned}, {"k": K}):
        assert not dataclasses.replace(straight, **change).is_rectified


def test_an_image_of_another_size_is_refused() -> None:
    image = np.zeros((HEIGHT, WIDTH + 1, 3), np.uint8)
    with pytest.raises(VfoaError, match=r"cameras: left image of 161 x 120 pixels; expected 160 x 120"):
        Rectifier(_pair()).rectify(image, image)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"r": np.ones((3, 3))}, "left: R: not a rotation"),
        ({"r": np.diag([1.0, 1, -1])}, "left: R: not a rotation"),
        ({"r": np.eye(2)}, "left: R: found shape"),
        ({"d": np.array([0.1, np.nan, 0, 0])}, "left: D: found 4 coefficients"),
        ({"p": np.full((3, 4), np.nan)}, "left: P: found shape"),
        ({"k": K[:2]}, "left: K: found shape"),
        ({"k": np.diag([500.0, 0, 1])}, "left: K: found focal lengths 500, 0"),
        ({"d": np.zeros(3)}, "left: D: found 3 coefficients"),
        ({"p": np.eye(3)}, "left: P: found shape"),
        ({"k": np.zeros((3, 3))}, "left: K: found focal lengths"),
        ({"size_px": (10, 10)}, "expected the same"),
        ({"p": np.column_stack([NEW, [-99.0, 0, 0]])}, "expected a positive one"),
    ],
)
def test_wrong_calibrations_are_refused(change: dict[str, object], message: str) -> None:
    pair = _pair()
    with pytest.raises(VfoaError, match=message):
        RawCalibration(left=dataclasses.replace(pair.left, **change), right=pair.right, where="cameras")
