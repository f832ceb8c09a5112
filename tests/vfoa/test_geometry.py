"""Projection, directions and boxes: inverse pairs, conventions and an independent ray-box reference."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.scenes import entry_distance, make_box, make_rig
from vfoa.geometry import (
    angle_between,
    back_project,
    box_corners,
    box_iou,
    cross,
    depth_from_disparity,
    direction_from_crop,
    disparity_from_depth,
    fov_from_radius,
    gaze_direction_crop,
    head_direction_crop,
    left_from_crop,
    lowered,
    on_the_way,
    outlines,
    perturb,
    pixel_ray,
    project,
    quaternion,
    rotation_of,
    stacked,
    tangent_offset,
    turn_about_z,
    unit,
)

SEEDS = st.integers(0, 2**32 - 1)
ANGLES = st.floats(-1.5, 1.5)
RIG = make_rig(64, 48, fx_px=50, cx_right_offset_px=3)


def vectors(seed, rows=7):
    return np.random.default_rng(seed).normal(size=(rows, 3))


# Angles


@given(SEEDS)
def test_unit_vectors_keep_their_direction_row_by_row(seed):
    found = vectors(seed)
    lengths = np.sqrt((found**2).sum(axis=1))
    np.testing.assert_allclose(unit(found) * lengths[:, None], found)


@given(SEEDS)
def test_angles_are_those_of_the_dot_product_row_by_row(seed):
    a, b = vectors(seed), vectors(seed + 1)
    expected = [math.acos(np.dot(p, q) / math.sqrt(np.dot(p, p) * np.dot(q, q))) for p, q in zip(a, b, strict=True)]
    np.testing.assert_allclose(angle_between(a, 3 * b), expected, atol=1e-7)


@pytest.mark.parametrize("angle", [1e-12, 1e-8, 1e-3, 1.0, math.pi / 2, math.pi - 1e-8])
def test_small_and_straight_angles_are_exact(angle):
    assert angle_between((1, 0, 0), (math.cos(angle), math.sin(angle), 0)) == pytest.approx(angle, rel=1e-7)


@pytest.mark.parametrize(("radius_m", "fov_deg"), [(0.05, 5.2), (0.10, 10.4), (0.25, 25.6), (0.47, 46.3)])
def test_cones_have_the_angles_of_their_radii(radius_m, fov_deg):
    assert math.degrees(fov_from_radius(radius_m)) == pytest.approx(fov_deg, abs=0.05)


# Projection


@given(st.lists(st.floats(0.1, 1e4), min_size=1, max_size=9), st.floats(-20, 20))
def test_depth_and_disparity_are_inverse(depths, offset_px):
    rig = make_rig(cx_right_offset_px=offset_px)
    np.testing.assert_allclose(depth_from_disparity(disparity_from_depth(depths, rig), rig), depths, rtol=1e-6)


def test_depth_is_focal_length_times_baseline_over_disparity():
    rig = make_rig(1024, 436, fx_px=896, baseline_m=0.1)
    np.testing.assert_allclose(depth_from_disparity([[166.0], [89.6]], rig), [[0.53976], [1.0]], rtol=1e-4)
    shifted = make_rig(1024, 436, fx_px=896, baseline_m=0.1, cx_right_offset_px=10)
    assert depth_from_disparity(79.6, shifted) == pytest.approx(1.0)


def test_what_has_no_depth_is_unknown():
    np.testing.assert_array_equal(depth_from_disparity([np.nan, -3.0, -5.0, np.inf], RIG), [np.nan] * 4)
    np.testing.assert_array_equal(disparity_from_depth([np.nan, 0.0, -1.0], RIG), [np.nan] * 3)
    assert np.isfinite(depth_from_disparity(-2.9, RIG))


@given(SEEDS)
def test_projection_and_back_projection_are_inverse_row_by_row(seed):
    rng = np.random.default_rng(seed)
    u, v, z = rng.uniform(-50, 150, (2, 3)), rng.uniform(-50, 150, (2, 3)), rng.uniform(0.1, 50, (2, 3))
    points = back_project(u, v, z, RIG)
    np.testing.assert_allclose(project(points, RIG), np.stack([u, v], axis=-1), atol=1e-9)
    np.testing.assert_allclose(points[..., 2], z)
    homogeneous = points @ RIG.camera_matrix.T
    np.testing.assert_allclose(homogeneous[..., :2] / homogeneous[..., 2:], project(points, RIG), atol=1e-9)


@given(SEEDS)
def test_both_cameras_see_a_point_a_disparity_apart(seed):
    point = np.random.default_rng(seed).uniform((-1, -1, 0.5), (1, 1, 5))
    u_left = project(point, RIG)[0]
    u_right = RIG.fx_px * (point[0] - RIG.baseline_m) / point[2] + RIG.cx_right_px
    assert disparity_from_depth(point[2], RIG) == pytest.approx(u_left - u_right)


def test_what_is_not_in_front_has_no_pixel():
    np.testing.assert_array_equal(np.isnan(project([[0, 0, -1], [0, 0, 0], [0, 0, 1]], RIG)).all(axis=1), [1, 1, 0])


def test_the_ray_of_the_principal_point_is_the_axis():
    np.testing.assert_allclose(pixel_ray(RIG.cx_px, RIG.cy_px, RIG), [0, 0, 1])
    assert np.linalg.norm(pixel_ray(3, 5, RIG)) == pytest.approx(1)


# Directions seen in a crop


@given(SEEDS)
def test_the_crop_frame_is_a_rotation_about_the_ray_with_level_right(seed):
    rays = vectors(seed)
    for ray, frame in zip(rays, left_from_crop(rays), strict=True):
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1)
        np.testing.assert_allclose(frame[:, 2], ray / math.sqrt(ray @ ray))
        assert frame[1, 0] == 0
        assert frame[1, 1] >= 0
        np.testing.assert_allclose(frame, left_from_crop(ray))


@pytest.mark.parametrize("ray", [(0, 1, 0), (0, -1, 0), (1e-300, 1, 0)])
def test_a_ray_straight_up_or_down_has_a_crop_frame(ray):
    frame = left_from_crop(ray)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)


def direction_to_crop(directions, rays):
    """The inverse of the function."""
    return np.einsum("...ji,...j->...i", left_from_crop(rays), directions)


@given(SEEDS)
def test_directions_to_and_from_a_crop_are_inverse_row_by_row(seed):
    rays, directions = vectors(seed), vectors(seed + 1)
    there = direction_to_crop(directions, rays)
    np.testing.assert_allclose(direction_from_crop(there, rays), directions, atol=1e-12)
    np.testing.assert_allclose(direction_from_crop(there[3], rays[3]), directions[3], atol=1e-12)
    one_ray = direction_from_crop(directions, rays[0])
    np.testing.assert_allclose(direction_to_crop(one_ray, rays[0]), directions, atol=1e-12)


@given(SEEDS)
def test_who_looks_into_the_camera_looks_back_along_the_ray(seed):
    rays = vectors(seed)
    for straight in (head_direction_crop(0, 0), gaze_direction_crop(0, 0)):
        np.testing.assert_allclose(direction_from_crop(straight, rays), -unit(rays), atol=1e-12)


@given(ANGLES, ANGLES)
def test_the_angles_of_heads_and_gazes_turn_to_the_images_left_and_up(first, second):
    head, gaze = head_direction_crop(first, second), gaze_direction_crop(first, second)
    for direction in (head, gaze):
        assert np.linalg.norm(direction) == pytest.approx(1)
        assert np.sign(-direction[0]) == np.sign(math.sin(first)) or abs(first) < 1e-12
        assert np.sign(-direction[1]) == np.sign(math.sin(second)) or abs(second) < 1e-12
        assert direction[2] < 0
    assert math.asin(-head[0]) == pytest.approx(first, abs=1e-6)
    assert math.atan2(-head[1], -head[2]) == pytest.approx(second, abs=1e-6)
    assert math.atan2(-gaze[0], -gaze[2]) == pytest.approx(first, abs=1e-6)
    assert math.asin(-gaze[1]) == pytest.approx(second, abs=1e-6)


@pytest.mark.parametrize("direction", [head_direction_crop, gaze_direction_crop])
def test_many_angles_have_as_many_directions(direction):
    first, second = np.array([[0.1, -0.2], [0.3, 0.0], [1.0, -1.0]]), np.array([[0.5, 0.4], [0.0, -0.3], [-0.1, 0.2]])
    found = direction(first, second)
    assert found.shape == (3, 2, 3)
    for place in np.ndindex(3, 2):
        np.testing.assert_array_equal(found[place], direction(first[place], second[place]))


@given(ANGLES, ANGLES, SEEDS)
def test_a_perturbation_turns_by_its_angle_towards_its_side(right_rad, down_rad, seed):
    direction = vectors(seed)
    turned = perturb(direction, right_rad, down_rad)
    np.testing.assert_allclose(angle_between(turned, direction), math.hypot(right_rad, down_rad), atol=1e-9)
    local = direction_to_crop(turned, direction)
    np.testing.assert_allclose(local[:, 0] * down_rad, local[:, 1] * right_rad, atol=1e-9)
    assert (local[:, 0] * right_rad + local[:, 1] * down_rad >= -1e-12).all()


@given(st.floats(-3.1, 3.1), st.floats(0, 3.1), SEEDS)
def test_a_tangent_offset_is_the_perturbation_that_leads_there(towards_rad, angle_rad, seed):
    direction, other = vectors(seed, 2)
    offset = angle_rad * np.array([math.cos(towards_rad), math.sin(towards_rad)])
    np.testing.assert_allclose(tangent_offset(direction, 3 * perturb(direction, *offset)), offset, atol=1e-6)
    np.testing.assert_allclose(perturb(direction, *tangent_offset(direction, other)), unit(other), atol=1e-9)


@given(SEEDS)
def test_many_offsets_and_perturbations_are_those_of_each_pair(seed):
    rng = np.random.default_rng(seed)
    directions, others, angles = rng.normal(size=(2, 7, 3)), rng.normal(size=(7, 3)), rng.uniform(-1, 1, (2, 7))
    offsets, turned = tangent_offset(directions, others), perturb(directions, *angles)
    for row, column in product(range(2), range(7)):
        one = directions[row, column]
        np.testing.assert_allclose(offsets[row, column], tangent_offset(one, others[column]), atol=1e-15)
        np.testing.assert_allclose(turned[row, column], perturb(one, *angles[:, column]), atol=1e-15)
        local = direction_to_crop(unit(others[column]), one)
        assert math.atan2(offsets[row, column, 1], offsets[row, column, 0]) == pytest.approx(
            math.atan2(local[1], local[0]), abs=1e-6
        )
        assert math.hypot(*offsets[row, column]) == pytest.approx(angle_between(one, others[column]), abs=1e-12)


@given(SEEDS, ANGLES)
def test_one_direction_is_turned_down_and_has_the_axes_that_it_has_among_many(seed, angle_rad):
    directions = unit(vectors(seed))
    np.testing.assert_array_equal([left_from_crop(each) for each in 3 * directions], left_from_crop(3 * directions))
    for direction, turned in zip(directions, perturb(directions, 0.0, angle_rad), strict=True):
        np.testing.assert_allclose(lowered(direction, angle_rad), turned, atol=1e-15)


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_straight_up_and_down_turn_down_as_they_are_perturbed(up):
    np.testing.assert_allclose(lowered(np.array([0, up, 0]), 0.3), perturb((0, up, 0), 0.0, 0.3), atol=1e-15)


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_offsets_from_straight_up_and_to_the_opposite_point_right(up):
    np.testing.assert_allclose(tangent_offset((0, up, 0), (1, 0, 0)), (math.pi / 2, 0), atol=1e-15)
    np.testing.assert_array_equal(tangent_offset((0, up, 0), (0, -up, 0)), (math.pi, 0))
    np.testing.assert_allclose(tangent_offset((0, up, 0), (0, up, 0)), (0, 0), atol=1e-15)


_AXES = [*np.eye(3), *-np.eye(3), (-1e-16, 1.0, 0.0)]


@pytest.mark.parametrize(("direction", "other"), list(product(_AXES, _AXES)))
def test_offsets_between_directions_along_axes_are_known(direction, other):
    offset = tangent_offset(direction, other)
    assert math.hypot(*offset) == pytest.approx(angle_between(direction, other), abs=1e-12)
    np.testing.assert_allclose(perturb(direction, *offset), other, atol=1e-12)


@given(SEEDS)
def test_a_vector_product_has_the_numbers_of_numpy(seed):
    first, second = vectors(seed, 5), vectors(seed + 1, 5)
    np.testing.assert_array_equal(cross(first.T, second.T).T, np.cross(first, second))
    np.testing.assert_array_equal(cross(first[0], second[0]), np.cross(first[0], second[0]))


@given(SEEDS, st.floats(0, 1.5))
def test_a_share_of_the_way_is_that_share_of_the_angle_in_the_same_plane(seed, share):
    start, *ends = unit(vectors(seed, 5))
    ways = on_the_way(start[:, None, None], np.transpose(ends)[:, None], np.full((2, 1), share))
    assert ways.shape == (3, 2, 4)
    for end, way in zip(ends, ways[:, 1].T, strict=True):
        assert np.linalg.norm(way) == pytest.approx(np.linalg.norm(np.cross(start, end)))
        assert way @ np.cross(start, end) == pytest.approx(0, abs=1e-9)
        angle = float(angle_between(start, end))
        if share * angle < math.pi:
            assert float(angle_between(start, way)) == pytest.approx(share * angle, abs=1e-7)


def test_the_opposite_direction_lies_to_the_right_and_the_same_nowhere():
    directions = [(0, 0, 1), (0, 0, 1)]
    np.testing.assert_allclose(tangent_offset(directions, [(0, 0, 2), (0, 0, -2)]), [(0, 0), (math.pi, 0)], atol=1e-15)


@given(SEEDS)
def test_a_quaternion_is_that_of_scipy(seed):
    rotation = Rotation.random(rng=seed)
    found, expected = quaternion(rotation.as_matrix()), rotation.as_quat()
    assert found == pytest.approx(expected * np.sign(np.dot(found, expected)), abs=1e-12)


def test_a_rotation_comes_back_from_its_quaternion_whatever_its_length():
    rotations = Rotation.random(20, random_state=1).as_matrix()
    quaternions = np.array([quaternion(rotation) for rotation in rotations])
    np.testing.assert_allclose(rotation_of(3 * quaternions), rotations, atol=1e-12)


@pytest.mark.parametrize("half_turn", [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)])
def test_the_quaternion_of_a_half_turn_is_its_axis(half_turn):
    assert quaternion(Rotation.from_quat(half_turn).as_matrix()) == pytest.approx(half_turn)


@given(ANGLES)
def test_a_turn_about_z_takes_x_towards_y(angle_rad):
    expected = Rotation.from_euler("z", angle_rad).as_matrix()
    np.testing.assert_allclose(turn_about_z(angle_rad), expected, atol=1e-12)


# Boxes


@given(SEEDS)
def test_corners_are_half_the_diagonal_from_the_centre_and_on_three_faces(seed):
    rng = np.random.default_rng(seed)
    box = make_box(rng.normal(size=3), rng.uniform(0.1, 1, 3), Rotation.random(rng=rng).as_matrix())
    offsets = box_corners([box])[0] - box.center_m
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), np.linalg.norm(box.half_size_m))
    np.testing.assert_allclose(np.abs(offsets @ box.left_from_box), np.tile(box.half_size_m, (8, 1)), atol=1e-12)
    assert len(np.unique(np.round(offsets, 9), axis=0)) == 8


def first_face(origin, direction, box):
    """The entry distance by meeting each face's plane in turn and asking whether the point lies in the face."""
    start, step = (origin - box.center_m) @ box.left_from_box, direction @ box.left_from_box
    if (np.abs(start) <= box.half_size_m).all():
        return 0.0
    found = math.nan
    for axis, side in product(range(3), (-1, 1)):
        if step[axis] != 0:
            distance = (side * box.half_size_m[axis] - start[axis]) / step[axis]
            others = [other for other in range(3) if other != axis]
            met = (start + distance * step)[others]
            if distance >= 0 and (np.abs(met) <= box.half_size_m[others]).all():
                found = min(distance, found) if found == found else distance
    return found


