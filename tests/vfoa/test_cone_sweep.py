"""Many cone settings at once: what pay_attention says of each, and nothing else."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_box, make_subject, make_target, random_room
from vfoa.attention import AttentionSettings, pay_attention
from vfoa.cone_sweep import NOWHERE, UNKNOWN, ConeSweep

SETTINGS = tuple(
    AttentionSettings(cones_deg=cones, n_rays=n_rays, axis_ray=axis_ray, weighting=weighting, occlusion=occlusion)
    for cones, n_rays, axis_ray, weighting, occlusion in itertools.product(
        [(5,), (20,), (60,), (10.4, 25.6), (20, 20), (20, 60, 90)],
        [1, 8, 40],
        [True, False],
        ["adaptive", "equal", "gaze", "head"],
        ["ignore", "first_hit"],
    )
)
SWEEP = ConeSweep(SETTINGS)


def one_by_one(subject, targets):
    answers = [pay_attention(subject, targets, settings) for settings in SETTINGS]
    return [UNKNOWN if each.missing else each.focus or NOWHERE for each in answers]


@given(st.integers(0, 2**32 - 1))
def test_every_setting_gets_the_focus_it_has_alone(seed):
    subject, targets = random_room(seed)
    assert SWEEP.foci(subject, targets).tolist() == one_by_one(subject, targets)


@pytest.mark.parametrize("missing", ["gaze", "head_pose"])
def test_a_cue_that_was_not_measured_gives_its_weight_to_the_other(missing):
    subject, targets = random_room(7)
    subject = replace(subject, **{missing: None})
    answers = SWEEP.foci(subject, targets).tolist()
    assert answers == one_by_one(subject, targets)
    assert UNKNOWN in answers


def test_nobody_looks_at_their_own_body():
    subject, targets = random_room(3)
    seen = SWEEP.foci(subject, targets)
    own = int(np.bincount(seen[seen > 0]).argmax())
    subject = replace(subject, person=replace(subject.person, instance_id=own))
    answers = SWEEP.foci(subject, targets)
    assert own not in answers
    assert answers.tolist() == one_by_one(subject, targets)


def test_an_exact_tie_goes_to_the_box_that_is_entered_first():
    twins = tuple(make_target(number, make_box((side, 0, 1.1))) for number, side in ((1, 0.3), (2, -0.3)))
    subject = make_subject(gaze=(0, 0, 1), head=(0, 0, 1))
    assert SWEEP.foci(subject, twins).tolist() == one_by_one(subject, twins)


def test_without_eyes_directions_or_boxes():
    subject, targets = random_room(1)
    blind = replace(subject, person=replace(subject.person, eye_origin_left=None))
    aimless = replace(subject, gaze=None, head_pose=None)
    assert set(SWEEP.foci(blind, targets)) == {UNKNOWN}
    assert set(SWEEP.foci(aimless, targets)) == {UNKNOWN}
    assert set(SWEEP.foci(subject, (make_target(1, None),))) == {NOWHERE}


def test_nowhere_and_unknown_are_no_instance_ids():
    """Ids begin at 1."""
    assert UNKNOWN < NOWHERE < 1
