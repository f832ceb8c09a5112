"""Intervals and tests of clips and looks against independent code: SciPy, statsmodels, plain loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
import statsmodels.api as sm
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.stats import beta, bootstrap, permutation_test
from statsmodels.stats.power import TTestPower

from harness.score.comparison import Spread, clips_needed, detectable_difference
from harness.score.intervals import (
    Units,
    degrees_of_freedom,
    difference_interval,
    rate_interval,
    resampled_rates,
    standard_error,
)
from harness.score.statistics import sign_flip_p


def _run(rng: np.random.Generator, clips: int, looks: int = 5, signed: bool = False) -> Units:
    """Looks of clips that differ in rate, in their number of looks, and in length."""
    counts = rng.integers(2, looks + 2, clips)
    frames = rng.integers(5, 40, counts.sum())
    rates = np.repeat(rng.beta(6, 2, clips), counts)
    values = rng.binomial(frames, rates) - (rng.binomial(frames, rates) if signed else 0)
    return Units(
        clips=np.repeat(np.arange(clips), counts), frames=frames.astype(np.float64), values=values.astype(np.float64)
    )


def _of_clips(units: Units) -> tuple[np.ndarray, np.ndarray]:
    return np.bincount(units.clips, units.values), np.bincount(units.clips, units.frames)


@pytest.mark.parametrize("seed", range(8))
def test_the_standard_error_is_that_of_a_clustered_regression(seed: int) -> None:
    rng = np.random.default_rng(seed)
    units = _run(rng, clips=6 + 2 * seed, signed=seed % 2 == 1)
    frames = units.frames.astype(int)
    # frames whose values sum to each look's
    sizes = np.concatenate([np.arange(n) < abs(value) for value, n in zip(units.values, frames, strict=True)])
    frame_values = sizes * np.repeat(np.sign(units.values), frames)
    clusters = np.repeat(units.clips, frames)
    fit = sm.OLS(frame_values, np.ones_like(frame_values)).fit(
        cov_type="cluster", cov_kwds={"groups": clusters}, use_t=True
    )
    assert units.rate == pytest.approx(fit.params[0], abs=1e-12)
    assert standard_error(units) == pytest.approx(fit.bse[0], rel=1e-9)
    assert degrees_of_freedom(units) == fit.df_resid_inference == units.n_clips - 1


@pytest.mark.parametrize("seed", range(4))
def test_resampling_clips_is_that_of_scipy(seed: int) -> None:
    """With one look in every clip the second stage has nothing to draw."""
    rng = np.random.default_rng(seed)
    units = _run(rng, clips=12).merged()
    found = resampled_rates(units)
    expected = bootstrap(
        (units.values, units.frames),
        lambda values, frames, axis: values.sum(axis) / frames.sum(axis),
        paired=True,
        n_resamples=20_000,
        method="percentile",
        rng=rng,
    )
    assert found.std(ddof=1) == pytest.approx(expected.standard_error, rel=0.08)
    ends = expected.confidence_interval
    assert np.quantile(found, [0.025, 0.975]) == pytest.approx([ends.low, ends.high], abs=0.15 * (ends.high - ends.low))


@pytest.mark.parametrize("clips", [3, 8])
def test_resampling_is_that_of_a_plain_loop(clips: int) -> None:
    """Clips with replacement, then looks within each drawn clip; with few clips, looks within each clip."""
    rng = np.random.default_rng(clips)
    units = _run(rng, clips)
    inside = [np.flatnonzero(units.clips == clip) for clip in range(clips)]
    rates = []
    for _ in range(4000):
        drawn = rng.integers(0, clips, clips) if clips >= 6 else range(clips)
        looks = np.concatenate([rng.choice(inside[clip], len(inside[clip])) for clip in drawn])
        rates.append(units.values[looks].sum() / units.frames[looks].sum())
    found = resampled_rates(units)
    assert found.mean() == pytest.approx(np.mean(rates), abs=0.15 * np.std(rates))
    assert found.std() == pytest.approx(np.std(rates), rel=0.08)


@given(hnp.arrays(np.int64, st.integers(1, 10), elements=st.integers(-30, 30)))
def test_the_sign_flip_test_is_scipys_exact_permutation_test(differences: np.ndarray) -> None:
    found = sign_flip_p(differences)
    if len(differences) < 2:
        assert found == 1.0
        return
    expected = permutation_test(
        (differences, np.zeros_like(differences)),
        lambda one, other, axis: (one - other).sum(axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=np.inf,
    )
    assert found == pytest.approx(expected.pvalue, abs=1e-12)


def test_many_units_are_tested_exactly_too() -> None:
    """Of 400 units of one frame each, the test is the binomial one: McNemar's."""
    from scipy.stats import binomtest

    signs = np.array([1] * 225 + [-1] * 175)
    assert sign_flip_p(signs) == pytest.approx(binomtest(225, 400).pvalue, rel=1e-9)


