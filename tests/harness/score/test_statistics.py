"""Every closed form against the function of a library that is known for it, on random data."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest
from sklearn.metrics import cohen_kappa_score, f1_score
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import proportion_confint

from harness.score.statistics import cohen_kappa, confusion_matrix, holm, macro_f1, wilson_interval


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
    found = wilson_interval(0, 0)
    assert math.isnan(found.low)
    assert math.isnan(found.high)


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
