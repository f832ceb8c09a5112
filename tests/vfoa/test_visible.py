"""Middles and spreads of targets against those that geometry gives."""

from __future__ import annotations

import numpy as np
import pytest

from tests.scenes import make_box, make_target, with_points
from vfoa.geometry import angle_between
from vfoa.visible import FACE_RADIUS_M, SurfaceSettings, views_of

BOXES = SurfaceSettings(surface="box", directions=1000)
CLOUDS = BOXES.model_copy(update={"surface": "cloud"})
FIRST = {"occlusion": "first_hit"}
EYES = np.zeros(3)


def plate(number, x, half, z=2.0):
    """A square plate that faces the eyes, as a box and as a grid of points."""
    across = np.linspace(-half, half, 21)
    points = [(x + u, v, z) for u in across for v in across]
    return with_points(make_target(number, make_box((x, 0, z), (half, half, 0.001))), points)


@pytest.mark.parametrize("settings", [BOXES, CLOUDS], ids=["box", "cloud"])
def test_a_plate_spreads_as_a_uniform_square_does(settings):
    """Variance of a uniform distribution of half width a seen from d, per direction: (a / d)^2 / 3."""
    views = views_of(EYES, (plate(1, 0.0, 0.1),), {}, settings)
    assert views.ids == (1,)
    assert np.rad2deg(angle_between(views.directions[0], (0, 0, 1))) < 0.1
    assert views.variances[0] == pytest.approx((0.1 / 2) ** 2 / 3, rel=0.12)


@pytest.mark.parametrize("settings", [BOXES, CLOUDS], ids=["box", "cloud"])
def test_half_hidden_is_seen_where_it_is_not(settings):
    near = plate(2, 0.2, 0.2, z=1.0)
    targets = (plate(1, 0.0, 0.2), near)
    whole = views_of(EYES, targets, {}, settings)
    part = views_of(EYES, targets, {}, settings.model_copy(update=FIRST))
    assert abs(whole.directions[0, 0]) < 0.01
    assert part.directions[0, 0] == pytest.approx(-0.05, abs=0.01)
    assert part.variances[0] < whole.variances[0]


@pytest.mark.parametrize("settings", [BOXES, CLOUDS], ids=["box", "cloud"])
def test_what_is_hidden_altogether_is_left_out(settings):
    targets = (plate(1, 0.0, 0.1), plate(2, 0.0, 0.3, z=1.0))
    assert views_of(EYES, targets, {}, settings.model_copy(update=FIRST)).ids == (2,)
    assert views_of(EYES, targets, {}, settings).ids == (1, 2)


def test_people_are_looked_at_in_the_face():
    body = make_target(7, make_box((0, 0.5, 2), (0.3, 0.7, 0.2)))
    face = np.array([0.0, -0.1, 2.0])
    views = views_of(EYES, (body,), {7: face}, BOXES)
    assert views.directions[0] == pytest.approx(face / np.linalg.norm(face))
    assert views.variances[0] == pytest.approx(FACE_RADIUS_M**2 / (face @ face))
    assert views_of(EYES, (body,), {7: face}, BOXES.model_copy(update={"faces": False})).directions[0, 1] > 0.1


@pytest.mark.parametrize("settings", [BOXES, CLOUDS], ids=["box", "cloud"])
def test_a_person_who_is_hidden_altogether_has_no_face_to_look_at(settings):
    person, screen = plate(7, 0.0, 0.1), plate(2, 0.0, 0.3, z=1.0)
    eyes = {7: np.array([0.0, 0.0, 2.0])}
    assert views_of(EYES, (person, screen), eyes, settings.model_copy(update=FIRST)).ids == (2,)


def test_eyes_within_a_box_see_it_everywhere():
    views = views_of(EYES, (make_target(1, make_box((0, 0, 0.1), 1.0)),), {}, BOXES)
    assert views.ids == (1,)
    assert views.variances[0] > 0.3


def test_nothing_to_see_is_no_view():
    views = views_of(EYES, (), {}, BOXES)
    assert views.ids == ()
    assert views.directions.shape == (0, 3)


def test_a_target_without_a_cloud_is_not_seen_by_its_cloud():
    assert views_of(EYES, (make_target(1, make_box((0, 0, 2))), plate(2, 0.5, 0.1)), {}, CLOUDS).ids == (2,)
