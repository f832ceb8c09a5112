"""Attention: the paper's synthetic cases (design: a 0.4 m cube centred 1.1 m away), and what holds in any room."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from tests.plain_attention import plain_attention
from tests.scenes import make_box, make_subject, make_target, random_room
from vfoa.cones import ConesSettings, attend_people, pay_attention
from vfoa.types import Attention, Box3D, NoAttention, Subject, Target

AHEAD = (0.0, 0.0, 1.0)
CUBE = make_target(1, make_box((0, 0, 1.1)))
NEAR_CORNER = (0.18, 0.18, 0.9)
TWO_CONES = ConesSettings(cones_cm=(10, 25))

seeds = st.integers(0, 2**32 - 1)


def surface_rays(radius_cm: float, n_rays: int = 40) -> ConesSettings:
    """One cone as the paper's synthetic cases have it."""
    return ConesSettings(cones_cm=(radius_cm,), n_rays=n_rays, axis_ray=False)


def moved(subject: Subject, targets: tuple[Target, ...], rotation: Rotation, scale: float = 1.0):
    """The same room turned about the camera and scaled."""
    turn = rotation.as_matrix()
    assert subject.gaze is not None
    assert subject.head_pose is not None
    turned = make_subject(
        eyes=scale * turn @ subject.person.eye_origin_left,
        gaze=turn @ subject.gaze.direction,
        head=turn @ subject.head_pose.direction,
    )
    boxes = [target.box for target in targets]
    return turned, tuple(
        replace(target, box=make_box(scale * turn @ box.center_m, scale * box.half_size_m, turn @ box.left_from_box))
        for target, box in zip(targets, boxes, strict=True)
        if isinstance(box, Box3D)
    )


def totals(attention: Attention) -> dict[int, float]:
    return {value.instance_id: value.total for value in attention.values}


# The paper's synthetic cases


@pytest.mark.parametrize(
    ("radius_cm", "n_rays", "expected"),
    [(5, 40, 0.99), (10, 40, 0.95), (20, 40, 0.82), (30, 4, 0.00), (30, 40, 0.19), (40, 40, 0.00)],
)
def test_a_wider_cone_about_the_centre_gives_less_attention(radius_cm, n_rays, expected):
    subject = make_subject(gaze=AHEAD, head=AHEAD)
    (value,) = pay_attention(subject, (CUBE,), surface_rays(radius_cm, n_rays)).values
    assert value.total == pytest.approx(expected, abs=0.005)


def test_gaze_and_head_share_sixty_to_forty_where_they_agree():
    (value,) = pay_attention(make_subject(gaze=AHEAD, head=AHEAD), (CUBE,), surface_rays(5)).values
    assert value.gaze / value.head == pytest.approx(60 / 40)
    assert value.head == pytest.approx(0.39, abs=0.005)


def test_a_head_turned_to_a_corner_loses_its_part_and_the_gaze_keeps_its_own():
    centred = pay_attention(make_subject(gaze=AHEAD, head=AHEAD), (CUBE,), surface_rays(5)).values[0]
    turned = pay_attention(make_subject(gaze=AHEAD, head=NEAR_CORNER), (CUBE,), surface_rays(5)).values[0]
    assert turned.gaze == centred.gaze
    assert turned.head == pytest.approx(0.1, abs=0.05)


@pytest.mark.parametrize(("gaze", "head"), [(AHEAD, (0.45, 0, 1)), ((0.45, 0, 1), AHEAD)])
def test_with_one_cue_off_the_box_the_total_is_the_other_cues_part(gaze, head):
    both = pay_attention(make_subject(gaze=AHEAD, head=AHEAD), (CUBE,), surface_rays(5)).values[0]
    one = pay_attention(make_subject(gaze=gaze, head=head), (CUBE,), surface_rays(5)).values[0]
    assert one.total == (both.gaze if gaze is AHEAD else both.head)


def test_between_two_boxes_both_get_attention_and_the_bigger_one_more():
    small, big = make_target(1, make_box((-0.25, 0, 1.1), 0.2)), make_target(2, make_box((0.35, 0, 1.1), 0.3))
    attention = pay_attention(make_subject(gaze=AHEAD, head=AHEAD), (small, big), surface_rays(30))
    assert 0 < totals(attention)[1] < totals(attention)[2]
    assert attention.focus == 2


