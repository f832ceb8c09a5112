"""The model of eyes and head against what it must say of gazes that were made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal, rayleigh

from tests.scenes import make_subject
from vfoa.eye_head import (
    ASIDE,
    BIAS,
    HEAD,
    OFFSET,
    REST,
    EyeHeadSettings,
    Hypotheses,
    Places,
    first_fixation,
    measured_cues,
    next_frame,
    sigma_rad,
    weigh,
)
from vfoa.geometry import angle_between, perturb, unit
from vfoa.types import Gaze, HeadPose

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
    subject = replace(make_subject(), gaze=Gaze(direction=(0, 0, 1), sigma_rad=0.01))
    assert measured_cues(subject, SETTINGS)["gaze"][1] == pytest.approx(1e-4)
    published = SETTINGS.model_copy(update={"spread": "published"})
    assert measured_cues(subject, published)["gaze"][1] == pytest.approx(sigma_rad(11.1) ** 2)
    assert measured_cues(subject, SETTINGS.model_copy(update={"cues": "head"})) == MappingProxyType({})


def test_an_error_is_a_mean_angle_of_a_gaussian_in_two_directions():
    assert rayleigh.mean(scale=sigma_rad(10.0)) == pytest.approx(np.deg2rad(10.0))


def test_each_cue_has_its_own_published_error_and_none_is_sharper_than_a_hundredth_of_a_degree():
    subject = make_subject(gaze=(0, 0, 1), head=(0, 0, 1))
    settings = EyeHeadSettings(gaze_error_deg=8.0, head_error_deg=4.0)
    assert {cue: variance for cue, (_, variance) in measured_cues(subject, settings).items()} == pytest.approx(
        {"gaze": sigma_rad(8.0) ** 2, "head": sigma_rad(4.0) ** 2}
    )
    sure = replace(subject, head_pose=HeadPose(direction=(0, 0, 1), sigma_rad=0.0))
    assert measured_cues(sure, settings)["head"][1] == pytest.approx(np.deg2rad(0.01) ** 2)


# The model written out, one state and one case at a time

MODEL = EyeHeadSettings(bias_share=0.3, bias_frames=7.0, head_share=0.4, head_pace=0.25, aside_deg=8.0, rest_deg=30.0)
ASIDE_VARIANCE, REST_VARIANCE = sigma_rad(8.0) ** 2, sigma_rad(30.0) ** 2


def some_belief(seed, keys=(1, 2, None)):
    """Any belief: means near those of people, full covariances."""
    rng = np.random.default_rng(seed)
    means = rng.normal(0, 0.1, (len(keys), 5, 3))
    means[:, [HEAD, REST]] += (0, 0, 1)
    roots = rng.normal(0, 0.1, (len(keys), 5, 5))
    return Hypotheses(
        keys=keys,
        weights=rng.dirichlet(np.ones(len(keys))),
        means=means,
        covariances=roots @ roots.transpose(0, 2, 1),
    )


def some_places(seed, keys=(2, 3, None)):
    rng = np.random.default_rng(seed)
    directions = unit(rng.normal((0, 0, 1), 0.4, (len(keys), 3)))
    return Places(keys=keys, directions=directions, variances=rng.uniform(0.001, 0.1, len(keys)))


def part_of_the_way(start, end, share):
    """A direction on the great circle between two."""
    start, end = unit(start), unit(end)
    axis = unit(np.cross(start, end)) * float(angle_between(start, end))
    return Rotation.from_rotvec(share * axis).apply(start)


def collapsed(parts):
    """Mean and covariance per tangent direction of a mixture of (probability, mean, covariance)."""
    mean = sum(p * m for p, m, _ in parts)
    return mean, sum(p * (c + (m - mean) @ (m - mean).T / 2) for p, m, c in parts)


def anew(mean, covariance, look_variance):
    """What a new fixation keeps of a belief: all but where on the target the eyes rest, and the head's stay aside."""
    mean, covariance = mean.copy(), covariance.copy()
    for state, variance in ((OFFSET, look_variance), (ASIDE, ASIDE_VARIANCE)):
        mean[state] = 0
        covariance[state, :] = covariance[:, state] = 0
        covariance[state, state] = variance
    return mean, covariance


@pytest.mark.parametrize("seed", range(4))
def test_the_next_frame_is_the_mixture_of_staying_and_leaving_moved_on_by_one_frame(seed):
    before, places = some_belief(seed), some_places(seed + 10)
    stay = np.array([0.7, 0.0, 0.4])  # target 3 was not there
    weights = np.array([0.5, 0.2, 0.3])
    measured = measured_cues(make_subject(gaze=(0, 0, 1)), MODEL)
    found = next_frame(before, places, stay, weights, measured, MODEL)

    keep = np.exp(-1 / 7.0)
    gaze_bias_variance = 0.3 * sigma_rad(11.1) ** 2
    share, pace = 0.4, 0.25
    for row, key in enumerate(places.keys):
        parts = [(stay[row], before.means[i], before.covariances[i]) for i, old in enumerate(before.keys) if old == key]
        for p, mean, covariance in zip(before.weights, before.means, before.covariances, strict=True):
            parts.append(((1 - stay[row]) * p, *anew(mean, covariance, places.variances[row])))
        mean, covariance = collapsed(parts)
        goal = part_of_the_way(mean[REST], places.directions[row] + mean[OFFSET], share) + mean[ASIDE]
        moved = mean.copy()
        moved[BIAS] = keep * mean[BIAS]
        moved[HEAD] = (1 - pace) * mean[HEAD] + pace * goal
        step = np.array(
            [
                [1, 0, 0, 0, 0],
                [0, keep, 0, 0, 0],
                [0, 0, 1, 0, 0],
                [pace * share, 0, pace, 1 - pace, pace * (1 - share)],
                [0, 0, 0, 0, 1],
            ]
        )
        drift = np.diag([0, (1 - keep**2) * gaze_bias_variance, 0, np.deg2rad(3.0) ** 2, np.deg2rad(0.2) ** 2])
        np.testing.assert_allclose(found.means[row], moved, atol=1e-12)
        np.testing.assert_allclose(found.covariances[row], step @ covariance @ step.T + drift, atol=1e-12)
    assert found.keys == places.keys
    assert found.weights.tolist() == weights.tolist()


