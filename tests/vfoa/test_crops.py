from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_rig
from vfoa.crops import CropCamera, center, completed, grow, reaches_border
from vfoa.geometry import angle_between, back_project, left_from_crop, project, unit
from vfoa.types import Float, Image, StereoFrame, StereoRig


def test_boxes_grow_by_shares_of_themselves() -> None:
    np.testing.assert_allclose(grow([10, 20, 30, 60], side=0.5, top=0.25, bottom=0.0), [0, 10, 40, 60])
    np.testing.assert_allclose(center([10, 20, 30, 60]), [20, 40])


# Crops, from so far that rays are parallel


def frame_of(image: Image, rig: StereoRig) -> StereoFrame:
    return StereoFrame(index=1, time_ns=0, left=image, right=image, rig=rig)


def far_rig(image: Image, rows_per_column: float = 1.0) -> StereoRig:
    height, width = image.shape[:2]
    return replace(make_rig(width, height, fx_px=1e6), fy_px=1e6 * rows_per_column)


def crop(image: Image, box: tuple[float, ...], size: int) -> Image:
    rig = far_rig(image)
    return CropCamera.at(box, rig).image(frame_of(image, rig), size)


def test_a_crop_holds_what_its_box_holds() -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    image[20:30, 40:60] = 200
    # Edges on pixels' edges, half a pixel before their centres.
    np.testing.assert_array_equal(crop(image, (39.5, 19.5, 59.5, 29.5), 20)[1:-1, 1:-1], 200)
    np.testing.assert_allclose(crop(image, (29.5, 9.5, 69.5, 39.5), 4)[1:3, 1:3], 200 * 10 / 15, atol=3)
    np.testing.assert_array_equal(crop(image, (0, 0, 30, 15), 16), 0)


def test_a_crop_of_pixels_is_those_pixels() -> None:
    image = np.random.default_rng(0).integers(0, 255, (40, 50, 3)).astype(np.uint8)
    np.testing.assert_array_equal(crop(image, (9.5, 4.5, 25.5, 20.5), 16), image[5:21, 10:26])


@pytest.mark.parametrize("size", [8, 16, 19, 24])
@pytest.mark.parametrize("shape", [(24, 24), (12, 24), (24, 12)])
def test_a_crop_is_as_bright_as_what_its_box_holds(shape: tuple[int, int], size: int) -> None:
    """No line of the image is left out, or counts twice, whatever the size of a crop."""
    height, width = shape
    box = (9.5, 9.5, 9.5 + width, 9.5 + height)
    for line in range(3, 9):
        image = np.zeros((44, 44, 3), np.uint8)
        image[:, 10 + line] = 240
        assert crop(image, box, size).mean() == pytest.approx(240 / width, rel=0.15)
        assert crop(image.swapaxes(0, 1).copy(), box, size).mean() == pytest.approx(240 / height, rel=0.15)


def test_a_crop_beyond_the_border_repeats_its_pixels() -> None:
    image = np.full((40, 50, 3), 90, np.uint8)
    np.testing.assert_array_equal(crop(image, (-30, -30, 20, 80), 32), 90)


@pytest.mark.parametrize("rows_per_column", [1.0, 1.5])
def test_a_crop_turned_with_a_leaning_bar_shows_it_upright(rows_per_column: float) -> None:
    """Also of pixels that are not square."""
    v, u = np.mgrid[:151, :101]
    roll = np.radians(30)
    across = (u - 50) * np.cos(roll) + (v - 75) / rows_per_column * np.sin(
        roll
    )  # the bar's own right, turned clockwise
    image = np.repeat((np.abs(across) < 4).astype(np.uint8)[..., None] * 255, 3, axis=2)
    rig = far_rig(image, rows_per_column)
    camera = CropCamera.towards(back_project(50, 75, 1, rig), 20 / rig.fx_px)
    upright = camera.image(frame_of(image, rig), 40, roll_rad=roll)[..., 0]
    assert upright[:, 18:22].min() > 200
    assert upright[:, :12].max() == 0
    assert upright[:, 28:].max() == 0


