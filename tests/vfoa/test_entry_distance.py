"""Ray against box, where it is decided: on faces, edges and corners, inside, behind, along."""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.scenes import entry_distance, make_box


def exact_entry(origin: tuple[int, ...], direction: tuple[int, ...]) -> Fraction | None:
    """The same for the cube from -1 to 1, by clipping the ray with exact fractions."""
    near, far = Fraction(0), Fraction(10**9)
    for position, speed in zip(origin, direction, strict=True):
        if speed == 0:
            if abs(position) > 1:
                return None
        else:
            low, high = sorted((Fraction(-1 - position, speed), Fraction(1 - position, speed)))
            near, far = max(near, low), min(far, high)
    return near if near <= far else None


def test_it_is_exact_on_a_grid_through_every_face_edge_and_corner():
    cube = (make_box((0, 0, 0), 1.0),)
    directions = [direction for direction in product((-2, -1, 0, 1, 2), repeat=3) if any(direction)]
    for origin in product((-2, -1, 0, 1, 2), repeat=3):
        found = entry_distance(origin, np.array(directions, dtype=float), cube)[:, 0]
        expected = [exact_entry(origin, direction) for direction in directions]
        np.testing.assert_array_equal(found, [np.nan if t is None else float(t) for t in expected])


@given(st.integers(0, 2**32 - 1))
def test_a_turn_of_ray_and_boxes_together_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    origin, directions = rng.normal(size=3), rng.normal(size=(50, 3))
    centers, sizes, axes = rng.normal(size=(4, 3)), rng.uniform(0.1, 1, (4, 3)), Rotation.random(4, rng=rng).as_matrix()
    still = tuple(map(make_box, centers, sizes, axes))
    turned = tuple(map(make_box, centers @ turn.T, sizes, turn @ axes))
    np.testing.assert_allclose(
        entry_distance(turn @ origin, directions @ turn.T, turned),
        entry_distance(origin, directions, still),
        atol=1e-9,
    )


@pytest.mark.parametrize("tiny", [5e-324, 1e-310, 1e-200, 1e-100])
def test_a_component_too_small_to_invert_is_no_component(tiny):
    boxes = (make_box((0, 0, 5), 1.0), make_box((3, 0, 5), 1.0))
    found = entry_distance((0, 0, 0), np.array([[tiny, -tiny, 1.0]]), boxes)
    np.testing.assert_array_equal(found, [[4.0, np.nan]])


def test_no_boxes_or_no_rays_is_an_empty_table():
    assert entry_distance((0, 0, 0), np.ones((5, 3)), ()).shape == (5, 0)
    assert entry_distance((0, 0, 0), np.ones((0, 3)), (make_box((0, 0, 1)),)).shape == (0, 1)
