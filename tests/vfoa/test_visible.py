"""Middles and spreads of targets against those that geometry gives."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.scenes import make_box, make_target, with_points
from vfoa.geometry import angle_between, unit
from vfoa.visible import FACE_RADIUS_M, visible_targets

visible_clouds = partial(visible_targets, clouds=True)
both_kinds = pytest.mark.parametrize("views", [visible_targets, visible_clouds], ids=["box", "cloud"])
EYES = np.zeros(3)


def plate(number, x, half, z=2.0):
    """A square plate that faces the eyes, as a box and as a grid of points."""
    across = np.linspace(-half, half, 21)
    points = [(x + u, v, z) for u in across for v in across]
    return with_points(make_target(number, make_box((x, 0, z), (half, half, 0.001))), points)


@both_kinds
def test_a_plate_spreads_as_a_uniform_square_does(views):
    """Variance of a uniform distribution of half width a seen from d, per direction: (a / d)^2 / 3."""
    seen = views(EYES, (plate(1, 0.0, 0.1),), {})
    assert seen.ids == (1,)
    assert np.rad2deg(angle_between(seen.directions[0], (0, 0, 1))) < 0.1
    error = 0.005 if views is visible_targets else 0.12  # of a cloud of 21 by 21 points
    assert seen.variances[0] == pytest.approx((0.1 / 2) ** 2 / 3, rel=error)


@both_kinds
def test_a_target_is_seen_through_those_in_front_of_it(views):
    hidden, near = plate(1, 0.0, 0.1), plate(2, 0.0, 0.3, z=1.0)
    alone, both = views(EYES, (hidden,), {}), views(EYES, (hidden, near), {})
    assert both.ids == (1, 2)
    assert both.variances[0] == alone.variances[0]
    np.testing.assert_array_equal(both.directions[0], alone.directions[0])


def test_an_answer_is_shared_only_by_the_same_question():
    target, other = plate(1, 0.0, 0.1), plate(1, 0.0, 0.1)
    first = visible_targets(EYES, (target,), {})
    assert visible_targets(EYES, (target,), {}) is first
    again = [((other,), EYES, {}), ((target,), EYES + 0.1, {}), ((target,), EYES, {1: np.ones(3)})]
    assert all(visible_targets(eyes, targets, others) is not first for targets, eyes, others in again)
    assert visible_clouds(EYES, (target,), {}) is not first
    bare = replace(target, points_left=np.zeros((0, 3), np.float32))
    assert visible_clouds(EYES, (bare,), {}) is visible_targets(EYES, (bare,), {})


def test_people_are_looked_at_in_the_face():
    body = make_target(7, make_box((0, 0.5, 2), (0.3, 0.7, 0.2)))
    face = np.array([0.0, -0.1, 2.0])
    views = visible_targets(EYES, (body,), {7: face})
    assert views.directions[0] == pytest.approx(face / np.linalg.norm(face))
    assert views.variances[0] == pytest.approx(FACE_RADIUS_M**2 / (face @ face))
    assert visible_targets(EYES, (body,), {}).directions[0, 1] > 0.1


def test_a_person_whose_eyes_are_at_the_same_place_is_seen_as_a_box():
    """Such as one person under two names: there is no direction to the face."""
    body = make_target(7, make_box((0, 0, 0.1), 0.3))
    seen, as_box = (visible_targets(EYES, (body,), eyes) for eyes in ({7: EYES}, {}))
    np.testing.assert_array_equal(seen.directions, as_box.directions)
    np.testing.assert_array_equal(seen.variances, as_box.variances)


def test_eyes_within_a_box_see_it_everywhere():
    views = visible_targets(EYES, (make_target(1, make_box((0, 0, 0.1), 1.0)),), {})
    assert views.ids == (1,)
    assert views.directions[0] == pytest.approx((0, 0, 1))
    assert views.variances[0] == 1


def test_half_of_all_rays_meet_a_box_at_whose_face_the_eyes_are():
    """The mean of unit vectors over half a sphere is half of its axis."""
    views = visible_targets(np.array([0.1, 0.2, 0.0]), (make_target(1, make_box((0, 0, 0.5), 0.5)),), {})
    assert views.directions[0] == pytest.approx((0, 0, 1))
    assert views.variances[0] == pytest.approx(0.5)


@given(st.integers(0, 2**32 - 1))
def test_a_mirror_changes_nothing_but_the_side(seed):
    """Neither does the order of a box's axes."""
    rng = np.random.default_rng(seed)
    mirror = np.diag([-1.0, 1, 1])
    center, half, axes = rng.normal(size=3), rng.uniform(0.02, 1, 3), Rotation.random(rng=rng).as_matrix()
    here = make_target(1, make_box(center, half, axes))
    there = make_target(1, make_box(mirror @ center, half[[1, 0, 2]], mirror @ axes[:, [1, 0, 2]]))
    views, mirrored = (visible_targets(EYES, (target,), {}) for target in (here, there))
    np.testing.assert_allclose(mirrored.directions[0], mirror @ views.directions[0], atol=1e-9)
    np.testing.assert_allclose(mirrored.variances, views.variances, atol=1e-9)