@given(SEEDS)
def test_rays_enter_boxes_where_they_first_meet_a_face(seed):
    rng = np.random.default_rng(seed)
    boxes = tuple(
        make_box(rng.normal(size=3), rng.uniform(0.1, 1, 3), rotation)
        for rotation in [np.eye(3), *Rotation.random(3, rng=rng).as_matrix()]
    )
    origin, directions = rng.normal(size=3), unit(rng.normal(size=(20, 3)))
    expected = [[first_face(origin, direction, box) for box in boxes] for direction in directions]
    np.testing.assert_allclose(entry_distance(origin, directions, boxes), expected, atol=1e-9)


@given(SEEDS)
def test_an_outline_has_the_corners_in_axes_ahead_to_the_centre(seed):
    origin = np.random.default_rng(seed).normal(size=3)
    boxes = [make_box(center, (0.1, 0.2, 0.3)) for center in (*vectors(seed, 4), origin)]
    seen = outlines(origin, boxes)
    assert outlines(origin.copy(), boxes) is seen
    assert outlines(origin + 1, boxes) is not seen
    np.testing.assert_allclose(seen.corners @ seen.axes.transpose(0, 2, 1) + origin, box_corners(boxes), atol=1e-12)
    for box, distance, axes in zip(boxes[:4], seen.distance, seen.axes, strict=False):
        np.testing.assert_allclose(distance * axes[:, 2], box.center_m - origin, atol=1e-12)
    assert seen.distance[4] == 0
    np.testing.assert_array_equal(seen.axes[4], np.eye(3))


