"""Posterior attention against scenes whose probabilities are known."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.scenes import make_box, make_subject, make_target, random_room, with_points
from vfoa.bayes import BayesSettings, BeliefState, infer_attentions
from vfoa.pipeline import AttendSettings, Memory, attend
from vfoa.types import NoAttention, Scene

BAYES = BayesSettings(method="bayes", surface="box")
SMOOTHED = BAYES.model_copy(update={"smoothing": "forward", "dwell_frames": 10.0})
AHEAD = (0, 0, 1)


def infer(subject, targets, settings=BAYES):
    (attention,), _ = infer_attentions((subject,), targets, BeliefState(), settings)
    return attention


def totals(attention):
    return {value.instance_id: value.total for value in attention.values}


def test_two_equal_targets_beside_the_gaze_are_equally_likely():
    targets = (make_target(1, make_box((-0.4, 0, 2))), make_target(2, make_box((0.4, 0, 2))))
    found = totals(infer(make_subject(gaze=AHEAD, head=AHEAD), targets))
    assert found[1] == pytest.approx(found[2], rel=0.02)


def test_a_small_target_on_the_axis_has_the_posterior_of_the_two_densities():
    """Gaussians about the same direction: their densities are as the inverses of their variances."""
    settings = BAYES.model_copy(update={"cues": "gaze", "gaze_error_deg": 10.0, "nowhere_deg": 60.0})
    error, look = 10.0**2, 60.0**2
    target, nowhere = 0.9 / error, 0.1 / (error + look)
    attention = infer(make_subject(gaze=AHEAD), (make_target(1, make_box((0, 0, 3), 0.001)),), settings)
    assert totals(attention)[1] == pytest.approx(target / (target + nowhere), rel=1e-4)
    assert attention.focus == 1


def test_a_bigger_target_is_not_favoured():
    """Same nearest direction, one twice as large: the mean density of the small one is the greater."""
    targets = (make_target(1, make_box((-0.5, 0, 2), 0.1)), make_target(2, make_box((0.7, 0, 2), 0.3)))
    found = totals(infer(make_subject(gaze=AHEAD), targets))
    assert found[1] > found[2]


def test_a_target_behind_another_is_not_seen():
    targets = (make_target(1, make_box((0, 0, 2), 0.3)), make_target(2, make_box((0, 0, 4), 0.1)))
    subject = make_subject(gaze=AHEAD)
    assert totals(infer(subject, targets, BAYES.model_copy(update={"occlusion": "first_hit"})))[2] == 0
    assert totals(infer(subject, targets))[2] > 0


@given(st.integers(0, 10_000))
def test_probabilities_are_shared_out_among_targets_and_nowhere(seed):
    subject, targets = random_room(seed)
    values = infer(subject, targets).values
    assert all(0 <= value.total <= 1 for value in values)
    assert sum(value.total for value in values) <= 1 + 1e-9
    assert [value.gaze + value.head for value in values] == pytest.approx([value.total for value in values])


def test_a_look_away_from_everything_is_nowhere():
    assert infer(make_subject(gaze=(0, 0, -1)), (make_target(1, make_box((0, 0, 2))),)).focus is None
    assert infer(make_subject(gaze=AHEAD), ()).focus is None


def test_between_two_opposite_targets_the_one_that_is_looked_at_is_likelier():
    """They have no middle for nowhere to lie about."""
    targets = tuple(with_points(make_target(n, make_box((x, 0, 0))), [(x, 0, 0)]) for n, x in ((1, 1.0), (2, -1.0)))
    found = infer(make_subject(gaze=(1, 0, 0)), targets, BAYES.model_copy(update={"surface": "cloud"}))
    assert found.focus == 1
    assert 0 < totals(found)[2] < totals(found)[1] < 1


def test_nobody_looks_at_their_own_body():
    subject = make_subject(gaze=AHEAD, instance_id=1)
    assert infer(subject, (make_target(1, make_box((0, 0, 2))),)).values == ()


def test_what_is_missing_is_said():
    assert infer(make_subject(eyes=None, gaze=AHEAD), ()).missing is NoAttention.NO_EYES_3D
    assert infer(make_subject(), ()).missing is NoAttention.NO_DIRECTION


def test_a_frame_that_disagrees_is_outvoted_by_the_frames_before_it():
    targets = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))
    left, right = (make_subject(gaze=(x, 0, 1)) for x in (-0.15, 0.1))
    state = BeliefState()
    for subject in (left, left, left, right):
        (attention,), state = infer_attentions((subject,), targets, state, SMOOTHED)
    assert attention.focus == 1
    assert infer(right, targets).focus == 2


def test_a_gaze_that_moves_on_is_believed_in_the_end():
    targets = (make_target(1, make_box((-0.6, 0, 2))), make_target(2, make_box((0.6, 0, 2))))
    state = BeliefState()
    for x in [-0.3] * 10 + [0.3] * 10:
        (attention,), state = infer_attentions((make_subject(gaze=(x, 0, 1)),), targets, state, SMOOTHED)
    assert attention.focus == 2


def test_targets_that_come_and_go_are_known_by_their_ids():
    one, other = make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2)))
    subject = make_subject(gaze=(0.15, 0, 1))
    state = BeliefState()
    for targets in ((one,), (other, one), (other,), (one, other)):
        (attention,), state = infer_attentions((subject,), targets, state, SMOOTHED)
    assert attention.focus == 2


def test_the_pipeline_carries_beliefs_from_frame_to_frame():
    subject = make_subject(gaze=(-0.15, 0, 0.989))
    targets = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))
    scene = Scene(index=1, time_ns=0, targets=targets, people=(subject.person,))
    settings = AttendSettings(attention=SMOOTHED)
    first, memory = attend(scene, Memory(), settings)
    second, _ = attend(replace(scene, index=2), memory, settings)
    assert totals(second.attentions[0])[1] > totals(first.attentions[0])[1]


def test_settings_of_cones_are_refused():
    with pytest.raises(ValidationError, match="n_rays"):
        BayesSettings.model_validate({"method": "bayes", "n_rays": 4})
