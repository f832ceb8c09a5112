"""The model of eyes and head against what it must say of gazes that were made by hand."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest

from tests.scenes import make_subject
from vfoa.eye_head import (
    ASIDE,
    BIAS,
    HEAD,
    EyeHeadSettings,
    Places,
    first_fixation,
    measured_cues,
    next_frame,
    sigma_rad,
    weigh,
)
from vfoa.geometry import angle_between, perturb

SETTINGS = EyeHeadSettings()
LEFT, RIGHT = perturb((0, 0, 1), -0.2, 0), perturb((0, 0, 1), 0.2, 0)
PLACES = Places(keys=(1, 2, None), directions=np.array([LEFT, RIGHT, (0, 0, 1)]), variances=np.array([1e-6, 1e-6, 0.3]))
EVEN = np.array([0.45, 0.45, 0.1])
STAY = np.full(3, 0.95)


def gaze_alone(direction, settings=SETTINGS):
    return measured_cues(make_subject(gaze=direction), settings)


def after(frames, settings=SETTINGS):
    """The belief after some frames of measured cues, with even weights before each."""
    belief = weigh(first_fixation(PLACES, EVEN, frames[0], settings), PLACES, frames[0], settings)
    for measured in frames[1:]:
        predicted = next_frame(belief, PLACES, STAY, belief.weights, measured, settings)
        belief = weigh(predicted, PLACES, measured, settings)
    return belief


def test_one_gaze_weighs_two_points_as_the_two_densities_do():
    """Gaussian of the chord with the published error's variance; what is common to both cancels."""
    direction = perturb((0, 0, 1), 0.05, 0.0)
    belief = after([gaze_alone(direction)])
    square = sigma_rad(11.1) ** 2 + 1e-6
    chords = [float(((direction - side) ** 2).sum()) for side in (LEFT, RIGHT)]
    assert belief.weights[1] / belief.weights[0] == pytest.approx(np.exp((chords[0] - chords[1]) / square / 2))


def test_the_same_error_again_and_again_convinces_less_than_new_ones_would():
    measured = gaze_alone(perturb((0, 0, 1), 0.03, 0.0))
    correlated = after([measured] * 20).weights
    independent = after([measured] * 20, SETTINGS.model_copy(update={"bias_share": 0.0})).weights
    assert correlated[1] / correlated[0] < independent[1] / independent[0]


def test_a_bias_that_lasts_is_learnt():
    """The gaze is always 0.1 rad above a target that nothing else is near."""
    belief = after([gaze_alone(perturb(RIGHT, 0.0, -0.1))] * 60)
    right, down, _ = belief.means[1, BIAS]
    assert down == pytest.approx(-0.1, abs=0.03)
    assert abs(right) < 0.03


def test_a_head_takes_its_share_of_the_way():
    belief = first_fixation(PLACES, EVEN, gaze_alone((0, 0, 1)), SETTINGS)
    rest = PLACES.directions.mean(axis=0)
    for head, target in zip(belief.means[:2, HEAD], (LEFT, RIGHT), strict=True):
        assert float(angle_between(head, rest)) == pytest.approx(0.5 * float(angle_between(rest, target)))


def test_a_head_says_where_the_gaze_is_not_measured():
    subject = make_subject(head=perturb((0, 0, 1), 0.15, 0.0))
    weights = after([measured_cues(subject, SETTINGS)]).weights
    assert weights[1] > weights[0]


def test_a_new_fixation_forgets_how_far_the_head_stayed_aside():
    measured = measured_cues(make_subject(gaze=RIGHT, head=LEFT), SETTINGS)
    belief = after([measured] * 30)
    gone = next_frame(belief, PLACES, np.zeros(3), EVEN, measured, SETTINGS)
    assert np.linalg.norm(belief.means[1, ASIDE]) > 0.02
    assert np.linalg.norm(gone.means[:, ASIDE], axis=-1) == pytest.approx(0)
    assert gone.covariances[:, ASIDE, ASIDE] == pytest.approx(sigma_rad(SETTINGS.aside_deg) ** 2)


def test_covariances_stay_symmetric_and_positive():
    rng = np.random.default_rng(3)
    frames = [measured_cues(make_subject(gaze=g, head=h), SETTINGS) for g, h in rng.normal((0, 0, 1), 0.3, (80, 2, 3))]
    covariances = after(frames).covariances
    assert covariances == pytest.approx(covariances.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(covariances).min() > -1e-9


def test_a_claimed_error_counts_unless_the_published_one_is_wanted():
    from dataclasses import replace

    from vfoa.types import Gaze

    subject = replace(make_subject(), gaze=Gaze(direction=(0, 0, 1), sigma_rad=0.01))
    assert measured_cues(subject, SETTINGS)["gaze"][1] == pytest.approx(1e-4)
    published = SETTINGS.model_copy(update={"spread": "published"})
    assert measured_cues(subject, published)["gaze"][1] == pytest.approx(sigma_rad(11.1) ** 2)
    assert measured_cues(subject, SETTINGS.model_copy(update={"cues": "head"})) == MappingProxyType({})
