"""The steps of the Kalman filter against the moments of mixtures and the formula of Kalman, number by number."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import gamma

from vfoa.posterior import kalman
from vfoa.posterior.kalman import (
    ASIDE,
    DRIFT,
    HEAD,
    REST,
    GazeError,
    Normal,
    first_error,
    first_motion,
    mixed,
    next_error,
    next_motion,
    pooled,
    weighed,
)
from vfoa.posterior.looks import Transition

PARTS, TARGETS, HYPOTHESES = 3, 4, 2


def drawn(seed: int, targets: int = TARGETS) -> Normal:
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(PARTS, PARTS, targets, HYPOTHESES))
    means = rng.normal(size=(PARTS, 2, targets, HYPOTHESES))
    return Normal(means, np.einsum("prth,qrth->pqth", roots, roots))


def moments(states: list[tuple[float, Normal, int]], hypothesis: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean (P, 2) and covariance (P, P), averaged over the directions, of a mixture of targets of states."""
    means = [state.means[:, :, target, hypothesis] for _, state, target in states]
    mean = sum(share * each for (share, _, _), each in zip(states, means, strict=True))
    covariance = sum(
        share * (state.covariances[:, :, target, hypothesis] + (each - mean) @ (each - mean).T / 2)
        for (share, state, target), each in zip(states, means, strict=True)
    )
    return np.asarray(mean), np.asarray(covariance)


def test_targets_are_pooled_to_the_mean_and_the_covariance_of_their_mixture() -> None:
    states, shares = drawn(0), np.random.default_rng(1).dirichlet(np.ones(TARGETS), HYPOTHESES).T
    found = pooled(states, shares)
    for hypothesis in range(HYPOTHESES):
        mean, covariance = moments([(shares[t, hypothesis], states, t) for t in range(TARGETS)], hypothesis)
        np.testing.assert_allclose(found.means[:, :, 0, hypothesis], mean, rtol=1e-12)
        np.testing.assert_allclose(found.covariances[:, :, 0, hypothesis], covariance, rtol=1e-12)


def test_looks_that_go_on_are_mixed_with_new_ones_also_where_targets_have_other_places() -> None:
    before, new = drawn(2), drawn(3, targets=2)
    columns, stay = np.array([3, 1]), np.array([[0.0, 0.25], [0.6, 1.0]])
    found = mixed(before, new, Transition(columns, np.ones((TARGETS, HYPOTHESES)), stay, stay))
    for target, hypothesis in np.ndindex(2, HYPOTHESES):
        share = float(stay[target, hypothesis])
        parts = [(share, before, int(columns[target])), (1 - share, new, target)]
        mean, covariance = moments(parts, hypothesis)
        np.testing.assert_allclose(found.means[:, :, target, hypothesis], mean, rtol=1e-12)
        np.testing.assert_allclose(found.covariances[:, :, target, hypothesis], covariance, rtol=1e-12)


@pytest.mark.parametrize("seen", [slice(None), slice(2, None)], ids=["the sum of all parts", "the last part"])
def test_without_heavy_tails_a_measurement_is_weighed_as_by_kalman(
    seen: slice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kalman, "TAILS", 1e9)
    predicted, noise = drawn(4), np.array([0.3, 2.0])
    offset = np.random.default_rng(5).normal(size=(2, TARGETS, HYPOTHESES))
    after, evidence = weighed(predicted, np.ones((TARGETS, HYPOTHESES)), seen, offset, noise)
    observed = np.zeros(PARTS)
    observed[seen] = 1
    likelihood = np.empty((TARGETS, HYPOTHESES))
    for at in np.ndindex(TARGETS, HYPOTHESES):
        mean, covariance = predicted.means[:, :, *at], predicted.covariances[:, :, *at]
        variance = observed @ covariance @ observed + noise[at[1]]
        gain, surprise = covariance @ observed / variance, offset[:, *at] - observed @ mean
        np.testing.assert_allclose(after.means[:, :, *at], mean + np.outer(gain, surprise), rtol=1e-6)
        np.testing.assert_allclose(
            after.covariances[:, :, *at], covariance - np.outer(gain, gain) * variance, rtol=1e-6, atol=1e-9
        )
        likelihood[at] = np.exp(-(surprise @ surprise) / variance / 2) / variance
    np.testing.assert_allclose(
        evidence.likelihood / evidence.likelihood[0, 0], likelihood / likelihood[0, 0], rtol=1e-5
    )


