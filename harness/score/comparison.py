"""Comparison of configurations on the frames that both were scored on, and the clips that it takes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal

import numpy as np

from harness.score.intervals import LEAST_CLIPS, Pairs, ScoredFrames, Units, difference_interval, pair, standard_error
from harness.score.statistics import (
    NO_INTERVAL,
    SIGNIFICANCE,
    Interval,
    holm,
    inferiority_p,
    needed_shift,
    power,
    sign_flip_p,
    smallest_p,
)
from vfoa.errors import counted, located
from vfoa.types import Float

POWER = 0.8
MOST_CLIPS = 100_000
"""No plan is for more clips."""
_POSSIBLE = 400
"""Number of spreads, equally probable, that stand for what a pilot leaves possible."""
SPREAD_LEVEL = 0.8
"""Level of the interval of the spread between clips, from which the range of clips follows."""
_LEAST_DEVIATION = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A configuration compared with an earlier one (``reference``) on ``n`` common frames.

    ``better`` frames are right only in the configuration, ``worse`` frames only in the reference. ``difference`` is
    that of the rates. ``p`` is of the exact sign-flip test over ``unit``: clips if there are enough, else looks, in
    which case it is valid for these clips only. ``p_holm`` is corrected for the comparisons made together
    (``family``). ``interval`` are the differences that the corrected test does not reject. ``detectable`` is the true
    difference that such a comparison finds significant, after the correction, with 80 % power; infinite if none is
    large enough, NaN if unknown. ``looks`` are joined ones. ``is_identical``: both are right on the same frames, and
    there is no interval.
    """

    reference: str
    configuration: str
    n: int
    looks: int
    clips: int
    better: int
    worse: int
    difference: float
    interval: Interval = NO_INTERVAL
    unit: Literal["clip", "look"]
    p: float
    p_holm: float = 1.0
    family: int = 1
    detectable: float = math.nan
    is_identical: bool = False
    units: Units | None = field(default=None, compare=False, repr=False)

    @property
    def names(self) -> tuple[str, str]:
        """The two configurations, the reference first."""
        return self.reference, self.configuration

    @property
    def is_significant(self) -> bool:
        """Whether the corrected p is below 5 %."""
        return self.p_holm < SIGNIFICANCE

    @property
    def verdict(self) -> Literal["better", "worse", "cannot be told apart"]:
        """The result in words."""
        if not self.is_significant:
            return "cannot be told apart"
        return "worse" if self.difference < 0 else "better"

    @property
    def smallest_p(self) -> float:
        """The smallest p that the test can give on this number of units, before the correction."""
        return 1.0 if self.units is None else smallest_p(len(self.units.merged().frames))

    @property
    def can_be_significant(self) -> bool:
        """Whether any result on this number of units could be significant by itself."""
        return self.smallest_p * self.family < SIGNIFICANCE

    @property
    def counted_units(self) -> str:
        """The number of units of the test, in words."""
        return counted(self.clips, "clip") if self.unit == "clip" else counted(self.looks, "joined look")

    def inferiority_p(self, margin: float) -> float:
        """One-sided p of the hypothesis that the configuration is worse by the margin (a share) or more."""
        if self.units is None:
            return 1.0
        merged = self.units.merged()
        return inferiority_p(merged.values, merged.frames, margin)

    @property
    def sentence(self) -> str:
        """The comparison in words: the difference and its interval, then the test."""
        names = f"{self.configuration} vs {self.reference}"
        if self.n == 0:
            return f"{names}: {NO_COMMON_FRAME}"
        if self.is_identical:
            return f"{names}: {identical_on(self.n)}"
        low, high = 100 * self.interval.low, 100 * self.interval.high
        ends = "no interval" if math.isnan(low) else f"95 % {low:+.1f} to {high:+.1f}"
        basis = self.counted_units
        if self.unit == "look":
            only = "this clip" if self.clips == 1 else "these clips"
            basis = f"{basis} of {counted(self.clips, 'clip')}, {only} only"
        p = format_p(self.p)
        if self.family > 1:
            p = f"{format_p(self.p_holm)}, corrected for {self.family} comparisons"
        verdict = f"significantly {self.verdict}" if self.is_significant else self.verdict
        return f"{names}: {100 * self.difference:+.1f} points ({ends}), {basis}, {p}: {verdict}{self._seen}"

    @property
    def _seen(self) -> str:
        """The difference that would be seen, in words."""
        if self.is_significant or math.isnan(self.detectable):
            return ""
        if math.isinf(self.detectable):
            return "; with so few units no difference can be significant"
        return f"; a true difference of {100 * self.detectable:.1f} points would be seen with 80 % power"


def compare(frames: Mapping[str, Iterable[ScoredFrames]]) -> tuple[Comparison, ...]:
    """Compare every two of several configurations (of one run, or of several), the later with the earlier.

    ``frames`` are keyed by the names used in the result. Frames are paired by clip, subject and frame; frames that
    either did not score are left out. Without a common frame, n = 0 and p = 1.
    """
    known = {name: list(scored) for name, scored in frames.items()}
    return compare_pairs(known, combinations(known, 2))


def compare_pairs(
    frames: Mapping[str, Iterable[ScoredFrames]], pairs: Iterable[tuple[str, str]]
) -> tuple[Comparison, ...]:
    """Compare some pairs of configurations, the reference first, as :func:`compare` does."""

    def paired(reference: str, configuration: str) -> Pairs:
        with located(f"{reference} and {configuration}"):
            return pair(frames[reference], frames[configuration])

    return with_holm([_comparison(*names, paired(*names)) for names in pairs])


