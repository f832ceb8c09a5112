"""Intervals and tests of clips and looks against independent code: SciPy, statsmodels, plain loops."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from harness.score.comparison import Spread, clips_needed, detectable_difference
from harness.score.intervals import (
    Units,
    balanced_values,
    degrees_of_freedom,
    difference_interval,
    expanded_percentiles,
    rate_interval,
    resampled_rates,
    standard_error,
)
from harness.score.statistics import inferiority_p, needed_shift, power, sign_flip_interval, sign_flip_p, smallest_p


def _run(rng: np.random.Generator, clips: int, looks: int = 5, signed: bool = False) -> Units:
    """Looks of clips that differ in rate, in their number of looks, and in length."""
    counts = rng.integers(2, looks + 2, clips)
    frames = rng.integers(5, 40, counts.sum())
    rates = np.repeat(rng.beta(6, 2, clips), counts)
    values = rng.binomial(frames, rates) - (rng.binomial(frames, rates) if signed else 0)
    return Units(
        clips=np.repeat(np.arange(clips), counts), frames=frames.astype(np.float64), values=values.astype(np.float64)
    )


@pytest.mark.parametrize("seed", range(8))
def test_the_standard_error_is_that_of_a_clustered_regression(seed: int) -> None:
    import statsmodels.api as sm

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
def test_the_spread_of_the_balanced_rate_is_that_of_a_clustered_regression(seed: int) -> None:
    """Of the mean of two coefficients: the rates of the frames with a target, and of those without."""
    import statsmodels.api as sm

    rng = np.random.default_rng(seed)
    clips = np.repeat(np.arange(8), rng.integers(40, 120, 8))
    nowhere = rng.random(len(clips)) < rng.beta(2, 3, 8)[clips]
    correct = rng.random(len(clips)) < np.where(nowhere, 0.9, rng.beta(3, 3, 8)[clips])
    fit = sm.OLS(correct.astype(float), np.column_stack([~nowhere, nowhere]).astype(float)).fit(
        cov_type="cluster", cov_kwds={"groups": clips, "use_correction": False}
    )
    expected = fit.t_test([0.5, 0.5])
    values = balanced_values(correct, nowhere)
    frames, sums = np.bincount(clips).astype(np.float64), np.bincount(clips, values)
    units = Units(clips=np.arange(8), frames=frames, values=sums)
    assert units.rate == pytest.approx(expected.effect[0], abs=1e-12)
    assert standard_error(units) * math.sqrt(7 / 8) == pytest.approx(expected.sd[0, 0], rel=1e-9)
    interval = rate_interval(units)
    assert interval.low < units.rate < interval.high
    np.testing.assert_allclose(balanced_values(correct, np.zeros_like(nowhere)), correct, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_resampling_clips_is_that_of_scipy(seed: int) -> None:
    """With one look in every clip the second stage has nothing to draw."""
    from scipy.stats import bootstrap

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
    from scipy.stats import permutation_test

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
    from scipy.stats import beta

    units = Units(clips=np.arange(n), frames=np.full(n, 30.0), values=np.full(n, 30.0))
    found = rate_interval(units)
    assert (found.low, found.high) == (pytest.approx(beta.ppf(0.025, n, 1)), 1.0)
    same = difference_interval(Units(clips=np.arange(n), frames=np.full(n, 30.0), values=np.zeros(n)))
    assert same.low == -same.high < 0


@given(seed=st.integers(0, 10_000), clips=st.integers(1, 12), signed=st.booleans())
def test_an_interval_holds_its_rate_and_stays_within_bounds(seed: int, clips: int, signed: bool) -> None:
    units = _run(np.random.default_rng(seed), clips, signed=signed)
    found = (difference_interval if signed else rate_interval)(units)
    if math.isnan(found.low):  # too few units for a test, or every look differs alike
        assert len(units.merged().frames) < 6 or standard_error(units) == pytest.approx(0, abs=1e-12)
        return
    assert (-1.0 if signed else 0.0) <= found.low <= units.rate <= found.high <= 1.0


@pytest.mark.parametrize("alpha", [0.05, 0.0125])
@pytest.mark.parametrize("units", [4, 6, 8, 12, 30])
def test_power_is_that_of_brute_force(units: int, alpha: float) -> None:
    shift = needed_shift(units, alpha, 0.8)
    if smallest_p(units) >= alpha:
        assert shift == math.inf
        assert power(units, alpha, 100.0) == 0
        return
    rng = np.random.default_rng(units)
    samples = np.rint(100 * (shift + rng.standard_normal((400, units))))
    assert np.mean([sign_flip_p(sample) < alpha for sample in samples]) == pytest.approx(0.8, abs=0.06)
    assert power(units, alpha, shift) == pytest.approx(0.8, abs=0.01)


def test_nothing_is_detectable_where_no_result_is_significant() -> None:
    units = _run(np.random.default_rng(3), 7, signed=True)
    alone, corrected = detectable_difference(units), detectable_difference(units, family=4)
    assert 0 < alone < corrected == math.inf


@given(
    hnp.arrays(np.int64, st.integers(6, 14), elements=st.integers(-30, 30)), st.sampled_from([0.05, 0.0125, 0.05 / 45])
)
def test_an_interval_holds_what_its_test_does_not_reject(differences: np.ndarray, alpha: float) -> None:
    frames = np.full(len(differences), 30.0)
    found = sign_flip_interval(differences.astype(np.float64), frames, alpha)
    if smallest_p(len(differences)) >= alpha:
        assert found is None
        return
    assert found is not None
    assert (found[0] <= 0 <= found[1]) == (sign_flip_p(differences) >= alpha)
    if len(differences) <= 12:  # all subsets are listed: what lies beyond the ends is rejected
        for end, beyond in ((found[0], -0.02), (found[1], 0.02)):
            shifted = np.rint(100 * (differences - (end + beyond) * frames))
            if found[0] < found[1]:
                assert sign_flip_p(shifted) < alpha


@pytest.mark.parametrize("size", [20, 60, 300])
def test_totals_that_are_equal_count_for_a_possible_drop(size: int) -> None:
    """A margin of whole frames leaves many of them, which rounding must not tell apart."""
    rng = np.random.default_rng(size)
    frames, signs = np.full(7, float(size)), np.array([*itertools.product((-1, 1), repeat=7)])
    for differences in np.rint(rng.normal(0, size / 20, (40, 7))):
        shifted = differences + size // 20
        if shifted.sum() > 0:
            exact = float(np.mean(signs @ shifted >= shifted.sum()))
            assert inferiority_p(differences, frames, 0.05) == pytest.approx(exact, abs=1e-9)


def test_a_drop_is_ruled_out_by_units_that_agree() -> None:
    frames = np.full(10, 30.0)
    assert inferiority_p(np.zeros(10), frames, 0.05) == pytest.approx(2.0**-10)
    assert inferiority_p(-0.05 * frames, frames, 0.05) == 1.0
    rng = np.random.default_rng(1)
    equal = [inferiority_p(np.rint(rng.normal(-1.5, 6, 10)), frames, 0.05) < 0.05 for _ in range(400)]
    assert np.mean(equal) == pytest.approx(0.05, abs=0.035)


def test_fewer_clips_are_needed_for_a_larger_difference_with_more_looks_and_a_larger_pilot() -> None:
    spread = Spread(between=0.01, within=0.02, clips=8, looks=4)
    small, large, more = clips_needed(spread, 0.05), clips_needed(spread, 0.2), clips_needed(spread, 0.05, looks=40)
    known, corrected = clips_needed(replace(spread, clips=200), 0.05), clips_needed(spread, 0.05, family=6)
    assert small
    assert large
    assert more
    assert known
    assert corrected
    assert corrected.needed > small.needed > large.needed >= 6
    assert more.needed < small.needed
    assert known.needed < small.needed
    assert known.most
    assert small.most
    assert small.fewest < known.fewest <= known.needed <= known.most < small.most
    never = Spread(between=math.nan, within=0.02, clips=1, looks=4)
    assert clips_needed(never, 0.05) is None


@pytest.mark.parametrize("clips", [2, 3, 10, 50])
@pytest.mark.parametrize("family", [1, 6])
def test_a_plan_is_for_80_percent_and_lies_in_its_range(clips: int, family: int) -> None:
    spread = Spread(between=0.02, within=0.01, clips=clips, looks=4)
    planned = clips_needed(spread, 0.05, family=family)
    assert planned
    assert planned.needed > 20
    assert 0.8 <= planned.power < 0.81
    assert planned.fewest <= planned.needed <= (planned.most or math.inf)


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

    def found(clips: int) -> float:
        return float(np.mean([sign_flip_p(drawn(clips).merged().values) < 0.05 for _ in range(1000)]))

    planned = clips_needed(Spread.of(drawn(2000)), difference)
    longer = clips_needed(Spread.of(drawn(2000)), difference, looks=2 * looks)
    assert planned
    assert longer
    assert found(math.floor(0.9 * planned.needed)) < 0.8 < found(math.ceil(1.1 * planned.needed))
    assert longer.needed < planned.needed


@pytest.mark.parametrize(("n", "df"), [(6, 5), (10, 9), (16, 12)])
def test_percentiles_are_expanded_as_far_as_students_t_and_the_spread_of_few_units_ask(n: int, df: int) -> None:
    from scipy.stats import norm
    from scipy.stats import t as student

    uniform = np.linspace(0, 1, 100_001)
    tail = norm.cdf(np.sqrt(n / df) * student.ppf(0.025, df))  # Hesterberg (2015), section 4.3
    assert tail < 0.016
    assert expanded_percentiles(uniform, n, df) == pytest.approx((tail, 1 - tail), abs=1e-4)


def test_intervals_of_few_clips_hold_the_rate_as_often_as_they_say() -> None:
    held, repeats = 0, 300
    for seed in range(repeats):
        rng = np.random.default_rng([5, seed])
        clips = np.repeat(np.arange(8), 6)
        shares = np.clip(rng.normal(0.6, 0.15, 8), 0, 1)[clips]
        frames = np.full(48, 40.0)
        units = Units(clips=clips, frames=frames, values=rng.binomial(40, shares).astype(np.float64))
        interval = rate_interval(units)
        held += interval.low <= 0.6 <= interval.high
    assert 0.91 <= held / repeats <= 0.99  # plain percentiles hold it in about 85 %


@pytest.mark.parametrize("alpha", [0.05, 0.05 / 3, 0.001])
@pytest.mark.parametrize("n", [6, 9])
def test_no_difference_in_any_frame_has_the_exact_bound_at_the_corrected_level(n: int, alpha: float) -> None:
    same = Units(clips=np.arange(n), frames=np.full(n, 20.0), values=np.zeros(n))
    widest = 1 - (alpha / 2) ** (1 / n)  # Clopper and Pearson for none of n
    interval = difference_interval(same, alpha)
    assert (interval.low, interval.high) == pytest.approx((-widest, widest))


@pytest.mark.parametrize("looks", [6, 8])
@pytest.mark.parametrize(("worse", "better"), [(0.08, 0.08), (0.02, 0.1), (0.2, 0.1), (0.0, 0.1), (0.25, 0.25)])
def test_where_few_looks_differ_the_interval_holds_the_difference_as_often_as_it_says(
    looks: int, worse: float, better: float
) -> None:
    """By all samples with their probabilities; with a test alone, 75 to 93 of 100 intervals hold it."""
    from scipy.stats import multinomial

    held = 0.0
    for n_worse, n_better in product(range(looks + 1), repeat=2):
        same = looks - n_worse - n_better
        if same < 0:
            continue
        values = np.repeat([-2.0, 2.0, 0.0], [n_worse, n_better, same])
        units = Units(
            clips=np.zeros(looks, np.intp), frames=np.full(looks, 2.0), values=values, tracks=np.arange(looks)
        )
        interval = difference_interval(units)
        chance = multinomial.pmf([n_worse, n_better, same], looks, [worse, better, 1 - worse - better])
        held += chance * (not interval.low > better - worse and not interval.high < better - worse)
    assert held > 0.94


def test_looks_that_differ_a_little_leave_a_narrow_interval_in_the_other_direction() -> None:
    frames = np.full(10, 100.0)
    units = Units(clips=np.arange(10), frames=frames, values=np.array([-1.0, *[0.0] * 9]))
    interval = difference_interval(units)
    assert interval.low < -0.001 < 0 < interval.high < 0.01


@pytest.mark.parametrize(("clips", "looks"), [(1, 6), (2, 3), (3, 2), (4, 2), (5, 2), (4, 4)])
def test_intervals_of_few_looks_in_few_clips_hold_the_rate_as_often_as_they_say(clips: int, looks: int) -> None:
    rng, experiments, frames = np.random.default_rng(1), 300, 50
    held = 0
    for _ in range(experiments):
        of_clips = rng.uniform(0.4, 0.8, clips)
        rates = np.clip(of_clips[:, None] + rng.normal(0, 0.1, (clips, looks)), 0, 1).ravel()
        units = Units(
            clips=np.repeat(np.arange(clips), looks),
            frames=np.full(clips * looks, float(frames)),
            values=np.round(rates * frames),
        )
        interval = rate_interval(units)
        held += interval.low <= of_clips.mean() <= interval.high
    assert held / experiments > 0.91  # 95 % less three standard errors