@pytest.mark.parametrize("apart_deg", [25, 60])
def test_with_gaze_and_head_on_different_boxes_the_gazes_box_wins(apart_deg):
    angle = math.radians(apart_deg)
    aside = (math.sin(angle), 0, math.cos(angle))
    other = make_target(2, make_box(1.1 * np.array(aside)))
    attention = pay_attention(make_subject(gaze=AHEAD, head=aside), (other, CUBE), surface_rays(5))
    assert attention.focus == 1
    assert all(total > 0 for total in totals(attention).values())


# Weights


@pytest.mark.parametrize(("apart_deg", "w_head"), [(0, 0.4), (29.9, 0.4), (30.1, 0.1), (90, 0.1)])
def test_the_head_counts_less_where_it_differs_from_the_gaze(apart_deg, w_head):
    angle = math.radians(apart_deg)
    gaze = (math.sin(angle), 0, math.cos(angle))
    (value,) = pay_attention(make_subject(gaze=gaze, head=AHEAD), (CUBE,), ConesSettings(cones_cm=(0.01,))).values
    assert value.head == pytest.approx(w_head, abs=1e-3)


@pytest.mark.parametrize(
    ("weighting", "gaze", "head"), [("equal", 0.5, 0.5), ("gaze", 1, 0), ("head", 0, 1), ("adaptive", 0.6, 0.4)]
)
def test_each_weighting_splits_the_same_attention(weighting, gaze, head):
    settings = ConesSettings(cones_cm=(0.01,), weighting=weighting)
    (value,) = pay_attention(make_subject(gaze=AHEAD, head=AHEAD), (CUBE,), settings).values
    assert (value.gaze, value.head, value.total) == pytest.approx((gaze, head, 1), abs=1e-3)


@pytest.mark.parametrize("weighting", ["adaptive", "equal"])
def test_a_cue_that_was_not_measured_gives_its_weight_to_the_other(weighting):
    settings = ConesSettings(cones_cm=(0.01,), weighting=weighting)
    (gaze_only,) = pay_attention(make_subject(gaze=AHEAD), (CUBE,), settings).values
    (head_only,) = pay_attention(make_subject(head=AHEAD), (CUBE,), settings).values
    assert gaze_only.total == gaze_only.gaze == pytest.approx(1, abs=1e-3)
    assert head_only.total == head_only.head == pytest.approx(1, abs=1e-3)
    assert math.isnan(gaze_only.head)
    assert math.isnan(head_only.gaze)


# What is missing


@pytest.mark.parametrize(
    ("subject", "weighting", "missing"),
    [
        (make_subject(eyes=None, gaze=AHEAD, head=AHEAD), "adaptive", NoAttention.NO_EYES_3D),
        (make_subject(), "adaptive", NoAttention.NO_DIRECTION),
        (make_subject(head=AHEAD), "gaze", NoAttention.NO_DIRECTION),
        (make_subject(gaze=AHEAD), "head", NoAttention.NO_DIRECTION),
    ],
)
def test_without_eyes_or_direction_there_is_no_attention_and_it_says_why(subject, weighting, missing):
    attention = pay_attention(subject, (CUBE,), ConesSettings(weighting=weighting))
    assert attention == Attention(subject=subject, missing=missing)


def test_without_targets_the_focus_is_nowhere():
    attention = pay_attention(make_subject(gaze=AHEAD), (), TWO_CONES)
    assert (attention.focus, attention.values, attention.missing) == (None, (), None)


def test_neither_the_subjects_own_box_nor_a_target_without_one_gets_attention():
    subject = make_subject(gaze=AHEAD, head=AHEAD, instance_id=7)
    own = make_target(7, make_box((0, 0, 0), 0.5))
    attention = pay_attention(subject, (own, make_target(8, None), CUBE), TWO_CONES)
    assert list(totals(attention)) == [1]


