"""Every closed form against the function of a library that is known for it, on random data."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.score.statistics import holm, wilson_interval


@given(n=st.integers(1, 10_000), share=st.floats(0, 1))
def test_wilson_is_that_of_the_libraries(n: int, share: float) -> None:
    from scipy.stats import binomtest
    from statsmodels.stats.proportion import proportion_confint

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
    from statsmodels.stats.multitest import multipletests

    rng = np.random.default_rng(4)
    for n in (1, 2, 6, 20, 66):
        p_values = np.round(rng.random(n) ** 3, 2).tolist()  # rounded, so that some are equal
        assert holm(p_values) == pytest.approx(multipletests(p_values, method="holm")[1], abs=1e-12)
