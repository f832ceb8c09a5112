"""Posterior attention against scenes whose probabilities are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.scenes import make_box, make_subject, make_target, random_room
from vfoa.bayes import BayesSettings, BeliefState, infer_attention, infer_attentions
from vfoa.pipeline import AttendSettings, Memory, attend
from vfoa.types import NoAttention, Scene

BAYES = BayesSettings(method="bayes")
SMOOTHED = BAYES.model_copy(update={"smoothing": "forward", "dwell_frames": 10.0})
AHEAD = (0, 0, 1)


def totals(attention):
    return {value.instance_id: value.total for value in attention.values}


def test_two_equal_targets_beside_the_gaze_are_equally_likely():
    targets = (make_target(1, make_box((-0.4, 0, 2))), make_target(2, make_box((0.4, 0, 2))))
    found = totals(infer_attention(make_subject(gaze=AHEAD, head=AHEAD), targets, BAYES))
    assert found[1] == pytest.approx(found[2], rel=0.02)


def test_a_small_target_on_the_axis_has_the_posterior_of_the_two_densities():
    """The mean density over a tiny target is that at its centre: c exp(0), c = kappa / (2 pi (1 - exp(-2 kappa)))."""
    settings = BAYES.model_copy(update={"cues": "gaze", "gaze_error_deg": 10.0, "view_deg": 360.0})
    kappa = (np.sqrt(np.pi / 2) / np.deg2rad(10)) ** 2
    target = 0.9 * kappa / (2 * np.pi)
    nowhere = 0.1 / (4 * np.pi)
    attention = infer_attention(make_subject(gaze=AHEAD), (make_target(1, make_box((0, 0, 3), 0.001)),), settings)
    assert totals(attention)[1] == pytest.approx(target / (target + nowhere), rel=1e-4)
    assert attention.focus == 1


def test_a_bigger_target_is_not_favoured():
    """Same nearest direction, one twice as large: the mean density of the small one is the greater."""
    targets = (make_target(1, make_box((-0.5, 0, 2), 0.1)), make_target(2, make_box((0.7, 0, 2), 0.3)))
    found = totals(infer_attention(make_subject(gaze=AHEAD), targets, BAYES))
    assert found[1] > found[2]


def test_a_target_behind_another_is_not_seen():
    targets = (make_target(1, make_box((0, 0, 2), 0.3)), make_target(2, make_box((0, 0, 4), 0.1)))
    subject = make_subject(gaze=AHEAD)
    assert totals(infer_attention(subject, targets, BAYES))[2] == 0
    assert totals(infer_attention(subject, targets, BAYES.model_copy(update={"occlusion": "ignore"})))[2] > 0


@given(st.integers(0, 10_000))
def test_probabilities_are_shared_out_among_targets_and_nowhere(seed):
    subject, targets = random_room(seed)
    values = infer_attention(subject, targets, BAYES).values
    assert all(0 <= value.total <= 1 for value in values)
    assert sum(value.total for value in values) <= 1 + 1e-9
    assert [value.gaze + value.head for value in values] == pytest.approx([value.total for value in values])


def test_a_look_away_from_everything_is_nowhere():
    attention = infer_attention(make_subject(gaze=(0, 0, -1)), (make_target(1, make_box((0, 0, 2))),), BAYES)
    assert attention.focus is None
    assert infer_attention(make_subject(gaze=AHEAD), (), BAYES).focus is None


def test_what_is_missing_is_said():
    assert infer_attention(make_subject(eyes=None, gaze=AHEAD), (), BAYES).missing is NoAttention.NO_EYES_3D
    assert infer_attention(make_subject(), (), BAYES).missing is NoAttention.NO_DIRECTION


def test_the_forward_pass_is_the_filter_of_the_hidden_markov_model():
    """Two frames by hand: the prediction from the first posterior, times the second frame's likelihood."""
    targets = (make_target(1, make_box((-0.3, 0, 2))), make_target(2, make_box((0.3, 0, 2))))
    subjects = (make_subject(gaze=(-0.15, 0, 0.989)),), (make_subject(gaze=(0.02, 0, 1)),)
    state, seen = BeliefState(), []
    for frame in subjects:
        (attention,), state = infer_attentions(frame, targets, state, SMOOTHED)
        seen.append(totals(attention))
    prior = np.array([0.45, 0.45, 0.1])
    alone = totals(infer_attention(subjects[1][0], targets, BAYES))
    likelihood = np.array([*alone.values(), 1 - sum(alone.values())]) / prior
    before = np.array([*seen[0].values(), 1 - sum(seen[0].values())])
    joint = (0.9 * before + 0.1 * prior) * likelihood
    assert list(seen[1].values()) == pytest.approx((joint / joint.sum())[:2].tolist())


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