def test_nothing_behind_the_eyes_counts():
    behind = make_target(2, make_box((0, 0, -1.1)))
    attention = pay_attention(make_subject(gaze=AHEAD, head=AHEAD), (behind,), TWO_CONES)
    assert totals(attention) == {2: 0}
    assert attention.focus is None


def test_eyes_inside_a_box_give_it_no_more_than_all():
    subject = make_subject(eyes=(0, 0, 1.1), gaze=AHEAD, head=AHEAD)
    assert totals(pay_attention(subject, (CUBE,), TWO_CONES)) == {1: 1}


# Occlusion and ties


def test_a_box_behind_another_on_a_ray_counts_too():
    subject, hidden = make_subject(gaze=AHEAD, head=AHEAD), make_target(2, make_box((0, 0, 3), 0.1))
    settings = ConesSettings(cones_cm=(5,))
    alone = [totals(pay_attention(subject, (target,), settings)) for target in (hidden, CUBE)]
    assert totals(pay_attention(subject, (hidden, CUBE), settings)) == alone[0] | alone[1]


def test_of_targets_with_equal_attention_the_nearest_wins_and_the_others_are_reported():
    twice_as_far = make_target(1, make_box((0, 0, 2.2), 0.4))
    near = make_target(5, make_box((0, 0, 1.1), 0.2))
    copy = make_target(3, make_box((0, 0, 2.2), 0.4))
    for targets, tied in (((copy, near, twice_as_far), (1, 3)), ((copy, near), (3,))):
        attention = pay_attention(make_subject(gaze=AHEAD, head=AHEAD), targets, TWO_CONES)
        assert (attention.focus, attention.tied) == (5, tied)


# In any room


@given(seeds)
def test_it_equals_the_plain_loop_over_rays_and_boxes(seed):
    subject, targets = random_room(seed)
    attention = pay_attention(subject, targets, TWO_CONES)
    found = {value.instance_id: (value.gaze, value.head, value.total) for value in attention.values}
    expected = plain_attention(subject, targets, TWO_CONES)
    assert list(found) == list(expected)
    np.testing.assert_allclose(list(found.values()), list(expected.values()), atol=1e-12)


@given(seeds, st.lists(st.integers(0, 5), min_size=1, max_size=30), st.sampled_from(["adaptive", "gaze"]))
def test_people_attended_to_together_get_the_same_answers_as_alone(seed, kinds, weighting):
    settings = ConesSettings(cones_cm=(10, 25), weighting=weighting)
    people = [_of_kind(kind, seed + place) for place, kind in enumerate(kinds)]
    for (subject, targets), together in zip(people, attend_people(people, settings), strict=True):
        alone = pay_attention(subject, targets, settings)
        assert together.subject is subject
        assert str(together.values) == str(alone.values)  # NaN is equal to itself in words
        assert (together.focus, together.tied, together.missing) == (alone.focus, alone.tied, alone.missing)
        np.testing.assert_equal(_rays(together), _rays(alone))


def _of_kind(kind: int, seed: int) -> tuple[Subject, tuple[Target, ...]]:
    """A person in a room of its own, with another number of targets, without a cue or eyes, or one of the targets."""
    subject, targets = random_room(seed)
    own = replace(subject.person, instance_id=targets[0].instance.id)
    kinds = {
        1: (subject, targets[1:]),
        2: (replace(subject, gaze=None), targets),
        3: (replace(subject, gaze=None, head_pose=None), targets),
        4: (replace(subject, person=replace(subject.person, eye_origin_left=None)), targets),
        5: (replace(subject, person=own), targets),
    }
    return kinds.get(kind, (subject, targets))


def _rays(attention: Attention) -> list[np.ndarray]:
    rays = attention.rays
    return [] if rays is None else [rays.origin_left, rays.directions, rays.cone_index, rays.entry_m]


@given(seeds)
def test_values_are_shares_and_the_parts_make_the_total(seed):
    subject, targets = random_room(seed)
    for value in pay_attention(subject, targets, ConesSettings(cones_deg=(5, 60, 170))).values:
        assert 0 <= value.gaze <= 0.9
        assert 0 <= value.head <= 0.4
        assert value.total == pytest.approx(value.gaze + value.head)