@pytest.mark.parametrize(("cue", "gaze_sigma"), [("gaze", 0.05), ("head", sigma_rad(11.1))])
def test_at_first_the_head_has_come_to_where_offset_aside_and_rest_put_it(cue, gaze_sigma):
    places, share = some_places(5), 0.4
    subject = (
        make_subject(head=(0, 0, 1))
        if cue == "head"
        else replace(make_subject(), gaze=Gaze(direction=(0, 0, 1), sigma_rad=gaze_sigma))
    )
    found = first_fixation(places, EVEN, measured_cues(subject, MODEL), MODEL)
    rest = unit(places.directions.mean(axis=0))
    for row, direction in enumerate(places.directions):
        np.testing.assert_allclose(found.means[row, REST], rest)
        np.testing.assert_allclose(found.means[row, HEAD], part_of_the_way(rest, direction, share))
        assert not found.means[row, [OFFSET, BIAS, ASIDE]].any()
        # what each state is made of: offset, bias, aside, rest
        made_of = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [share, 0, 1, 1 - share], [0, 0, 0, 1]])
        variances = np.diag([places.variances[row], 0.3 * gaze_sigma**2, ASIDE_VARIANCE, REST_VARIANCE])
        np.testing.assert_allclose(found.covariances[row], made_of @ variances @ made_of.T, atol=1e-15)


@pytest.mark.parametrize("cues", [("gaze",), ("head",), ("gaze", "head")])
def test_a_frame_weighs_by_the_densities_and_updates_as_gaussians_do(cues):
    """All differences lie in the tangent plane at (0, 0, 1), where a Gaussian has its two dimensions."""
    flat = np.array([1, 1, 0])
    predicted = some_belief(8)
    means = predicted.means * flat + np.array([0, 0, 0, 1, 1])[:, None] * (0, 0, 1)
    predicted = replace(predicted, means=means)
    places = Places(keys=predicted.keys, directions=np.array([(0.2, 0, 1), (-0.1, 0.3, 1), (0, 0, 1)]), variances=EVEN)
    measured = {
        cue: (np.array(direction), variance)
        for cue, direction, variance in (("gaze", (0.1, 0.2, 1), 0.02), ("head", (0.05, -0.1, 1), 0.01))
        if cue in cues
    }
    found = weigh(predicted, places, measured, MODEL, evidence=0.6)

    rows = {"gaze": [1, 1, 0, 0, 0], "head": [0, 0, 0, 1, 0]}
    seen = np.array([rows[cue] for cue in measured])
    noise = np.diag([0.7 * variance for _, variance in measured.values()])
    log_weights = np.log(predicted.weights)
    for row, (mean, covariance) in enumerate(zip(means, predicted.covariances, strict=True)):
        at = np.array([places.directions[row] if cue == "gaze" else np.zeros(3) for cue in measured])
        told = np.array([direction for direction, _ in measured.values()]) - at
        density = multivariate_normal(np.zeros(len(measured)), seen @ covariance @ seen.T + noise)
        log_weights[row] += 0.6 * sum(density.logpdf((told - seen @ mean)[:, axis]) for axis in (0, 1))
        # the update by adding up information instead of by a gain
        information = np.linalg.inv(covariance) + seen.T @ np.linalg.inv(noise) @ seen
        updated = np.linalg.solve(information, np.linalg.solve(covariance, mean) + seen.T @ np.linalg.inv(noise) @ told)
        np.testing.assert_allclose(found.covariances[row], np.linalg.inv(information), atol=1e-9)
        np.testing.assert_allclose(found.means[row], updated, atol=1e-9)
    expected = np.exp(log_weights)
    np.testing.assert_allclose(found.weights, expected / expected.sum())


def test_a_sharp_gaze_far_from_everything_still_gives_probabilities():
    places = replace(PLACES, variances=np.full(3, 1e-8))
    for direction, expected in (((0.0, 1.0, 0.0), None), (LEFT, (1, 0, 0))):
        measured = {"gaze": (np.array(direction), 1e-8)}
        weights = weigh(first_fixation(places, EVEN, measured, MODEL), places, measured, MODEL).weights
        assert weights.sum() == pytest.approx(1)
        assert expected is None or weights.tolist() == pytest.approx(expected)


# Settings


@pytest.mark.parametrize(
    ("name", "last_good", "refused"),
    [
        ("gaze_error_deg", 60, (0, 61)),
        ("head_error_deg", 60, (0, 61)),
        ("bias_share", 0, (-0.1, 1)),
        ("bias_frames", 0.5, (0,)),
        ("evidence", 1, (0, 1.1)),
        ("head_share", 1, (0, 1.1)),
        ("head_pace", 1, (0, 1.1)),
        ("aside_deg", 90, (0, 91)),
        ("rest_deg", 90, (0, 91)),
    ],
)
def test_a_setting_outside_of_its_range_is_refused(name, last_good, refused):
    assert getattr(EyeHeadSettings(**{name: last_good}), name) == last_good
    for value in refused:
        with pytest.raises(ValidationError, match=name):
            EyeHeadSettings(**{name: value})
