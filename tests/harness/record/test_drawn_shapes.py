"""Shapes that recordings draw: cones as lines, and masks as pictures of any size."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from harness.record.appearance import RIM, Colours, cone_wires
from harness.record.images import MOST_COLOURS, painted
from vfoa.geometry import unit
from vfoa.types import Cone

ANGLES = st.floats(0.02, 2.5)
POINTS = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)
DIRECTIONS = POINTS.filter(lambda point: np.linalg.norm(point) > 0.1).map(unit)


@given(st.lists(st.tuples(POINTS, DIRECTIONS, ANGLES), max_size=3), st.floats(0.1, 5))
def test_the_rim_of_a_wire_lies_on_its_cone_and_the_ribs_end_there(cones, reach_m):
    drawn = [Cone(cue="gaze", apex_left=apex, axis=axis, fov_rad=fov, n_rays=8) for apex, axis, fov in cones]
    wires = cone_wires(drawn, reach_m)
    assert wires.shape == (len(cones), 8 + RIM + 1, 3)
    for wire, (apex, axis, fov) in zip(wires, cones, strict=True):
        ribs, rim = wire[:8], wire[8:]
        np.testing.assert_allclose(np.linalg.norm(rim - apex, axis=1), reach_m)
        np.testing.assert_allclose((rim - apex) @ axis, reach_m * np.cos(fov / 2), atol=1e-9)
        np.testing.assert_allclose(rim[0], rim[-1], atol=1e-9)
        np.testing.assert_array_equal(ribs[1::2], [apex] * 4)
        np.testing.assert_array_equal(ribs[::2], rim[: -1 : RIM // 4])


@pytest.mark.parametrize("shape", [(1, 1), (4, 6), (5, 7), (5, 6), (4, 7)])
def test_a_painted_mask_has_the_class_of_every_second_pixel_twice(shape):
    classes = np.random.default_rng(0).integers(0, 3, shape, dtype=np.uint16)
    colours = [(255, 0, 0), (0, 0, 255)]
    picture = np.asarray(Image.open(io.BytesIO(painted(classes[::2, ::2], shape, colours))).convert("RGBA"))
    coarse = classes[::2, ::2].repeat(2, axis=0).repeat(2, axis=1)[: shape[0], : shape[1]]
    expected = np.array([(0, 0, 0, 0), (255, 0, 0, 255), (0, 0, 255, 255)], dtype=np.uint8)[coarse]
    np.testing.assert_array_equal(picture, expected)


def test_more_names_than_a_picture_has_colours_keep_theirs():
    colours = Colours(map(str, range(2 * MOST_COLOURS)))
    assert all(colours.of(str(k)) == colours.of(str(k + MOST_COLOURS)) for k in range(MOST_COLOURS))