def test_the_unit_of_an_interval_follows_the_number_of_clips() -> None:
    rng = np.random.default_rng(2)
    assert rate_interval(_run(rng, 5)).unit == "look"
    assert rate_interval(_run(rng, 6)).unit == "clip"
    one = Units(clips=np.zeros(1, dtype=np.intp), frames=np.array([50.0]), values=np.array([35.0]))
    assert math.isnan(rate_interval(one).low)
    assert math.isnan(difference_interval(one).low)


@pytest.mark.parametrize("n", [3, 7, 12])
def test_where_all_is_right_the_interval_is_the_exact_one_of_the_units(n: int) -> None:
    units = Units(clips=np.arange(n), frames=np.full(n, 30.0), values=np.full(n, 30.0))
    found = rate_interval(units)
    assert (found.low, found.high) == (pytest.approx(beta.ppf(0.025, n, 1)), 1.0)
    same = difference_interval(Units(clips=np.arange(n), frames=np.full(n, 30.0), values=np.zeros(n)))
    assert same.low == -same.high < 0


@given(seed=st.integers(0, 10_000), clips=st.integers(1, 12), signed=st.booleans())
def test_an_interval_holds_its_rate_and_stays_within_bounds(seed: int, clips: int, signed: bool) -> None:
    units = _run(np.random.default_rng(seed), clips, signed=signed)
    found = (difference_interval if signed else rate_interval)(units)
    if math.isnan(found.low):  # every look differs alike
        assert standard_error(units) == pytest.approx(0, abs=1e-12)
        return
    assert (-1.0 if signed else 0.0) <= found.low <= units.rate <= found.high <= 1.0


def test_power_is_that_of_statsmodels() -> None:
    rng = np.random.default_rng(3)
    for clips in (6, 10, 40):
        units = _run(rng, clips, signed=True)
        error = standard_error(units)
        expected = TTestPower().solve_power(nobs=clips, alpha=0.05, power=0.8)
        assert detectable_difference(units) == pytest.approx(expected * error * math.sqrt(clips), rel=1e-3)


def test_fewer_clips_are_needed_for_a_larger_difference_and_with_more_looks() -> None:
    spread = Spread(between=0.01, within=0.02, clips=8, looks=4)
    small, large = clips_needed(spread, 0.05), clips_needed(spread, 0.2)
    assert small is not None
    assert large is not None
    assert small > large >= 6
    more = clips_needed(spread, 0.05, looks=40)
    assert more is not None
    assert more < small
    never = Spread(between=math.nan, within=0.02, clips=1, looks=4)
    assert clips_needed(never, 0.05) is None


def test_the_spread_of_clips_and_looks_is_found_again() -> None:
    rng = np.random.default_rng(5)
    clips, looks, frames = 400, 6, 20
    of_clips = rng.normal(0, 0.1, clips)
    values = frames * (np.repeat(of_clips, looks) + rng.normal(0, 0.3, clips * looks))
    units = Units(clips=np.repeat(np.arange(clips), looks), frames=np.full(clips * looks, float(frames)), values=values)
    found = Spread.of(units)
    assert found.looks == looks
    assert found.between == pytest.approx(0.1**2, rel=0.35)
    assert found.within == pytest.approx(0.3**2 / looks, rel=0.1)


@pytest.mark.parametrize(("between", "within", "difference"), [(0.10, 0.20, 0.08), (0.05, 0.30, 0.10)])
def test_a_plan_is_that_of_brute_force(between: float, within: float, difference: float) -> None:
    """Within 10 %: with a tenth fewer clips than planned the power is below 80 %, with a tenth more above."""
    rng = np.random.default_rng(6)
    looks, frames = 5, 40

    def drawn(clips: int) -> Units:
        rates = difference + np.repeat(rng.normal(0, between, clips), looks) + rng.normal(0, within, clips * looks)
        return Units(
            clips=np.repeat(np.arange(clips), looks),
            frames=np.full(clips * looks, float(frames)),
            values=np.rint(frames * rates),
        )

    def power(clips: int) -> float:
        return float(np.mean([sign_flip_p(drawn(clips).merged().values) < 0.05 for _ in range(1500)]))

    planned = clips_needed(Spread.of(drawn(2000)), difference)
    assert planned is not None
    assert power(math.floor(0.9 * planned)) < 0.8 < power(math.ceil(1.1 * planned))
    assert clips_needed(Spread.of(drawn(2000)), difference, looks=2 * looks) < planned