# Crops, beside the axis


beside = st.floats(-50, 50).map(np.radians)


def seen_far_away(rig: StereoRig, scene_from_left: Float) -> StereoFrame:
    """A pattern at infinity, waves of the direction, in three colours."""
    v, u = np.mgrid[: rig.height_px, : rig.width_px]
    rays = unit(back_project(u, v, np.ones(u.shape), rig)) @ scene_from_left.T
    waves = np.sin(25 * rays + [0, 1, 2]) + np.sin(17 * rays[..., [1, 2, 0]])
    return frame_of(np.clip(128 + 60 * waves, 0, 255).astype(np.uint8), rig)


@given(right=beside, down=beside)
def test_a_head_looks_the_same_wherever_in_the_image_it_is(right: float, down: float) -> None:
    """The head is ahead of one camera and beside the axis of another, whose image is cut so that it holds the head."""
    ahead = make_rig(300, 200, fx_px=400)
    box = (120, 65, 180, 135)
    straight = CropCamera.at(box, ahead)
    ray = unit([np.tan(right), np.tan(down), 1])
    turned = left_from_crop(ray) @ left_from_crop(straight.ray_left).T
    u, v = project(ray, ahead)
    aside = replace(ahead, cx_px=ahead.cx_px + 150 - u, cy_px=ahead.cy_px + 100 - v)
    scene = seen_far_away(ahead, np.eye(3))
    first = straight.image(scene, 60)
    second = replace(straight, left_from_crop=left_from_crop(ray)).image(seen_far_away(aside, turned.T), 60)
    np.testing.assert_allclose(second.astype(int), first, atol=4)


@given(right=beside, down=beside, radius=st.floats(0.01, 0.15))
def test_a_camera_looks_at_the_middle_of_its_box(right: float, down: float, radius: float) -> None:
    """A ball's outline from the camera is a cone; its box is not about the ball's middle, but the camera is."""
    rig = make_rig(300, 200, fx_px=400)
    towards = np.array([np.tan(right), np.tan(down), 1])
    edges = [np.tan([angle - radius, angle + radius]) for angle in (right, down)]
    low, high = (project([edges[0][k], edges[1][k], 1], rig) for k in (0, 1))
    camera = CropCamera.at((*low, *high), rig)
    assert angle_between(camera.ray_left, towards) < 0.1 * radius
    np.testing.assert_allclose(np.linalg.det(camera.left_from_crop), 1)


IMAGE = np.zeros((200, 300, 3), np.uint8)


@pytest.mark.parametrize(
    ("seen", "whole"),
    [
        ((0, 60, 40, 160), (-32, 60, 40, 160)),  # 40 of 72 are seen at the left
        ((260, 60, 299, 160), (260, 60, 332, 160)),
        ((100, 0, 172, 30), (100, -70, 172, 30)),
        ((100, 150, 172, 199), (100, 150, 172, 250)),
        ((100, 50, 140, 150), (100, 50, 140, 150)),  # a narrow face in the middle
        ((0, 60, 90, 160), (0, 60, 90, 160)),  # wide enough, at the border
        ((0, 0, 40, 30), (0, 0, 40, 30)),  # in a corner: nobody knows
    ],
)
def test_a_face_cut_by_the_border_goes_on_beyond_it(seen: tuple[int, ...], whole: tuple[int, ...]) -> None:
    np.testing.assert_allclose(completed(seen, IMAGE), whole)


@pytest.mark.parametrize(
    ("box", "cut"),
    [
        ((4, 60, 76, 160), False),
        ((2, 60, 74, 160), True),
        ((225, 60, 297.5, 160), True),
        ((90, -30, 150, 80), True),
        ((90, 92, 162, 192), False),
        ((90, 96, 162, 196), True),
    ],
)
def test_a_box_at_the_border_is_cut(box: tuple[float, ...], cut: bool) -> None:
    assert reaches_border(box, IMAGE) is cut