@pytest.mark.parametrize("distance", [1, 30, 1000])
def test_a_small_cube_spreads_as_its_near_face_at_any_distance(distance):
    views = visible_targets(EYES, (make_target(1, make_box((0, 0, distance), 0.005)),), {})
    assert views.variances[0] == pytest.approx((0.005 / (distance - 0.005)) ** 2 / 3, rel=1e-3)


@pytest.mark.parametrize(
    ("half", "from_middle"),
    [((0.8, 0.02, 0.4), (0, -0.45, -0.5)), ((1.5, 0.4, 0.4), (0, -0.5, -1.2)), ((2, 1.2, 0.05), (0.1, 0.2, -1.5))],
    ids=["a table at which one sits", "a sofa", "a wall"],
)
@pytest.mark.parametrize("seed", range(5))
def test_a_large_near_box_has_the_middle_of_many_rays(half, from_middle, seed):
    """Nearer than its own corners: of the rays to all sides only every tenth would meet it."""
    rng, from_middle = np.random.default_rng(seed), np.array(from_middle) * (-1) ** seed  # from either side
    rotation = Rotation.random(rng=rng).as_matrix()
    box = make_box((0, 0, 2), half, rotation)
    eyes = box.center_m + rotation @ from_middle
    rays = unit(rng.normal(size=(100_000, 3)))
    inverse = 1 / (rays @ rotation)
    near, far = np.sort([(sign * np.array(half) - from_middle) * inverse for sign in (-1, 1)], axis=0)
    met = rays[far.min(axis=1) >= np.maximum(near.max(axis=1), 0)]
    views = visible_targets(eyes, (make_target(1, box),), {})
    assert np.rad2deg(angle_between(views.directions[0], met.mean(axis=0))) < 1
    assert views.variances[0] == pytest.approx(1 - np.linalg.norm(met.mean(axis=0)), rel=0.03)


def test_nothing_to_see_is_no_view():
    views = visible_targets(EYES, (), {})
    assert views.ids == ()
    assert views.directions.shape == (0, 3)


def test_a_target_without_a_cloud_is_not_seen_by_its_cloud():
    assert visible_clouds(EYES, (make_target(1, make_box((0, 0, 2))), plate(2, 0.5, 0.1)), {}).ids == (2,)


def test_a_cloud_of_two_points_has_their_middle_and_their_spread():
    """Not those of the box, which is elsewhere. Each lies half the angle from the middle, on one line."""
    target = with_points(make_target(1, make_box((3, 3, 2))), [(-0.5, 0, 2), (0.5, 0, 2)])
    half = np.arctan2(0.5, 2)
    views = visible_clouds(EYES, (target,), {})
    assert views.directions[0] == pytest.approx((0, 0, 1))
    assert views.variances[0] == pytest.approx((2 * np.sin(half / 2)) ** 2 / 2)


def test_a_cloud_without_a_box_is_left_out():
    lone = replace(plate(1, 0.0, 0.1), box=None)
    views = visible_clouds(EYES, (lone, plate(2, 0.5, 0.1)), {})
    assert views.ids == (2,)
    assert views.directions[0, 0] == pytest.approx(0.5 / np.hypot(0.5, 2), abs=0.01)


def test_a_deep_box_is_seen_by_its_near_face():
    views = visible_targets(EYES, (make_target(1, make_box((0, 0, 2), (0.2, 0.2, 0.5))),), {})
    assert views.variances[0] == pytest.approx((0.2 / 1.5) ** 2 / 3, rel=0.05)


@both_kinds
def test_only_where_things_lie_from_the_eyes_matters(views):
    shift = np.array([3.0, -2.0, 1.0])
    targets = (plate(1, 0.0, 0.2), plate(2, 0.213, 0.2, z=1.0), plate(3, -0.5, 0.1))
    face = np.array([0.0, 0.1, 2.0])
    moved = tuple(
        replace(
            target,
            points_left=target.points_left + np.float32(shift),
            box=replace(target.box, center_m=target.box.center_m + shift),
        )
        for target in targets
    )
    here, there = views(EYES, targets, {3: face}), views(shift, moved, {3: face + shift})
    assert there.ids == here.ids
    # single-precision points
    np.testing.assert_allclose(there.directions, here.directions, atol=1e-6)
    np.testing.assert_allclose(there.variances, here.variances, rtol=1e-4)
