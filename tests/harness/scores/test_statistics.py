"""Every closed form against the function of a library that is known for it, on random data."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest
from sklearn.metrics import cohen_kappa_score, f1_score
from statsmodels.stats.contingency_tables import mcnemar
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import proportion_confint

from harness.scores.statistics import (
    REPLICATES,
    block_length,
    bootstrap_interval,
    cohen_kappa,
    confusion_matrix,
    holm,
    macro_f1,
    mcnemar_exact,
    resampled_sums,
    wilson_interval,
)


@given(n=st.integers(1, 10_000), share=st.floats(0, 1))
def test_wilson_is_that_of_the_libraries(n: int, share: float) -> None:
    correct = round(share * n)
    found = wilson_interval(correct, n)
    assert (found.low, found.high) == pytest.approx(proportion_confint(correct, n, method="wilson"), abs=1e-12)
    scipy = binomtest(correct, n).proportion_ci(method="wilson")
    assert (found.low, found.high) == pytest.approx((scipy.low, scipy.high), abs=1e-12)


@pytest.mark.parametrize(("correct", "percent"), [(28, (42, 69)), (35, (56, 81)), (31, (48, 74)), (38, (63, 86))])
def test_wilson_of_the_papers_table(correct: int, percent: tuple[int, int]) -> None:
    found = wilson_interval(correct, 50)
    assert (round(100 * found.low), round(100 * found.high)) == percent


def test_nothing_measured_has_no_interval() -> None:
    found = [wilson_interval(0, 0), bootstrap_interval([], 0)]
    assert all(math.isnan(each.low) and math.isnan(each.high) for each in found)


@given(better=st.integers(0, 400), worse=st.integers(0, 400))
def test_mcnemar_is_that_of_statsmodels(better: int, worse: int) -> None:
    expected = mcnemar([[5, better], [worse, 7]], exact=True).pvalue if better + worse else 1.0
    assert mcnemar_exact(better, worse) == pytest.approx(float(expected), rel=1e-10, abs=1e-12)


def test_mcnemar_of_the_papers_best_case() -> None:
    assert mcnemar_exact(3, 0) == 0.25


def test_holm_is_that_of_statsmodels() -> None:
    rng = np.random.default_rng(4)
    for n in (1, 2, 6, 20, 66):
        p_values = np.round(rng.random(n) ** 3, 2).tolist()  # rounded, so that some are equal
        assert holm(p_values) == pytest.approx(multipletests(p_values, method="holm")[1], abs=1e-12)


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=2, max_size=200))
def test_kappa_and_macro_f1_are_those_of_scikit_learn(pairs: list[tuple[int, int]]) -> None:
    truth, predicted = np.array(pairs, dtype=np.intp).T
    confusion = confusion_matrix(truth, predicted, 5)
    labels = np.unique(truth)
    f1 = f1_score(truth, predicted, labels=labels, average="macro", zero_division=0)
    assert macro_f1(confusion) == pytest.approx(f1, abs=1e-12)
    if len({*truth.tolist(), *predicted.tolist()}) > 1:
        assert cohen_kappa(confusion) == pytest.approx(cohen_kappa_score(truth, predicted), abs=1e-12)
    else:
        assert math.isnan(cohen_kappa(confusion))  # 0 / 0: chance alone always agrees


def test_measures_of_nothing_are_unknown() -> None:
    nothing = np.zeros((2, 2), dtype=np.intp)
    assert math.isnan(cohen_kappa(nothing))
    assert math.isnan(macro_f1(nothing))


@given(correct=st.lists(st.booleans(), min_size=1, max_size=60), block=st.integers(1, 80), key=st.text(max_size=5))
def test_a_resample_is_made_of_whole_blocks_of_the_sequence(correct: list[bool], block: int, key: str) -> None:
    sums = resampled_sums(np.array(correct), block, key)
    n, block = len(correct), min(block, len(correct))
    blocks = [sum(correct[i : i + block]) for i in range(n - block + 1)]
    rest = n - (-(-n // block) - 1) * block
    rests = [sum(correct[i : i + rest]) for i in range(n - block + 1)]
    whole = -(-n // block) - 1
    assert len(sums) == REPLICATES
    assert sums.min() >= whole * min(blocks) + min(rests)
    assert sums.max() <= whole * max(blocks) + max(rests)


def test_the_bootstrap_of_independent_frames_is_as_wide_as_theory_says() -> None:
    correct = np.random.default_rng(1).random(400) < 0.6
    found = bootstrap_interval([resampled_sums(correct, 1, "a")], 400)
    share = correct.mean()
    half = 1.96 * math.sqrt(share * (1 - share) / 400)
    assert (found.low, found.high) == pytest.approx((share - half, share + half), abs=0.01)


def test_the_bootstrap_of_long_runs_is_wider_than_wilson() -> None:
    correct = np.repeat(np.random.default_rng(2).random(40) < 0.5, 25)  # forty looks, right or wrong as a whole
    found = bootstrap_interval([resampled_sums(correct, 25, "a")], 1000)
    wilson = wilson_interval(int(correct.sum()), 1000)
    assert found.high - found.low > 3 * (wilson.high - wilson.low)


def test_a_bootstrap_repeats_itself_and_keeps_subjects_apart() -> None:
    correct = np.random.default_rng(3).random(100) < 0.5
    first, again, other = (resampled_sums(correct, 5, key) for key in ("a/girl", "a/girl", "a/boy"))
    assert np.array_equal(first, again)
    assert abs(np.corrcoef(first, other)[0, 1]) < 0.1


@pytest.mark.parametrize(
    ("n", "rate_hz", "expected"), [(1000, 25.0, 25), (50, 24.0, 10), (1000, None, 10), (3, 25.0, 1), (100, 0.2, 1)]
)
def test_a_block_is_a_second_but_never_most_of_the_sequence(n: int, rate_hz: float | None, expected: int) -> None:
    assert block_length(n, rate_hz) == expected