def test_the_tail_of_a_measurement_is_that_of_students_distribution() -> None:
    """In two directions with 4 degrees of freedom: (1 + square / 4) ** -2 of the offsets lie farther out."""
    still = Normal(np.zeros((1, 2, 1, 1)), np.full((1, 1, 1, 1), 0.5))
    rng = np.random.default_rng(6)
    scale = np.sqrt(rng.chisquare(4, size=200_000) / 4)
    drawn_offsets = rng.normal(size=(2, 200_000)) / scale
    for length in (0.5, 1.5, 4.0):
        _, evidence = weighed(still, np.ones((1, 1)), slice(None), np.array([length, 0.0]).reshape(2, 1, 1), 0.5)
        assert evidence.tail == pytest.approx(np.mean(np.hypot(*drawn_offsets) > length), abs=0.005)


@pytest.mark.parametrize("length", [0.0, 0.7, 2.0, 9.0])
def test_an_outlier_counts_as_much_as_the_precision_that_it_suggests(length: float) -> None:
    """Student's distribution is a normal one whose precision is drawn, here summed up over all its values."""
    known, noise, precisions = 0.3, 0.5, np.linspace(0, 60, 600_001)[1:]
    likely = gamma.pdf(precisions, 2, scale=1 / 2) * precisions * np.exp(-precisions * length**2 / (known + noise) / 2)
    gain = known / (known + noise / np.average(precisions, weights=likely))
    still = Normal(np.zeros((1, 2, 1, 1)), np.full((1, 1, 1, 1), known))
    offset = length * np.array([0.6, -0.8]).reshape(2, 1, 1)
    after, _ = weighed(still, np.ones((1, 1)), slice(None), offset, noise)
    np.testing.assert_allclose(after.means[0], gain * offset, rtol=1e-6)
    assert after.covariances.item() == pytest.approx((1 - gain) * known, rel=1e-6)


def test_before_the_first_frame_nothing_but_the_spread_is_known() -> None:
    """The gaze's error and the point on the target share the drift; the head is at its goal, rest + aside."""
    rng = np.random.default_rng(13)
    slow, on_target = rng.uniform(0.1, 1, HYPOTHESES), rng.uniform(0.1, 1, (TARGETS, 1))
    rest, aside = rng.uniform(0.1, 1, HYPOTHESES), rng.uniform(0.1, 1, (TARGETS, HYPOTHESES))
    error, motion = first_error(0.3, slow, on_target), first_motion(rest, aside)
    assert not error.state.means.any()
    assert not motion.means.any()
    goal = np.array([[1.0, 0, 1], [0, 1, 1]])
    for target, hypothesis in np.ndindex(TARGETS, HYPOTHESES):
        drift = slow[hypothesis] + on_target[target, 0]
        assert error.lasting[target, hypothesis] == pytest.approx(slow[hypothesis] / drift)
        np.testing.assert_allclose(error.state.covariances[:, :, target, hypothesis], np.diag([0.3, drift]))
        parts = np.diag([rest[hypothesis], aside[target, hypothesis]])
        np.testing.assert_allclose(motion.covariances[:, :, target, hypothesis], goal.T @ parts @ goal)


@pytest.mark.parametrize("dt_s", [0.01, 0.04, 3.0])
def test_as_long_as_nothing_is_measured_a_look_that_goes_on_keeps_its_spread(dt_s: float) -> None:
    """What changes in a look comes back to where it was: its variance is that of the beginning at any time."""
    one, rng = np.ones((TARGETS, HYPOTHESES)), np.random.default_rng(7)
    goes_on = Transition(slice(None), one / TARGETS, one, one)
    slow, on_target, aside = (
        rng.uniform(0.1, 1, HYPOTHESES),
        rng.uniform(0.1, 1, (TARGETS, 1)),
        rng.uniform(0.1, 1, one.shape),
    )
    first = first_error(0.3, slow, on_target)
    after = next_error(first, goes_on, slow, on_target, keep=np.exp(-dt_s / 0.8)).state.covariances
    np.testing.assert_allclose(after, first.state.covariances, rtol=1e-12)
    np.testing.assert_allclose(after[DRIFT, DRIFT], slow + on_target)
    still = np.zeros((2, *one.shape))
    head = next_motion(first_motion(slow, aside), goes_on, still, 0.1, aside, dt_s, lag_s=0.35).covariances
    np.testing.assert_allclose(head[ASIDE, ASIDE], aside)
    np.testing.assert_allclose(head[REST, REST], np.broadcast_to(slow, one.shape))


def uneven() -> Transition:
    """Looks that go on with different probabilities, from targets that had other places."""
    rng = np.random.default_rng(8)
    looked = rng.dirichlet(np.ones(TARGETS), HYPOTHESES).T
    stay = rng.uniform(0.1, 0.9, (TARGETS, HYPOTHESES))
    return Transition(np.array([2, 0, 3, 1]), looked, stay, stay)


