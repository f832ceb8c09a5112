"""Behaviour: how long, how often and in which order people look at what, and together with whom.

By the labels and by each configuration, side by side (:mod:`harness.score.sequences`). A look is a longest run of one
target. A transition leads from a look to the next, at another target. Mutual gaze: two subjects look at each other.
Joint attention: two subjects look at one target that is neither of the two. A look at such a target is followed if the
partner, who looked elsewhere when it began, begins to look there within 2 s; the latency is from the one beginning to
the other. Looks that the ends of a clip cut are as long as they are seen.

A value is a pooled ratio: a sum of values over a sum of sizes, such as frames on a target over frames, seconds over
looks, transitions over minutes. Its units are those of :mod:`harness.score.intervals`: clips from ``LEAST_CLIPS`` on,
below that looks within each clip. The intervals are closed, because a run has thousands of such ratios: that of Clopper
and Pearson with the effective sample size of Korn and Graubard for a share, Student's t for a mean.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np

from harness.labels.labels import NOWHERE
from harness.score.behaviour_evidence import Evidence, Key, by_clips, clip_evidence
from harness.score.intervals import LEAST_CLIPS
from harness.score.outcomes import Outcomes
from harness.score.sequences import read_sequences
from harness.score.statistics import LEVEL, Codes, Interval
from vfoa.types import Float

_TAIL = (1 - LEVEL) / 2
_Z = NormalDist().inv_cdf(1 - _TAIL)

MEASURES: Mapping[str, str] = {
    "time_share": "share of the known time spent on the target",
    "looks": "number of looks at the target",
    "looks_per_min": "looks at the target per minute of known time",
    "look_length_s": "mean length of a look at the target; without a target, of any look",
    "transitions": "number of transitions from one target to another",
    "transitions_per_min": "transitions per minute of known time",
    "mutual_gaze_share": "share of the time known of both in which they look at each other",
    "mutual_gazes": "number of mutual gazes",
    "mutual_gaze_length_s": "mean length of a mutual gaze",
    "joint_attention_share": "share of the time known of both in which they look at one target that is neither of them",
    "joint_attentions": "number of joint attentions",
    "joint_attention_length_s": "mean length of a joint attention",
    "followed_share": "share of the partner's looks that the subject follows, of those it can follow",
    "following_latency_s": "mean time from the beginning of a partner's look to that of the look that follows it",
}
"""Each measure with its meaning, in the order of the tables."""

_Kind = Literal["share", "mean", "rate", "count"]
_KINDS: Mapping[str, _Kind] = {
    "time_share": "share",
    "looks": "count",
    "looks_per_min": "rate",
    "look_length_s": "mean",
    "transitions": "count",
    "transitions_per_min": "rate",
    "mutual_gaze_share": "share",
    "mutual_gazes": "count",
    "mutual_gaze_length_s": "mean",
    "joint_attention_share": "share",
    "joint_attentions": "count",
    "joint_attention_length_s": "mean",
    "followed_share": "share",
    "following_latency_s": "mean",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class BehaviourRow:
    """One measure of a subject, or of a subject and a partner, from one source.

    ``clip`` is None over all clips: subject and partner are None there, too. ``before`` is the target that a transition
    leaves. ``n`` counts the frames, looks, transitions, or joint states behind the value. ``interval`` is None for
    counts.
    """

    clip: str | None
    subject: str | None
    partner: str | None
    source: str
    measure: str
    before: str | None
    target: str | None
    value: float
    n: int
    interval: Interval | None


def measure_behaviour(outcomes: Iterable[Outcomes], *, by_clip: bool = True) -> list[BehaviourRow]:
    """Compute every measure of every subject and pair, and over all clips if there are several.

    A measure that no source sees in a clip, such as a transition, has no row there; if one source sees it, each source
    has a row. Rows are in order of clip, subject, partner, measure, target and source.
    """
    codes: dict[str, int] = {NOWHERE: 0}
    sequences = read_sequences(outcomes, codes)
    names = list(codes)
    evidence = [each for found in by_clips(sequences) for each in clip_evidence(found, names)]
    rows = _rows(evidence, lambda each: (each.clip, each.subject, each.partner)) if by_clip else []
    if len({each.clip for each in sequences}) > 1:
        rows += _rows(evidence, lambda each: (None, None, None))
    return rows


_Who = tuple[str | None, str | None, str | None]


def _rows(evidence: Iterable[Evidence], who: Callable[[Evidence], _Who]) -> list[BehaviourRow]:
    """The rows of all evidence for which ``who`` gives the same."""
    groups: dict[tuple[_Who, str], dict[str, list[Evidence]]] = {}
    for each in evidence:
        groups.setdefault((who(each), each.measure), {}).setdefault(each.source, []).append(each)
    return [
        row
        for ((clip, subject, partner), measure), sources in groups.items()
        for row in _group_rows((clip, subject, partner), measure, sources)
    ]


def _group_rows(who: _Who, measure: str, sources: Mapping[str, list[Evidence]]) -> list[BehaviourRow]:
    keys = list(dict.fromkeys(key for found in sources.values() for each in found for key in each.keys))
    by_source = {source: _pooled(found, keys, measure) for source, found in sources.items()}
    return [
        BehaviourRow(
            clip=who[0],
            subject=who[1],
            partner=who[2],
            source=source,
            measure=measure,
            before=before,
            target=target,
            value=values[place],
            n=counts[place],
            interval=intervals[place] if intervals else None,
        )
        for place, (before, target) in enumerate(keys)
        for source, (values, counts, intervals) in by_source.items()
    ]


def _pooled(
    found: Sequence[Evidence], keys: Sequence[Key], measure: str
) -> tuple[list[float], list[int], list[Interval]]:
    """The value of each key, the number of items behind it, and its interval (none for counts)."""
    clips: dict[str, int] = {}
    column = {key: place for place, key in enumerate(keys)}
    sizes, values = (np.zeros((sum(len(each.sizes) for each in found), len(keys))) for _ in range(2))
    codes = np.zeros(len(sizes), dtype=np.intp)
    begin = 0
    for each in found:
        rows, columns = slice(begin, begin + len(each.sizes)), [column[key] for key in each.keys]
        sizes[rows, columns], values[rows, columns] = each.sizes, each.values
        codes[rows] = clips.setdefault(each.clip, len(clips))
        begin = rows.stop
    kind = _KINDS[measure]
    total = values.sum(axis=0)
    counts = [round(each) for each in (total if kind in ("rate", "count") else sizes.sum(axis=0)).tolist()]
    if kind == "count":
        return total.tolist(), counts, []
    ratios = pooled_ratios(codes, sizes, values, shares=kind == "share")
    ends = zip(ratios.low.tolist(), ratios.high.tolist(), strict=True)
    return ratios.value.tolist(), counts, [Interval(low=low, high=high, unit=ratios.unit) for low, high in ends]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratios:
    """K ratios ``value`` (K,) with the ends of their intervals, NaN if not known, and the unit of these."""

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
        Whether each value is at most its size, so that the ratios lie in [0, 1]. Otherwise they are at least 0.
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

    It is computed within strata. If a stratum has only one unit, and so no spread, all units form one stratum.
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
