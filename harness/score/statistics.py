"""Shares, corrections, and the sign-flip test of paired differences with its interval and power.

They are short closed forms, written out: importing scipy.stats, statsmodels or scikit-learn takes as long as scoring a
run. The tests compare each of them with those libraries.

The sign-flip test: if two configurations are equal, the difference of each unit (a clip or a stretch of one) could as
well have the other sign. The test needs no more than that, and keeps its level with few units (Canay, Romano and
Shaikh, "Randomization tests under an approximate symmetry assumption", Econometrica 85, 2017). Its interval holds the
differences that it does not reject, so the two never contradict each other. The ends are order statistics of the pooled
differences of all subsets of the units (Hartigan, "Using subsample values as typical values", Journal of the American
Statistical Association 64, 1969).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfoa.types import Codes, Float

Counts = NDArray[np.intp]

LEVEL = 0.95
SIGNIFICANCE = 0.05
REPLICATES = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A 95 % confidence interval of a share or of a difference of shares; NaN if it is not known.

    ``unit`` is the independent unit: ``"clip"`` is valid for clips like these, ``"look"`` for these clips only, and
    ``"frame"`` would be valid if frames were independent.
    """

    low: float
    high: float
    unit: Literal["clip", "look", "frame"] = "frame"


NO_INTERVAL = Interval(low=math.nan, high=math.nan)


def wilson_interval(correct: int, n: int) -> Interval:
    """Wilson's score interval (Wilson 1927) of a share of independent trials, which frames are not."""
    if n == 0:
        return NO_INTERVAL
    z = NormalDist().inv_cdf((1 + LEVEL) / 2)
    share = correct / n
    center = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return Interval(low=max(center - half, 0.0), high=min(center + half, 1.0))


def holm(p_values: Sequence[float]) -> list[float]:
    """Correct p values for their number by Holm's step-down method (Holm 1979), in the order given."""
    corrected = [0.0] * len(p_values)
    highest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = highest
    return corrected


_ALL_SUBSETS = 12
"""Most units of which all subsets are listed; of more, a sample of as many subsets is drawn."""
_LIKE_STUDENT = 20
"""Units from which on the power of the test is that of Student's t, to 0.01."""
_CERTAIN = 10.0
"""Standard errors beyond the critical value from which on a difference is found for certain."""
_DRAWS = 2000
_FINEST = 50_000
"""Number of steps into which the sum of differences that are not whole numbers is divided."""


def sign_flip_p(differences: Codes | Float) -> float:
    """Two-sided p of sums of differences (U,) in whole frames, if each unit's sign is as likely as its opposite.

    p is the share of all 2^U assignments of signs whose total is at least as far from 0 as the observed one. The total
    is a whole number, so its whole distribution is computed, one unit after another: p is exact for any number of
    units.
    """
    total = float(differences.sum())
    return 1.0 if total == 0 else min(1.0, 2 * _upper_tail(differences if total > 0 else -differences))


def smallest_p(units: int) -> float:
    """The smallest two-sided p that the test can give with this many units."""
    return min(1.0, 2.0 ** (1 - units))


def inferiority_p(differences: Float, frames: Float, margin: float) -> float:
    """One-sided p of the hypothesis that the pooled difference is ``-margin`` (a share) or worse.

    It is the sign-flip test of the differences plus the margin, so it assumes that differences are symmetric about
    their mean. Below 5 %, a drop of more than the margin is ruled out.
    """
    shifted = differences + margin * frames
    steps = _FINEST / max(float(np.abs(shifted).sum()), 1e-12)
    # each unit is rounded by half a step at most: totals that were equal are at most a step for each unit apart
    return _upper_tail(np.rint(shifted * steps), slack=len(shifted)) if shifted.sum() > 0 else 1.0


