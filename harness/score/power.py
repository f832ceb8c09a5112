"""Which differences an experiment can see: power of a comparison, from the spread between clips and between looks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from harness.score.intervals import LEAST_CLIPS, Units, degrees_of_freedom, standard_error
from harness.score.statistics import LEVEL

POWER = 0.8
_MOST_CLIPS = 100_000


def detectable_difference(units: Units, power: float = POWER) -> float:
    """The true difference that a comparison on these units calls significant with this probability; NaN if unknown."""
    if len(units.frames) < 2:
        return math.nan
    error, df = standard_error(units), degrees_of_freedom(units)
    return math.nan if error == 0 else error * _needed_errors(df, power)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """How a difference of two configurations varies: variances of a clip's difference, as shares squared.

    ``between`` is between clips, ``within`` what a clip's ``looks`` looks leave; NaN between where one clip is known.
    """

    between: float
    within: float
    clips: int
    looks: float

    @classmethod
    def of(cls, units: Units) -> Spread:
        """The spread of these units. Clips count by their frames, as in the pooled rate."""
        clips, codes = np.unique(units.clips, return_inverse=True)
        n, total = len(clips), float(units.frames.sum())
        residuals = units.values - units.rate * units.frames
        of_clips = np.bincount(codes, residuals)
        looks = np.bincount(codes)
        inner = residuals - (of_clips / looks)[codes]
        several = looks > 1
        factor = np.where(several, looks / np.maximum(looks - 1, 1), 0.0)
        # both are variances of a clip's sum over the mean frames of a clip
        scale = (total / n) ** 2
        within = float((factor * np.bincount(codes, inner**2))[several].mean() / scale) if several.any() else math.nan
        if n < 2:
            return cls(between=math.nan, within=within, clips=n, looks=float(looks.mean()))
        both = float((of_clips**2).sum() / (n - 1) / scale)
        known = 0.0 if math.isnan(within) else within
        return cls(between=max(both - known, 0.0), within=min(known, both), clips=n, looks=float(looks.mean()))

    def variance(self, looks: float) -> float:
        """The variance of a clip's difference with this many looks per clip."""
        return self.between + self.within * self.looks / looks


def clips_needed(spread: Spread, difference: float, looks: float | None = None, power: float = POWER) -> int | None:
    """The fewest clips on which a true difference (a share) is called significant with this probability.

    Parameters
    ----------
    looks
        Looks in each clip; as many as now if None.

    Returns
    -------
    int or None
        At least :data:`harness.score.intervals.LEAST_CLIPS`; None if more than 100,000 would not do, or the spread
        between clips is not known.
    """
    variance = spread.variance(looks or spread.looks)
    if math.isnan(variance):
        return None
    deviation = math.sqrt(variance)
    low, high = LEAST_CLIPS - 1, LEAST_CLIPS
    while deviation / math.sqrt(high) * _needed_errors(high - 1, power) > difference:
        low, high = high, 2 * high
        if high > _MOST_CLIPS:
            return None
    while high - low > 1:
        middle = (low + high) // 2
        if deviation / math.sqrt(middle) * _needed_errors(middle - 1, power) > difference:
            low = middle
        else:
            high = middle
    return high


def _needed_errors(df: int, power: float) -> float:
    """How many standard errors a true difference must be: the non-centrality at which Student's test has this power."""
    from scipy.special import nctdtr, stdtrit

    critical = float(stdtrit(df, (1 + LEVEL) / 2))
    low, high = 0.0, 4 * critical + 4
    for _ in range(60):
        middle = (low + high) / 2
        seen = 1 - float(nctdtr(df, middle, critical)) + float(nctdtr(df, middle, -critical))
        low, high = (middle, high) if not seen >= power else (low, middle)
    return high
