"""Confidence intervals of pooled rates and of differences between them, from clips and looks; pairs of scored frames.

Frames are not independent: those of a look are right or wrong together, and so are, less strongly, the looks of a clip.
From :data:`LEAST_CLIPS` clips on, clips are resampled with replacement, then looks within each drawn clip: the interval
is valid for clips like these. Below that, the clips are fixed and stretches of them are resampled within each: the
interval is valid for these clips only. A stretch is as many consecutive looks of a subject as hold a share of
1 / :data:`MOST_STRETCHES` of all frames, or all looks of the subject. Few long ones are worth nearly as much as many
short ones, and errors seldom outlast them (Ibragimov and Müller, "t-statistic based correlation and heterogeneity
robust inference", 2010).

The interval of a difference is that of the sign-flip test (:mod:`harness.score.statistics`). Those of a rate are
percentile intervals whose percentiles are expanded for small samples (Hesterberg, "What Teachers Should Know about the
Bootstrap", The American Statistician 69, 2015, section 4.3): as far out as Student's t with the resample's degrees of
freedom, and by the factor by which a resample's spread is too small. In ``reports/coverage.md`` the plain percentiles
of resampled clips cover 80 to 90 % at 4 to 8 clips, these 90 % and more; a bootstrap-t covers as well, but with
intervals two to five times as wide at 4 to 6 clips.

If resampling is not possible (too few units for :func:`can_resample`, or all of them equal), the interval of a rate has
a closed form: that of Clopper and Pearson (1934) with the effective sample size of Korn and Graubard (Survey
Methodology 24, 1998).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from harness.score.looks import joined
from harness.score.statistics import LEVEL, NO_INTERVAL, REPLICATES, SIGNIFICANCE, Interval, sign_flip_interval
from vfoa.errors import VfoaError
from vfoa.types import Codes, Flags, Float

LEAST_CLIPS = 6
"""Fewest clips for intervals and tests about other clips: with fewer, a sign flip cannot reach p < .05."""
LEAST_UNITS = 6
"""Fewest units that are resampled."""
MOST_STRETCHES = 16
"""Most stretches that fewer clips are divided into, unless they have more subjects."""

_Z = NormalDist().inv_cdf((1 + LEVEL) / 2)
_ROWS_AT_ONCE = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class Units:
    """Looks with their sums: ``clips`` (U,) the code of the clip of each, ``frames`` (U,) its number of frames.

    ``values`` (U,) are sums over the frames: right frames for a rate, better minus worse frames for a difference.
    ``tracks`` (U,) are codes of clip and subject, whose looks are consecutive; None: looks are never joined.
    """

    clips: Codes
    frames: Float
    values: Float
    tracks: Codes | None = None

    @property
    def rate(self) -> float:
        """The pooled rate: the sum of the values over the frames."""
        return float(self.values.sum() / self.frames.sum())

    @property
    def n_clips(self) -> int:
        """Number of clips."""
        return len(np.unique(self.clips))

    @property
    def speaks_of_clips(self) -> bool:
        """Whether there are enough clips for statements about other clips."""
        return self.n_clips >= LEAST_CLIPS

    def stretched(self) -> Units:
        """The units that are resampled last: stretches of few clips, looks of many."""
        if self.tracks is None or self.speaks_of_clips:
            return self
        least = float(self.frames.sum()) / MOST_STRETCHES
        parts = [joined(self.frames[self.tracks == track], least) for track in dict.fromkeys(self.tracks.tolist())]
        before = np.cumsum([0, *(part[-1] + 1 for part in parts)])
        return self._summed(np.concatenate([part + first for part, first in zip(parts, before, strict=False)]))

    def merged(self) -> Units:
        """The units that are exchangeable in a test: clips if there are enough, stretches otherwise."""
        return self._summed(np.unique(self.clips, return_inverse=True)[1]) if self.speaks_of_clips else self.stretched()

    def _summed(self, codes: Codes) -> Units:
        return Units(
            clips=self.clips[np.unique(codes, return_index=True)[1]],
            frames=np.bincount(codes, self.frames).astype(np.float64),
            values=np.bincount(codes, self.values).astype(np.float64),
        )


def rate_interval(units: Units) -> Interval:
    """The 95 % interval of a pooled rate; unknown with fewer than two units."""
    units = units.stretched()
    if len(units.frames) < 2:
        return NO_INTERVAL
    share = units.rate
    if (ends := _resampled(units)) is None or share in (0.0, 1.0):
        low, high = _clopper_pearson(share, _effective(units))
        return _interval(units, low, high)
    low, high = ends
    return _interval(units, max(low, 0.0), min(high, 1.0))


def balanced_values(correct: Flags, nowhere: Flags) -> Float:
    """Return what each frame (n,) adds to the balanced FRR: values whose mean it is, and whose spread is its spread.

    The balanced FRR b is the mean of two ratios, the rates r of the frames with a target and of those with nowhere
    (``nowhere``). Their errors are, to the first order, sums over frames (Taylor linearization; Särndal, Swensson and
    Wretman, Model Assisted Survey Sampling, 1992, section 5.7): a right one adds b + (1 - r) n / 2m, a wrong one
    b - r n / 2m, where m of the n frames are of its kind. With frames of one kind these are 1 and 0.
    """
    kinds = [kind for kind in (~nowhere, nowhere) if kind.any()]
    rates = [correct[kind].mean() for kind in kinds]
    values = np.full(len(correct), np.mean(rates))
    for kind, rate in zip(kinds, rates, strict=True):
        values[kind] += (correct[kind] - rate) * len(correct) / (len(kinds) * np.count_nonzero(kind))
    return values


def difference_interval(units: Units, alpha: float = SIGNIFICANCE) -> Interval:
    """The interval of a difference of two rates on the same frames: what the sign-flip test at ``alpha`` leaves.

    Unknown if the test can reject nothing with so few units, or if all units differ alike, so that their spread is not
    known. If no frame differs, it is the exact bound: the largest difference that this many units can miss completely.
    If a few units differ, all in one direction, it also holds what they can miss in the other one.
    """
    merged = units.merged()
    if len(merged.frames) < 2:
        return NO_INTERVAL
    missed = _clopper_pearson(0.0, len(merged.frames), alpha)[1]
    if not units.values.any():
        return _interval(units, -missed, missed)
    if np.ptp(merged.values / merged.frames) == 0:
        return NO_INTERVAL
    ends = sign_flip_interval(merged.values, merged.frames, alpha)
    return NO_INTERVAL if ends is None else _interval(units, *_with_unseen(merged, missed, *ends))


def _with_unseen(merged: Units, missed: float, low: float, high: float) -> tuple[float, float]:
    """The ends of an interval that holds 0, which then also holds what the units miss in a direction that none shows.

    Differences that are 0 in most units are not symmetric about their mean: with one worse unit and none that is
    better, the test alone would rule out any gain. Up to a share ``missed`` of the units may be better, each by as much
    as the one that differs most; the distances of both directions are added in squares (Zou and Donner, Statistics in
    Medicine 27, 2008).
    """
    if not low <= 0 <= high or merged.values.min() < 0 < merged.values.max():
        return low, high
    seen, unseen = abs(merged.rate), missed * float(np.abs(merged.values / merged.frames).max())
    beyond = math.hypot(seen, unseen) - seen
    return min(low, -beyond), max(high, beyond)


def standard_error(units: Units) -> float:
    """The linearised standard error of a pooled rate, with clusters: clips, or looks within each clip.

    It is the cluster-robust standard error of a regression on a constant, with its small-sample factor.
    """
    merged = units.merged()
    residuals = merged.values - merged.rate * merged.frames
    total = 0.0
    for stratum in _strata(merged.clips):
        inside = residuals[stratum]
        total += len(inside) / (len(inside) - 1) * float(((inside - inside.mean()) ** 2).sum())
    return math.sqrt(total) / float(merged.frames.sum())


def degrees_of_freedom(units: Units) -> int:
    """Degrees of freedom of :func:`standard_error`: units less strata."""
    merged = units.merged()
    return len(merged.frames) - len(_strata(merged.clips))


def _strata(clips: Codes) -> list[Codes]:
    """The indices of the units, from their clips (U,), that are resampled among themselves.

    Clips that stand for others, and looks if a clip has only one, form one stratum; otherwise each clip is one.
    """
    names, counts = np.unique(clips, return_counts=True)
    return [np.arange(len(clips))] if counts.min() < 2 else [np.flatnonzero(clips == name) for name in names]


def _interval(units: Units, low: float, high: float) -> Interval:
    return Interval(low=low, high=high, unit="clip" if units.speaks_of_clips else "look")


def _resampled(units: Units) -> tuple[float, float] | None:
    """The expanded percentiles; None if the units are too few or all alike."""
    merged = units.merged()
    n, df = len(merged.frames), degrees_of_freedom(units)
    if not can_resample(n, df) or np.ptp(merged.values / merged.frames) == 0:
        return None
    return expanded_percentiles(resampled_rates(units), n, df)


def can_resample(n: int, df: int) -> bool:
    """Whether ``n`` units with ``df`` degrees of freedom are enough to resample.

    Two units in each of several clips are not: the expanded percentiles lie beyond all resamples, whose ends hold the
    true rate far less often than in 95 of 100 experiments.
    """
    return n >= LEAST_UNITS and df > 0 and _expanded_tail(n, df) >= 1 / REPLICATES


def expanded_percentiles(resampled: Float, n: int, df: int) -> tuple[float, float]:
    """The ends of the interval, from a statistic of each resample of ``n`` units with ``df`` degrees of freedom."""
    tail = _expanded_tail(n, df)
    low, high = np.quantile(resampled, [tail, 1 - tail])
    return float(low), float(high)


def _expanded_tail(n: int, df: int) -> float:
    """The share of the resamples that lies beyond each end."""
    from scipy.special import ndtr, stdtrit

    return float(ndtr(math.sqrt(n / df) * stdtrit(df, (1 - LEVEL) / 2)))


def resampled_rates(units: Units) -> Float:
    """The pooled rate of every resample: (replicates,). Equal layouts of clips and looks get equal resamples."""
    order = np.argsort(units.clips, kind="stable")
    sums = np.stack([units.values[order], units.frames[order]], axis=1)
    counts = draw(units.clips[order], by_clip=units.speaks_of_clips)
    totals = np.concatenate([counts[at : at + _ROWS_AT_ONCE] @ sums for at in range(0, REPLICATES, _ROWS_AT_ONCE)])
    return totals[:, 0] / totals[:, 1]


def draw(groups: Codes, *, by_clip: bool) -> NDArray[np.uint16]:
    """The number of times that each unit (U,), sorted by group, is drawn in each resample: (replicates, U).

    By clip, groups are drawn with replacement, then units within each drawn one; else units are drawn within each
    group.
    """
    return _draws(np.ascontiguousarray(groups, dtype=np.intp).tobytes(), by_clip)


@lru_cache(maxsize=8)
def _draws(layout: bytes, by_clip: bool) -> NDArray[np.uint16]:
    # cached, because every configuration asks for the same
    clips = np.frombuffer(layout, dtype=np.intp)
    rng = np.random.default_rng(list(hashlib.sha256(layout).digest()))
    counts = np.zeros((REPLICATES, len(clips)), dtype=np.uint16)
    if not by_clip:
        for stratum in _strata(clips):
            counts[:, stratum] = rng.multinomial(len(stratum), np.full(len(stratum), 1 / len(stratum)), REPLICATES)
        return counts
    names = np.unique(clips)
    times = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), REPLICATES)
    for place, name in enumerate(names):
        (inside,) = np.nonzero(clips == name)
        counts[:, inside] = rng.multinomial(times[:, place] * len(inside), np.full(len(inside), 1 / len(inside)))
    return counts


def _effective(units: Units) -> float:
    """Number of independent trials with the same uncertainty of the rate as the units (Korn and Graubard 1998)."""
    from scipy.special import stdtrit

    n, share, error, df = len(units.merged().frames), units.rate, standard_error(units), degrees_of_freedom(units)
    if error == 0 or share in (0.0, 1.0):
        return n
    widened = float(_Z / stdtrit(df, (1 + LEVEL) / 2)) ** 2
    return min(share * (1 - share) / error**2 * widened, float(units.frames.sum()))


def _clopper_pearson(share: float, n: float, alpha: float = SIGNIFICANCE) -> tuple[float, float]:
    """The exact interval of a share of ``n`` trials, where ``n`` need not be whole."""
    from scipy.special import betaincinv

    right, tail = share * n, alpha / 2
    low = float(betaincinv(right, n - right + 1, tail)) if right > 0 else 0.0
    high = float(betaincinv(right + 1, n - right, 1 - tail)) if right < n else 1.0
    return low, high


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ScoredFrames:
    """A subject's scored frames in one clip; arrays are (n,).

    ``frames`` are their numbers, ascending, ``looks`` the number of the look of each, ``truth`` its true target.
    ``correct`` counts the seeds, of ``seeds``, under which each is right; with one seed it is 0 or 1.
    """

    clip: str
    subject: str
    frames: Codes
    looks: Codes
    truth: NDArray[np.object_]
    correct: Codes
    seeds: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairs:
    """Two configurations on their common frames.

    ``better`` frames are right only in the second, ``worse`` ones only in the first. ``units`` are the looks, with
    better minus worse frames; None without a common frame.
    """

    n: int
    better: int
    worse: int
    units: Units | None
    seeds: int = 1

    @property
    def is_identical(self) -> bool:
        """Whether both are right on the same frames; not known of several seeds, which are only counted."""
        return self.n > 0 and self.better == self.worse == 0 and self.seeds == 1


def pair(first: Iterable[ScoredFrames], second: Iterable[ScoredFrames]) -> Pairs:
    """Pair frames by clip, subject and frame. Looks are those of the first, reduced to the common frames.

    They are in the order of the names, so that nothing depends on the order in which clips are given.

    Raises
    ------
    VfoaError
        If a frame has another true target in the second, or one was run under more seeds.
    """
    first, second = sorted(first, key=lambda scored: (scored.clip, scored.subject)), list(second)
    repeats, *more = dict.fromkeys(scored.seeds for scored in (*first, *second)) or (1,)
    if more:
        raise VfoaError(f"found runs under {repeats} and under {more[0]} seeds; expected the same number in both")
    others = {(scored.clip, scored.subject): scored for scored in second}
    clips: dict[str, int] = {}
    codes: list[int] = []
    tracks: list[int] = []
    frames, values = [np.zeros(0)], [np.zeros(0)]
    better = worse = 0
    for scored_frames in first:
        if (other := others.get((scored_frames.clip, scored_frames.subject))) is None:
            continue
        ours, theirs = _common(scored_frames, other)
        if len(ours) == 0:
            continue
        gains = other.correct[theirs] - scored_frames.correct[ours]
        begins = np.flatnonzero(np.diff(scored_frames.looks[ours], prepend=np.nan) != 0)
        codes += [clips.setdefault(scored_frames.clip, len(clips))] * len(begins)
        tracks += [len(frames)] * len(begins)
        frames.append(np.diff(begins, append=len(ours)) * float(repeats))
        values.append(np.add.reduceat(gains, begins).astype(np.float64))
        better, worse = better + int((gains > 0).sum()), worse + int((gains < 0).sum())
    if not codes:
        return Pairs(n=0, better=0, worse=0, units=None)
    units = Units(
        clips=np.array(codes, dtype=np.intp),
        frames=np.concatenate(frames),
        values=np.concatenate(values),
        tracks=np.array(tracks, dtype=np.intp),
    )
    return Pairs(n=int(units.frames.sum()) // repeats, better=better, worse=worse, units=units, seeds=repeats)


def _common(first: ScoredFrames, second: ScoredFrames) -> tuple[Codes, Codes]:
    """The indices of the common frames in both. Raises as :func:`pair` does."""
    _, ours, theirs = np.intersect1d(first.frames, second.frames, assume_unique=True, return_indices=True)
    for place in np.flatnonzero(first.truth[ours] != second.truth[theirs])[:1]:
        raise VfoaError(
            f"{first.clip}: frame {first.frames[ours[place]]}: {first.subject} looks at {first.truth[ours[place]]!r} "
            f"in one and at {second.truth[theirs[place]]!r} in the other; expected the same labels"
        )
    return ours, theirs
