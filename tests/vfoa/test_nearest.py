"""The target nearest in angle, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_box, make_subject, make_target, random_room
from vfoa.geometry import angle_between
from vfoa.nearest import NearestSettings, look_at_nearest
from vfoa.types import NoAttention

NEAREST = NearestSettings(method="nearest")
LEFT, RIGHT = make_target(1, make_box((-1, 0, 2))), make_target(2, make_box((1, 0, 2)))


def at_deg(angle: float) -> tuple[float, float, float]:
    return np.sin(np.deg2rad(angle)), 0.0, np.cos(np.deg2rad(angle))


@pytest.mark.parametrize(
    ("gaze", "head", "gaze_share", "focus", "shares"),
    [
        (20, -20, 0.6, 2, (0.6, 0.4)),
        (20, -20, 0.4, 1, (0.4, 0.6)),
        (20, None, 0.0, None, None),
        (None, -20, 0.9, 1, (np.nan, 1)),
        (20, None, 0.9, 2, (1, np.nan)),
        (20, -20, 1.0, 2, (1, np.nan)),
    ],
)
def test_gaze_and_head_are_weighed(
    gaze: float | None, head: float | None, gaze_share: float, focus: int | None, shares: tuple[float, float] | None
) -> None:
    """The focus has 1, in the shares of the two cues; NaN is the share of one that is not used."""
    subject = make_subject(gaze=None if gaze is None else at_deg(gaze), head=None if head is None else at_deg(head))
    found = look_at_nearest(subject, (LEFT, RIGHT), NEAREST.model_copy(update={"gaze_share": gaze_share}))
    assert found.focus == focus
    assert found.missing is (NoAttention.NO_DIRECTION if focus is None else None)
    expected = {} if shares is None else {number: np.multiply((*shares, 1), number == focus) for number in (1, 2)}
    assert {value.instance_id: (value.gaze, value.head, value.total) for value in found.values} == {
        number: pytest.approx(value, nan_ok=True) for number, value in expected.items()
    }


def test_the_gaze_decides_where_gaze_and_head_cancel() -> None:
    for gaze, focus in (((-1, 0, 2), 1), ((1, 0, 2), 2)):
        subject = make_subject(gaze=gaze, head=np.negative(gaze))
        assert look_at_nearest(subject, (LEFT, RIGHT), NEAREST.model_copy(update={"gaze_share": 0.5})).focus == focus


def test_beyond_the_limit_nothing_is_looked_at() -> None:
    """The right one lies 26.6 degrees to the right; the gaze is 16.6 degrees short of it."""
    subject = make_subject(gaze=at_deg(10))
    for limit, focus in ((16.5, None), (16.7, 2), (None, 2)):
        found = look_at_nearest(subject, (LEFT, RIGHT), NEAREST.model_copy(update={"limit_deg": limit}))
        assert found.focus == focus
        assert len(found.values) == 2
    behind = make_target(1, make_box((0, 0, -2)))
    assert (
        look_at_nearest(make_subject(gaze=(0, 0, 1)), (behind,), NEAREST.model_copy(update={"limit_deg": 180})).focus
        == 1
    )


def test_what_is_missing_is_said() -> None:
    assert look_at_nearest(make_subject(eyes=None, gaze=(0, 0, 1)), (), NEAREST).missing is NoAttention.NO_EYES_3D
    assert look_at_nearest(make_subject(gaze=(0, 0, 1)), (), NEAREST).focus is None


@given(st.integers(0, 10_000), st.floats(1, 180))
def test_it_is_the_box_with_the_least_angle_of_all(seed: int, limit_deg: float) -> None:
    subject, targets = random_room(seed)
    mean = 0.6 * subject.direction("gaze") + 0.4 * subject.direction("head")
    origin = subject.person.eye_origin_left
    angle_deg, number = min(
        (float(np.degrees(angle_between(each.box.center_m - origin, mean))), each.instance.id) for each in targets
    )
    found = look_at_nearest(subject, targets, NEAREST.model_copy(update={"limit_deg": limit_deg}))
    assert found.focus == (number if angle_deg <= limit_deg else None)
    assert [value.instance_id for value in found.values if value.total] == ([number] if found.focus else [])


def test_a_box_about_the_very_point_of_the_eyes_has_no_angle() -> None:
    subject, at_eyes = make_subject(gaze=(0, 0, 1)), make_target(1, make_box((0, 0, 0)))
    assert look_at_nearest(subject, (at_eyes, RIGHT), NEAREST).focus == 2
    assert look_at_nearest(subject, (at_eyes,), NEAREST.model_copy(update={"limit_deg": 180})).focus is None