def alone(mean: np.ndarray, covariance: np.ndarray) -> Normal:
    """The state of one target under one hypothesis."""
    return Normal(mean[:, :, None, None], covariance[:, :, None, None])


def test_the_error_of_the_next_frame_is_that_of_each_look_worked_out_alone() -> None:
    """What outlasts a look, new points on the targets, and the drift: as matrices, target by target."""
    before, transition, rng, keep = drawn(9), uneven(), np.random.default_rng(10), 0.7
    before = Normal(before.means[:2], before.covariances[:2, :2])
    slow, on_target = rng.uniform(0.1, 1, HYPOTHESES), rng.uniform(0.1, 1, (TARGETS, 1))
    lasting = rng.uniform(0.2, 0.8, (TARGETS, HYPOTHESES))
    found = next_error(GazeError(before, lasting), transition, slow, on_target, keep)
    for target, hypothesis in np.ndindex(TARGETS, HYPOTHESES):
        ended = []
        for last in range(TARGETS):
            lasts = np.diag([1.0, lasting[last, hypothesis]])
            covariance = lasts @ before.covariances[:, :, last, hypothesis] @ lasts
            covariance[1, 1] += slow[hypothesis] * (1 - lasting[last, hypothesis])
            state = alone(lasts @ before.means[:, :, last, hypothesis], covariance)
            ended.append((float(transition.looked[last, hypothesis]), state, 0))
        mean, covariance = moments(ended, 0)
        covariance[1, 1] += on_target[target, 0]
        of_new = alone(mean, covariance)
        stay, last = float(transition.stay[target, hypothesis]), int(transition.columns[target])
        of_old = alone(before.means[:, :, last, hypothesis], before.covariances[:, :, last, hypothesis])
        mean, covariance = moments([(stay, of_old, 0), (1 - stay, of_new, 0)], 0)
        fades = np.diag([1.0, keep])
        expected = fades @ covariance @ fades
        drift = slow[hypothesis] + on_target[target, 0]
        expected[1, 1] += (1 - keep**2) * drift
        np.testing.assert_allclose(found.state.means[:, :, target, hypothesis], fades @ mean, rtol=1e-12)
        np.testing.assert_allclose(found.state.covariances[:, :, target, hypothesis], expected, rtol=1e-12)
        assert found.lasting[target, hypothesis] == pytest.approx(slow[hypothesis] / drift)


def test_the_head_of_the_next_frame_is_that_of_each_look_worked_out_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """It moves by a share of the way to rest + aside; a new look begins at the measured head. Target by target."""
    jitter, pace, aside_s, dt_s, lag_s, noise = 0.3, 0.8, 5.0, 0.2, 0.35, 0.05
    for name, value in (("_JITTER_RAD_PER_ROOT_S", jitter), ("_PACE_SPREAD", pace), ("_ASIDE_S", aside_s)):
        monkeypatch.setattr(kalman, name, value)
    before, transition, rng = drawn(11), uneven(), np.random.default_rng(12)
    last_offset = rng.normal(size=(2, TARGETS, HYPOTHESES))
    aside = rng.uniform(0.1, 1, (TARGETS, HYPOTHESES))
    found = next_motion(before, transition, last_offset, noise, aside, dt_s, lag_s)
    settle, move = np.exp(-dt_s / aside_s), 1 - np.exp(-dt_s / lag_s)
    for target, hypothesis in np.ndindex(TARGETS, HYPOTHESES):
        shares = [(float(transition.looked[last, hypothesis]), before, last) for last in range(TARGETS)]
        mean, covariance = moments(shares, hypothesis)
        at_begin = np.array([mean[REST], np.zeros(2), last_offset[:, target, hypothesis]])
        of_new = alone(at_begin, np.diag([covariance[REST, REST], aside[target, hypothesis], noise]))
        stay, last = float(transition.stay[target, hypothesis]), int(transition.columns[target])
        of_old = alone(before.means[:, :, last, hypothesis], before.covariances[:, :, last, hypothesis])
        mean, covariance = moments([(stay, of_old, 0), (1 - stay, of_new, 0)], 0)
        step = np.eye(PARTS)
        step[ASIDE, ASIDE] = settle
        step[HEAD] = move * np.array([1, settle, 0]) + (1 - move) * np.array([0, 0, 1])
        expected = step @ covariance @ step.T
        way = (step @ mean)[HEAD] - mean[HEAD]
        expected[ASIDE, ASIDE] += (1 - settle**2) * aside[target, hypothesis]
        expected[HEAD, HEAD] += jitter**2 * dt_s + pace**2 / move * (way @ way)
        np.testing.assert_allclose(found.means[:, :, target, hypothesis], step @ mean, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.covariances[:, :, target, hypothesis], expected, rtol=1e-12, atol=1e-12)