def with_holm(comparisons: Sequence[Comparison]) -> tuple[Comparison, ...]:
    """Return the comparisons, corrected together for their number by Holm's method, with the intervals that belong."""
    ordered = sorted(comparison.p for comparison in comparisons)
    corrected = holm([comparison.p for comparison in comparisons])
    family, rejected = len(comparisons), sum(p < SIGNIFICANCE for p in corrected)

    def interval(comparison: Comparison) -> Interval:
        """The interval at the level at which Holm tests the comparison; equal p have one level, whatever their order.

        The smallest p is tested at 5 % / family, the next at 5 % / (family - 1) ..., up to the first that is not below.
        """
        if comparison.units is None or comparison.is_identical:
            return NO_INTERVAL
        rank = ordered.index(comparison.p)
        return difference_interval(comparison.units, SIGNIFICANCE / (family - min(rank, rejected)))

    return tuple(
        replace(
            comparison,
            p_holm=p,
            family=family,
            interval=interval(comparison),
            detectable=math.nan if comparison.units is None else detectable_difference(comparison.units, family),
        )
        for comparison, p in zip(comparisons, corrected, strict=True)
    )


def _comparison(reference: str, configuration: str, pairs: Pairs) -> Comparison:
    units = pairs.units
    return Comparison(
        reference=reference,
        configuration=configuration,
        n=pairs.n,
        looks=0 if units is None else len(units.stretched().frames),
        clips=0 if units is None else units.n_clips,
        better=pairs.better,
        worse=pairs.worse,
        difference=math.nan if units is None else units.rate,
        unit="clip" if units is not None and units.speaks_of_clips else "look",
        p=1.0 if units is None else sign_flip_p(units.merged().values),
        is_identical=pairs.is_identical,
        units=units,
    )


NO_COMMON_FRAME = "no common frame"
"""What is said of configurations that were scored on different frames, as those of runs of different clips."""


def identical_on(frames: int) -> str:
    """The sentence about configurations that are right on the same frames, and so have no spread."""
    return f"identical on {counted(frames, 'frame')}"


def format_p(p: float) -> str:
    """A p value for readers: two significant digits, or ``p < 0.001``."""
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def detectable_difference(units: Units, family: int = 1) -> float:
    """The true difference that the test on these units, corrected for ``family`` comparisons, finds with 80 % power.

    Infinite if it can find none; NaN if the units do not vary, so that their spread is unknown. Their spread is taken
    as the true one, and normal.
    """
    merged = units.merged()
    n = len(merged.frames)
    shift = needed_shift(n, SIGNIFICANCE / family, POWER)
    if math.isinf(shift):
        return shift
    error = standard_error(units)
    return math.nan if error == 0 else error * math.sqrt(n) * shift


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Clips:
    """How many clips a comparison needs to find a difference with a probability of 80 %.

    ``needed`` is for the mean of that probability over all spreads that the pilot leaves possible, ``fewest`` and
    ``most`` for the spreads at the ends of the pilot's 80 % interval; ``most`` is None if more than 100,000. ``power``
    is the mean with ``needed`` clips: above 80 % where a test takes more clips than the difference would.
    """

    needed: int
    power: float
    fewest: int
    most: int | None


def clips_needed(spread: Spread, difference: float, looks: float | None = None, family: int = 1) -> Clips | None:
    """The fewest clips on which a true difference (a share) is found significant with a probability of 80 %.

    The spread of few clips is uncertain itself. So the power is averaged over the spreads that it leaves possible
    (assurance: O'Hagan, Stevens and Campbell, "Assurance in clinical trial design", 2005), with clips' differences
    normal.

    Parameters
    ----------
    looks
        Looks in each clip; as many as now if None.
    family
        Number of comparisons that the test is corrected for.

    Returns
    -------
    Clips or None
        At least :data:`harness.score.intervals.LEAST_CLIPS`; None if more than 100,000 would be needed, or the spread
        between clips is not known.
    """
    from scipy.special import chdtri

    variance = spread.variance(looks or spread.looks)
    if math.isnan(variance):
        return None
    df, level = spread.clips - 1, SIGNIFICANCE / family
    # the true variance over the one seen: degrees of freedom over a chi-square
    chances = (np.arange(_POSSIBLE) + 0.5) / _POSSIBLE
    possible = np.sqrt(variance * df / chdtri(df, chances))
    narrow, wide = (float(np.quantile(possible, (1 + sign * SPREAD_LEVEL) / 2)) for sign in (-1, 1))

    def powers(clips: int, deviation: float | Float) -> Float:
        return power(clips, level, difference / np.maximum(deviation, _LEAST_DEVIATION))

    def fewest(deviation: float | Float) -> int | None:
        return _fewest(lambda clips: float(powers(clips, deviation).mean()) >= POWER)

    needed = fewest(possible)
    if needed is None:
        return None
    return Clips(
        needed=needed,
        power=float(powers(needed, possible).mean()),
        fewest=fewest(narrow) or needed,
        most=fewest(wide),
    )


def _fewest(enough: Callable[[int], bool]) -> int | None:
    """The smallest number of clips that is enough; larger ones are, too."""
    low, high = LEAST_CLIPS - 1, LEAST_CLIPS
    while not enough(high):
        low, high = high, 2 * high
        if high > MOST_CLIPS:
            return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high
