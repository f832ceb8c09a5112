"""The paper's five synthetic cases: a 0.4 m cube centred 1.1 m in front of the eyes, cones with surface rays only.

Where the paper gives no measures (the corner, the direction outside, the second object) the scenes are ours.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from vfoa.attention import AttentionSettings, pay_attention
from vfoa.types import Box3D, Cues, Gaze, HeadPose, Instance, Person, Subject, Target, TargetAttention

Vector = tuple[float, float, float]

AHEAD: Vector = (0.0, 0.0, 1.0)
CORNER: Vector = (0.18, 0.18, 0.9)
OUTSIDE: Vector = (0.45, 0.0, 1.0)
ASIDE: Vector = (math.sin(math.radians(25)), 0.0, math.cos(math.radians(25)))
CENTRE: Vector = (0.0, 0.0, 1.1)


@dataclass(frozen=True)
class Cube:
    """An object: centre and half of its side, metres, camera frame."""

    center_m: Vector = CENTRE
    half_m: float = 0.2


def attention(
    radius_cm: float, n_rays: int = 40, gaze: Vector = AHEAD, head: Vector = AHEAD, cubes: tuple[Cube, ...] = (Cube(),)
) -> tuple[TargetAttention, ...]:
    """The attention to each cube of a person at the origin; ``radius_cm`` is the cone's at 1.10 m."""
    view = Cues(head_pose=HeadPose(direction=np.array(head)), gaze=Gaze(direction=np.array(gaze)))
    person = Person(view=view, instance_id=0, eye_origin_left=np.zeros(3))
    subject = Subject(track_id=1, person=person, gaze=view.gaze, head_pose=view.head_pose)
    targets = tuple(
        Target(
            instance=Instance(id=number, label="cube", category_id=1, is_thing=True, score=1.0),
            box_px=None,
            points_left=np.zeros((0, 3), np.float32),
            box=Box3D(center_m=np.array(cube.center_m), half_size_m=np.full(3, cube.half_m), left_from_box=np.eye(3)),
        )
        for number, cube in enumerate(cubes, start=1)
    )
    settings = AttentionSettings(cones_cm=(radius_cm,), n_rays=n_rays, axis_ray=False)
    return pay_attention(subject, targets, settings).values


@pytest.mark.parametrize(
    ("n_rays", "radius_cm", "expected"),
    [(40, 5, 0.99), (40, 10, 0.95), (40, 20, 0.82), (4, 30, 0.0), (40, 30, 0.19), (40, 40, 0.0)],
)
def test_both_cues_on_the_centre_give_less_as_the_cone_widens(n_rays: int, radius_cm: float, expected: float) -> None:
    (value,) = attention(radius_cm, n_rays)
    assert value.total == pytest.approx(expected, abs=0.005)
    assert value.total == pytest.approx(value.gaze + value.head)


def test_the_gaze_weighs_more_than_the_head() -> None:
    (both,) = attention(5)
    assert both.gaze / both.total == pytest.approx(0.6, abs=0.005)
    assert both.head == pytest.approx(0.39, abs=0.005)


def test_a_cue_on_a_corner_gives_less_and_the_other_keeps_its_part() -> None:
    (both,), (head_corner,), (gaze_corner,) = attention(5), attention(5, head=CORNER), attention(5, gaze=CORNER)
    assert head_corner.head == pytest.approx(0.1, abs=0.05)
    assert head_corner.gaze == pytest.approx(both.gaze)
    assert gaze_corner.head == pytest.approx(both.head)
    assert gaze_corner.gaze < both.gaze


def test_with_one_cue_outside_the_total_is_the_part_of_the_other() -> None:
    (both,), (head_off,), (gaze_off,) = attention(5), attention(5, head=OUTSIDE), attention(5, gaze=OUTSIDE)
    assert head_off.total == pytest.approx(both.gaze)
    assert gaze_off.total == pytest.approx(both.head)


def test_of_two_sizes_in_view_the_bigger_gets_more() -> None:
    small, big = attention(30, cubes=(Cube((-0.25, 0.0, 1.1)), Cube((0.35, 0.0, 1.1), half_m=0.3)))
    assert 0 < small.total < big.total


def test_with_gaze_and_head_on_different_objects_that_of_the_gaze_wins() -> None:
    of_gaze, of_head = attention(5, head=ASIDE, cubes=(Cube(), Cube((1.1 * ASIDE[0], 0.0, 1.1 * ASIDE[2]))))
    assert of_gaze.total > of_head.total > 0