def test_boxes_are_stacked_once_for_all_who_ask_for_them():
    one, other = make_box((0, 0, 2), (0.1, 0.2, 0.3)), make_box((1, 0, 2))
    boxes = stacked((one, other))
    assert stacked([one, other]) is boxes
    assert stacked((other, one)) is not boxes
    assert boxes.d_max == pytest.approx([np.linalg.norm(box.half_size_m) for box in (one, other)])
    assert boxes.d_min == pytest.approx([0.1, 0.2])
    assert boxes.in_cubes(np.array([0.1, 0.0, 2.3]))[0] == pytest.approx([1, 0, 1])


@given(
    st.tuples(*[st.sampled_from([-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0])] * 3),
    st.tuples(*[st.sampled_from([-1.0, -0.5, 0.0, 0.5, 1.0])] * 3).filter(any),
)
def test_zero_components_and_origins_on_planes_of_faces_are_decided(origin, direction):
    """All numbers are sums of powers of two, so that the reference is exact as well."""
    box = make_box((0, 0, 0), (0.5, 0.25, 0.5))
    found = entry_distance(origin, np.array([direction]), (box,))
    np.testing.assert_array_equal(found, [[first_face(np.array(origin), np.array(direction), box)]])


@given(st.lists(st.floats(0, 100), min_size=4, max_size=4), st.lists(st.floats(0, 100), min_size=4, max_size=4))
def test_box_iou_is_a_share_and_symmetric(a: list[float], b: list[float]) -> None:
    one, other = (np.array([u, v, u + width + 1, v + height + 1]) for u, v, width, height in (a, b))
    assert 0 <= box_iou(one, other) <= 1
    assert box_iou(one, other) == pytest.approx(box_iou(other, one))
    assert box_iou(one, one) == pytest.approx(1)


def test_box_iou_of_known_boxes() -> None:
    square = np.array([0.0, 0, 1, 1])
    assert box_iou(square, np.array([0.5, 0, 1.5, 1])) == pytest.approx(1 / 3)
    assert box_iou(square, np.array([0.0, 0, 2, 2])) == pytest.approx(1 / 4)
    assert box_iou(square, square + 1) == box_iou(square, square + 5) == 0
    assert box_iou(square * 0, square * 0) == 0


def test_one_depth_serves_many_pixels() -> None:
    u, v = np.array([10.0, 20, 30]), np.array([1.0, 2, 3])
    assert np.array_equal(back_project(u, v, 2.0, RIG), back_project(u, v, np.full(3, 2.0), RIG))
