from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vfoa.coco import STUFF, THINGS
from vfoa.errors import VfoaError
from vfoa.segmentation.canvas import Canvas, wanted_categories
from vfoa.segmentation.placement import letterboxed, pixel_box, resample, stretched

sides = st.integers(8, 200)


def ramps(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """The position of each cell's centre over a grid, from 0 at one edge to 1 at the other, along u and v."""
    u, v = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    return np.tile(u, (height, 1)).astype(np.float32), np.tile(v[:, None], (1, width)).astype(np.float32)


@given(width=sides, height=sides, centered=st.booleans(), grid=st.sampled_from([16, 24, 64]))
def test_a_grid_over_the_input_comes_back_to_where_the_image_lies(
    width: int, height: int, centered: bool, grid: int
) -> None:
    image = np.full((height, width, 3), 255, np.uint8)
    for canvas, placement in (
        letterboxed(image, (96, 128), fill=(0, 0, 0), centered=centered),
        stretched(image, (96, 128)),
    ):
        inside = np.argwhere(canvas[..., 0] == 255)
        (top, left), (bottom, right) = inside.min(axis=0), inside.max(axis=0) + 1
        np.testing.assert_allclose(placement.to_image([left, top, right, bottom]), [[0, 0, width, height]], atol=1e-9)
        along_u, along_v = (placement.whole(ramp) for ramp in ramps(grid, grid))
        expected_u = (left + (np.arange(width) + 0.5) / width * (right - left)) / 128
        expected_v = (top + (np.arange(height) + 0.5) / height * (bottom - top)) / 96
        # Beyond the outermost centres of cells the border is repeated; OpenCV rounds positions to 1/32 of a cell.
        limit = 0.5 / grid
        tolerance = 1 / 16 / grid
        np.testing.assert_allclose(along_u[height // 2], np.clip(expected_u, limit, 1 - limit), atol=tolerance)
        np.testing.assert_allclose(along_v[:, width // 2], np.clip(expected_v, limit, 1 - limit), atol=tolerance)


def test_a_letterbox_keeps_the_images_shape_and_fills_the_rest() -> None:
    image = np.full((50, 100, 3), 200, np.uint8)
    corner, _ = letterboxed(image, (64, 64), fill=(1, 2, 3))
    assert (corner[:32] == 200).all()
    assert (corner[32:] == [1, 2, 3]).all()
    middle, _ = letterboxed(image, (64, 64), fill=(1, 2, 3), centered=True)
    assert (middle[16:48] == 200).all()
    assert (middle[:16] == [1, 2, 3]).all()


def test_a_grid_of_the_images_own_size_is_not_touched() -> None:
    grid = np.random.default_rng(0).normal(size=(7, 9)).astype(np.float32)
    np.testing.assert_array_equal(resample(grid, [0, 0, 9, 7], (0, 0, 9, 7)), grid)
    np.testing.assert_array_equal(resample(grid, [10, 20, 19, 27], (12, 21, 15, 26)), grid[1:6, 2:5])


def test_the_window_of_a_box_ends_at_the_image() -> None:
    assert pixel_box([-3.0, 1.6, 4.4, 99], (50, 40)) == (0, 2, 4, 50)
    assert pixel_box([41, 0, 60, 50], (50, 40)) is None
    assert pixel_box([3.1, 3.1, 3.2, 9], (50, 40)) is None


def test_a_canvas_gives_each_pixel_to_the_first_and_leaves_out_what_is_mostly_hidden() -> None:
    canvas = Canvas((2, 4), max_hidden=0.5)
    row = np.array([[True, True, False, False], [False] * 4])
    canvas.paint(row, 1, 0.9)
    canvas.paint(np.roll(row, 1, axis=1), 16, 0.8)  # half of it is hidden
    canvas.paint(np.array([[True, True, True, True], [False] * 4]), 47, 0.7)  # three quarters are
    canvas.paint(np.zeros((2, 4), bool), 2, 0.6)
    canvas.paint(np.array([[True]]), 187, 0.5, window=(3, 1, 4, 2))
    found = canvas.instances()
    assert [(instance.id, instance.label, instance.is_thing) for instance in found.instances] == [
        (1, "person", True),
        (2, "bird", True),
        (3, "sky-other-merged", False),
    ]
    np.testing.assert_array_equal(found.ids, [[1, 1, 2, 0], [0, 0, 0, 3]])
    np.testing.assert_array_equal(canvas.free, found.ids == 0)


def test_labels_are_categories_by_name() -> None:
    assert wanted_categories((), THINGS) == frozenset(THINGS)
    assert wanted_categories(("cup", "person"), THINGS) == {1, 47}
    assert wanted_categories(("sea",), {**THINGS, **STUFF}) == {155}
    with pytest.raises(VfoaError, match="labels: no thing 'sea' in COCO"):
        wanted_categories(("sea",), THINGS)
    with pytest.raises(VfoaError, match=r"labels: no category 'se' in COCO.*'sea'"):
        wanted_categories(("se",), {**THINGS, **STUFF})
