from __future__ import annotations

import numpy as np
import pytest

from vfoa.crops import center, completed, crop, grow, reaches_border, square


def test_boxes_grow_by_shares_of_themselves() -> None:
    np.testing.assert_allclose(grow([10, 20, 30, 60], side=0.5, top=0.25, bottom=0.0), [0, 10, 40, 60])
    np.testing.assert_allclose(center([10, 20, 30, 60]), [20, 40])
    np.testing.assert_allclose(square((20, 40), 10), [15, 35, 25, 45])


def test_a_crop_holds_what_its_box_holds() -> None:
    image = np.zeros((60, 80, 3), np.uint8)
    image[20:30, 40:60] = 200
    # Edges on pixels' edges, half a pixel before their centres.
    np.testing.assert_array_equal(crop(image, [39.5, 19.5, 59.5, 29.5], 20)[1:-1, 1:-1], 200)
    np.testing.assert_allclose(crop(image, [29.5, 9.5, 69.5, 39.5], 4)[1:3, 1:3], 200 * 10 / 15, atol=3)
    np.testing.assert_array_equal(crop(image, [0, 0, 30, 15], 16), 0)


def test_a_crop_of_pixels_is_those_pixels() -> None:
    image = np.random.default_rng(0).integers(0, 255, (40, 50, 3)).astype(np.uint8)
    np.testing.assert_array_equal(crop(image, [9.5, 4.5, 25.5, 20.5], 16), image[5:21, 10:26])


def test_a_crop_beyond_the_border_repeats_its_pixels() -> None:
    image = np.full((40, 50, 3), 90, np.uint8)
    np.testing.assert_array_equal(crop(image, [-30, -30, 20, 80], 32), 90)


def test_a_crop_turned_with_a_leaning_bar_shows_it_upright() -> None:
    v, u = np.mgrid[:101, :101]
    roll = np.radians(30)
    across = (u - 50) * np.cos(roll) + (v - 50) * np.sin(roll)  # the bar's own right, turned clockwise
    image = np.repeat((np.abs(across) < 4).astype(np.uint8)[..., None] * 255, 3, axis=2)
    upright = crop(image, square((50, 50), 40), 40, roll_rad=roll)[..., 0]
    assert upright[:, 18:22].min() > 200
    assert upright[:, :12].max() == 0


def test_a_crop_of_pixels_that_are_not_square_shows_what_they_show() -> None:
    v, u = np.mgrid[:151, :101]
    roll = np.radians(30)
    across = (u - 50) * np.cos(roll) + (v - 75) / 1.5 * np.sin(roll)
    image = np.repeat((np.abs(across) < 4).astype(np.uint8)[..., None] * 255, 3, axis=2)
    box = square((50, 75), 40, 1.5)
    np.testing.assert_allclose(box, [30, 45, 70, 105])
    upright = crop(image, box, 40, roll_rad=roll, rows_per_column=1.5)[..., 0]
    assert upright[:, 18:22].min() > 200
    assert upright[:, :12].max() == 0
    assert upright[:, 28:].max() == 0


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