@given(seeds, st.randoms())
def test_the_order_of_the_targets_does_not_matter(seed, random):
    subject, targets = random_room(seed)
    shuffled = random.sample(targets, len(targets))
    one, other = pay_attention(subject, targets, TWO_CONES), pay_attention(subject, tuple(shuffled), TWO_CONES)
    assert totals(other) == pytest.approx(totals(one))
    assert other.focus == one.focus


@given(seeds, st.floats(0.1, 10), st.floats(-180, 180))
def test_the_scale_of_the_room_and_a_turn_about_the_vertical_do_not_matter(seed, scale, turn_deg):
    subject, targets = random_room(seed)
    turned = moved(subject, targets, Rotation.from_euler("y", turn_deg, degrees=True), scale)
    before, after = pay_attention(subject, targets, TWO_CONES), pay_attention(*turned, TWO_CONES)
    assert totals(after) == pytest.approx(totals(before), abs=1e-9)


@given(seeds)
def test_any_turn_matters_only_through_where_on_the_cone_its_rays_stand(seed):
    subject, targets = random_room(seed)
    turned = moved(subject, targets, Rotation.random(rng=np.random.default_rng(seed)))
    dense = ConesSettings(cones_cm=(10, 25), n_rays=2000)
    before, after = pay_attention(subject, targets, dense), pay_attention(*turned, dense)
    assert totals(after) == pytest.approx(totals(before), abs=0.01)


@pytest.mark.parametrize("vertical", [(0, 1, 0), (0, -1, 0)])
def test_a_gaze_straight_down_or_up_is_as_good_as_any(vertical):
    target = make_target(1, make_box(1.1 * np.array(vertical)))
    (level,) = pay_attention(make_subject(gaze=AHEAD), (CUBE,), TWO_CONES).values
    (steep,) = pay_attention(make_subject(gaze=vertical), (target,), TWO_CONES).values
    assert steep.total == pytest.approx(level.total)


# What is recorded


def test_every_ray_lies_on_its_cone_and_says_where_it_enters():
    subject, targets = random_room(3)
    attention = pay_attention(subject, targets, TWO_CONES)
    rays, cones = attention.rays, attention.cones
    assert rays is not None
    assert [(cone.cue, round(math.degrees(cone.fov_rad), 1)) for cone in cones] == [
        ("gaze", 10.4),
        ("gaze", 25.6),
        ("head", 10.4),
        ("head", 25.6),
    ]
    axes = np.array([cone.axis for cone in cones])[rays.cone_index]
    cosines = np.einsum("rj,rj->r", rays.directions, axes).reshape(4, 41)
    halves = np.array([[cone.fov_rad / 2] for cone in cones])
    np.testing.assert_allclose(cosines, np.hstack([np.cos(halves).repeat(40, axis=1), np.ones((4, 1))]))
    hit = np.isfinite(rays.entry_m).any(axis=0)
    assert [value.total > 0 for value in attention.values] == hit.tolist()


# Settings


def test_one_cone_of_ten_centimetres_is_the_default_and_settings_read_back():
    settings = ConesSettings()
    assert settings.cones_rad == pytest.approx([2 * math.atan(10 / 110)])
    for written in (settings, ConesSettings(cones_deg=(60,))):
        assert ConesSettings.model_validate(written.model_dump()) == written


def test_cones_are_named_by_angle_or_by_radius():
    assert np.degrees(ConesSettings(cones_cm=(5, 47)).cones_rad) == pytest.approx([5.2, 46.3], abs=0.05)
    assert np.degrees(ConesSettings(cones_deg=(5.2, 46.3)).cones_rad) == pytest.approx([5.2, 46.3])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"cones_deg": (60,), "cones_cm": (10,)}, "expected cones_deg or cones_cm, found both"),
        ({"cones_deg": (180,)}, "less than 180"),
        ({"cones_cm": (0,)}, "greater than 0"),
        ({"cones_cm": ()}, "at least 1 item"),
        ({"n_rays": 0}, "greater than 0"),
        ({"rays": 3}, "Extra inputs"),
    ],
)
def test_a_wrong_setting_is_refused(wrong, message):
    with pytest.raises(ValidationError, match=message):
        ConesSettings(**wrong)
