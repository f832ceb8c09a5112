"""Pooled ratios of several measures at once, with closed 95 % intervals.

A ratio is a sum of values over a sum of sizes: frames on a target over frames, seconds over looks, transitions over
minutes. Its units are those of :mod:`harness.score.intervals`: clips from ``LEAST_CLIPS`` on, below that looks within
each clip. The intervals are closed, because a run has thousands of such ratios: that of Clopper and Pearson with
the effective sample size of Korn and Graubard for a share, Student's t for a mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np

from harness.score.intervals import LEAST_CLIPS
from harness.score.statistics import LEVEL, Codes
from vfoa.types import Float

_TAIL = (1 - LEVEL) / 2
_Z = NormalDist().inv_cdf(1 - _TAIL)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratios:
    """K ratios ``value`` (K,) with the ends of their intervals, NaN where not known, and what these speak of."""

    value: Float
    low: Float
    high: Float
    unit: Literal["clip", "look"]


def pooled_ratios(clips: Codes, sizes: Float, values: Float, *, shares: bool) -> Ratios:
    """The ratios of K measures of U units.

    Parameters
    ----------
    clips
        The code of each unit's clip, (U,).
    sizes, values
        The sums of each unit, (U, K). A unit of size 0 does not count for that measure.
    shares
        Whether each value is at most its size, so that the ratios lie in [0, 1]. Else they are at least 0.
    """
    names, strata = np.unique(clips, return_inverse=True)
    by_clip = len(names) >= LEAST_CLIPS
    if by_clip:
        sizes, values = _summed(strata, sizes, len(names)), _summed(strata, values, len(names))
        strata = np.zeros(len(names), dtype=np.intp)
    there, total = sizes > 0, sizes.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = values.sum(axis=0) / total
        residuals = np.where(there, values - ratio * sizes, 0.0)
        variance, df = _between(strata, there.astype(np.float64), residuals)
        error = np.sqrt(variance) / total
        ends = _share_ends(ratio, error, df, there.sum(axis=0), total) if shares else _mean_ends(ratio, error, df)
    return Ratios(value=ratio, low=ends[0], high=ends[1], unit="clip" if by_clip else "look")


def _summed(groups: Codes, columns: Float, count: int) -> Float:
    """The sums (count, K) of the rows (U, K) of each group."""
    sums = np.zeros((count, columns.shape[1]))
    np.add.at(sums, groups, columns)
    return sums


def _between(strata: Codes, there: Float, residuals: Float) -> tuple[Float, Float]:
    """The variance (K,) of the sum of the residuals, and its degrees of freedom (K,).

    Within strata; where a stratum has one unit, which says nothing of itself, all units are one stratum.
    """
    count = int(strata.max(initial=-1)) + 1
    n, sums, squares = (_summed(strata, each, count) for each in (there, residuals, residuals**2))
    inside = np.where(n > 1, n / (n - 1) * (squares - sums**2 / n), 0.0).sum(axis=0)
    units = there.sum(axis=0)
    together = np.where(units > 1, units / (units - 1) * squares.sum(axis=0), 0.0)
    alone = (n == 1).any(axis=0)
    df = np.where(alone, units - 1, np.maximum(n - 1, 0).sum(axis=0))
    return np.maximum(np.where(alone, together, inside), 0.0), df


def _share_ends(share: Float, error: Float, df: Float, units: Float, total: Float) -> tuple[Float, Float]:
    from scipy.special import betaincinv, stdtrit

    widened = (_Z / stdtrit(np.maximum(df, 1), 1 - _TAIL)) ** 2
    told = (error > 0) & (share > 0) & (share < 1)
    trials = np.where(told, np.minimum(share * (1 - share) / error**2 * widened, total), units)
    right, wrong = share * trials, (1 - share) * trials
    low = np.where(right > 0, betaincinv(right, wrong + 1, _TAIL), 0.0)
    high = np.where(wrong > 0, betaincinv(right + 1, wrong, 1 - _TAIL), 1.0)
    known = units >= 2
    return np.where(known, low, np.nan), np.where(known, high, np.nan)


def _mean_ends(mean: Float, error: Float, df: Float) -> tuple[Float, Float]:
    from scipy.special import stdtrit

    half = stdtrit(np.maximum(df, 1), 1 - _TAIL) * error
    known = (df >= 1) & (error > 0)
    return np.where(known, np.maximum(mean - half, 0.0), np.nan), np.where(known, mean + half, np.nan)
