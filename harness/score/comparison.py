"""Comparison of two configurations on the frames that both were scored on, with the smallest detectable difference."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from harness.score.intervals import LEAST_CLIPS, Units, degrees_of_freedom, difference_interval, standard_error
from harness.score.scored_frames import Pairs, ScoredFrames, pair
from harness.score.statistics import LEVEL, SIGNIFICANCE, UNKNOWN, Interval, holm, sign_flip_p

POWER = 0.8
_MOST_CLIPS = 100_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A configuration compared with an earlier one (``reference``) on ``n`` common frames.

    ``better`` frames are right only in the configuration, ``worse`` frames only in the reference. ``difference`` is
    that of the rates, with its 95 % interval. ``p`` is of the exact sign-flip test over ``unit``: clips if there are
    enough, else looks, in which case it is valid for these clips only. ``p_holm`` is corrected for the comparisons made
    together (``family``). ``detectable`` is the true difference that such a comparison finds significant with 80 %
    power; NaN if unknown.
    """

    reference: str
    configuration: str
    n: int
    looks: int
    clips: int
    better: int
    worse: int
    difference: float
    interval: Interval
    unit: Literal["clip", "look"]
    p: float
    p_holm: float
    family: int
    detectable: float

    @property
    def is_significant(self) -> bool:
        """Whether the corrected p is below 5 %."""
        return self.p_holm < SIGNIFICANCE

    @property
    def verdict(self) -> Literal["better", "worse", "cannot be told apart"]:
        """The result in words."""
        if not self.is_significant:
            return "cannot be told apart"
        return "worse" if self.worse > self.better else "better"

    def is_drop(self, tolerance: float = 0.0) -> bool:
        """Whether the configuration is significantly worse, and by more than the tolerance (a share)."""
        return self.verdict == "worse" and self.difference < -tolerance

    @property
    def sentence(self) -> str:
        """The comparison in words: the difference and its interval, then the test."""
        names = f"{self.configuration} vs {self.reference}"
        if self.n == 0:
            return f"{names}: no common frame"
        corrected = f" ({format_p(self.p_holm)} after Holm)" if self.family > 1 else ""
        verdict = f"significantly {self.verdict}" if self.is_significant else self.verdict
        return (
            f"{names}: {100 * self.difference:+.1f} points{self._interval_in_words}, {self._basis}, "
            f"{format_p(self.p)}{corrected}: {verdict}{self._detectable_in_words}"
        )

    @property
    def _interval_in_words(self) -> str:
        if math.isnan(self.interval.low):
            return " (no interval from so few looks)"
        return f" (95 % {100 * self.interval.low:+.1f} to {100 * self.interval.high:+.1f})"

    @property
    def _basis(self) -> str:
        clips, looks = _counted(self.clips, "clip"), _counted(self.looks, "joined look")
        if self.unit == "clip":
            return f"{clips}, {looks}"
        return f"{looks} of {clips}, {'this clip' if self.clips == 1 else 'these clips'} only"

    @property
    def _detectable_in_words(self) -> str:
        if self.is_significant or math.isnan(self.detectable):
            return ""
        return f"; a true difference of {100 * self.detectable:.1f} points would be seen with 80 % power"


def compare(frames: Mapping[str, Iterable[ScoredFrames]]) -> tuple[Comparison, ...]:
    """Compare every two of several configurations (of one run, or of several), the later with the earlier.

    ``frames`` are keyed by the names used in the result. Frames are paired by clip, subject and frame; frames that
    either did not score are left out. Without a common frame, n = 0 and p = 1.
    """
    known = {name: list(each) for name, each in frames.items()}
    return with_holm([_comparison(one, two, pair(known[one], known[two])) for one, two in combinations(known, 2)])


def with_holm(comparisons: Sequence[Comparison]) -> tuple[Comparison, ...]:
    """Return the comparisons, corrected together for their number."""
    corrected = holm([each.p for each in comparisons])
    return tuple(
        replace(each, p_holm=p, family=len(comparisons)) for each, p in zip(comparisons, corrected, strict=True)
    )


def _comparison(reference: str, configuration: str, pairs: Pairs) -> Comparison:
    units = pairs.units
    p = 1.0 if units is None else sign_flip_p(units.merged().values)
    return Comparison(
        reference=reference,
        configuration=configuration,
        n=pairs.n,
        looks=0 if units is None else len(units.frames),
        clips=0 if units is None else units.n_clips,
        better=pairs.better,
        worse=pairs.worse,
        difference=math.nan if units is None else units.rate,
        interval=UNKNOWN if units is None else difference_interval(units),
        unit="clip" if units is not None and units.speaks_of_clips else "look",
        p=p,
        p_holm=p,
        family=1,
        detectable=math.nan if units is None else detectable_difference(units),
    )


def _counted(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def format_p(p: float) -> str:
    """A p value for readers: two significant digits, or ``p < 0.001``."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def detectable_difference(units: Units, power: float = POWER) -> float:
    """The true difference that a comparison on these units finds significant with this probability; NaN if unknown."""
    if len(units.frames) < 2:
        return math.nan
    error, df = standard_error(units), degrees_of_freedom(units)
    return math.nan if error == 0 else error * _needed_errors(df, power)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """The variation of a difference of two configurations: variances of a clip's difference, as shares squared.

    ``between`` is the variance between clips, ``within`` the one that remains with a clip's ``looks`` looks;
    ``between`` is NaN with only one clip.
    """

    between: float
    within: float
    clips: int
    looks: float

    @classmethod
    def of(cls, units: Units) -> Spread:
        """Estimate the spread from these units. Clips are weighted by their frames, as in the pooled rate."""
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
    """The fewest clips on which a true difference (a share) is found significant with this probability.

    Parameters
    ----------
    looks
        Looks in each clip; as many as now if None.

    Returns
    -------
    int or None
        At least :data:`harness.score.intervals.LEAST_CLIPS`; None if more than 100,000 would be needed, or the spread
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
    """The required difference in standard errors: the non-centrality at which Student's test has this power."""
    from scipy.special import nctdtr, stdtrit

    critical = float(stdtrit(df, (1 + LEVEL) / 2))
    low, high = 0.0, 4 * critical + 4
    for _ in range(60):
        middle = (low + high) / 2
        seen = 1 - float(nctdtr(df, middle, critical)) + float(nctdtr(df, middle, -critical))
        low, high = (middle, high) if not seen >= power else (low, middle)
    return high