def _upper_tail(differences: Codes | Float, slack: int = 0) -> float:
    """The share of the assignments of signs with a total at least as large as the observed one, which is positive.

    Totals that are smaller by the ``slack`` or less count as equal.
    """
    sizes = np.abs(np.rint(differences[differences != 0])).astype(np.int64)
    step = math.gcd(*sizes.tolist())
    total = round(float(differences.sum()) - slack) // step
    chance = np.ones(1)  # distribution over the totals -k, -k + 2, ..., k, where k is the sum of the sizes so far
    for size in (sizes // step).tolist():
        wider = np.zeros(len(chance) + size)
        wider[: len(chance)] += chance / 2
        wider[size:] += chance / 2
        chance = wider
    # place i is the total 2 i - k
    return float(chance[(total + len(chance)) // 2 :].sum())


def sign_flip_interval(differences: Float, frames: Float, alpha: float) -> tuple[float, float] | None:
    """The pooled differences that the test at level ``alpha`` does not reject; None if it can reject nothing.

    It holds 0 exactly if the p of :func:`sign_flip_p` is at least ``alpha``.
    """
    beyond = _rejected_subsets(len(frames), alpha)
    if beyond is None:
        return None
    subsets = _subsets(len(frames))
    rates = np.sort((subsets @ differences) / (subsets @ frames))
    low, high = float(rates[beyond]), float(rates[-1 - beyond])
    if sign_flip_p(differences) >= alpha:  # a sample of subsets can miss by a little
        return min(low, 0.0), max(high, 0.0)
    least = 0.5 / float(frames.sum())
    return (max(low, least), high) if differences.sum() > 0 else (low, min(high, -least))


def power(units: int, alpha: float, shift: float | Float) -> Float:
    """The probability that the test at level ``alpha`` finds a difference significant; 0 if it can find none.

    Parameters
    ----------
    shift
        The true difference in standard deviations of one unit's difference, which are normal and weigh the same.
    """
    shifts = np.asarray(shift, dtype=np.float64)
    if _rejected_subsets(units, alpha) is None:
        return np.zeros_like(shifts)
    if units <= _LIKE_STUDENT:
        limits = _critical_shifts(units, alpha)
        return np.searchsorted(limits, shifts, side="right") / len(limits)
    from scipy.special import nctdtr, stdtrit

    critical = float(stdtrit(units - 1, 1 - alpha / 2))
    errors = np.minimum(shifts * math.sqrt(units), critical + _CERTAIN)  # nctdtr has no value far out
    return np.asarray(1 - nctdtr(units - 1, errors, critical))


def needed_shift(units: int, alpha: float, wanted: float) -> float:
    """The shift at which :func:`power` is this large; infinite if the test can find nothing."""
    if _rejected_subsets(units, alpha) is None:
        return math.inf
    if units <= _LIKE_STUDENT:
        return float(np.quantile(_critical_shifts(units, alpha), wanted))
    from scipy.special import nctdtrinc, stdtrit

    return float(nctdtrinc(units - 1, 1 - wanted, stdtrit(units - 1, 1 - alpha / 2))) / math.sqrt(units)


@lru_cache(maxsize=64)
def _critical_shifts(units: int, alpha: float) -> Float:
    """The shift from which on the test rejects each of many normal samples: (draws,), in ascending order.

    It is minus the lower end of a sample's interval.
    """
    beyond = _rejected_subsets(units, alpha) or 0
    subsets = _subsets(units).astype(np.float32)
    noise = np.random.default_rng([units, 1]).standard_normal((_DRAWS, units), dtype=np.float32)
    weights = (subsets / subsets.sum(axis=1, keepdims=True)).T
    ends = [np.partition(part @ weights, beyond, axis=1)[:, beyond] for part in np.array_split(noise, 16)]
    return np.sort(-np.concatenate(ends).astype(np.float64))


def _rejected_subsets(units: int, alpha: float) -> int | None:
    """How many of the subsets with the smallest differences lie below the interval; None if there is no interval."""
    subsets = 2.0 ** min(units, _ALL_SUBSETS)
    if smallest_p(units) >= alpha:
        return None
    return max(math.ceil(alpha * subsets / 2) - 2, 0)  # the p of this place is the largest below alpha


@lru_cache(maxsize=16)
def _subsets(units: int) -> NDArray[np.float64]:
    """Subsets that are not empty, as rows of zeros and ones: all of few units, a sample for more."""
    if units <= _ALL_SUBSETS:
        return ((np.arange(1, 2**units)[:, None] >> np.arange(units)) & 1).astype(np.float64)
    drawn = np.random.default_rng(units).integers(0, 2, (2**_ALL_SUBSETS - 1, units))
    drawn[~drawn.any(axis=1), 0] = 1
    return drawn.astype(np.float64)
