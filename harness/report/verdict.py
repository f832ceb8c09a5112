"""What a run found, in one sentence: which configurations are better, by how much, and which cannot be told apart."""

from __future__ import annotations

import math
from collections.abc import Sequence

from harness.score.comparison import Comparison, compare
from harness.score.factors import compare_factors
from harness.score.oracle_ablation import without_oracles
from harness.score.score import ScoreRow, Scores

_MOST_NAMES = 4


def verdict_sentence(scores: Scores) -> str:
    """The answer of a run, from the comparisons of its configurations; the oracle ablation takes no part.

    A grid is compared by its factors, over all values of the others. One configuration is compared with its best
    baseline.
    """
    names = without_oracles(scores.scored_configurations)
    rows = {row.configuration: row for row in overall(scores) if row.configuration in names}
    if not rows:
        return "Nothing is scored: no frame has a label."
    if len(rows) == 1:
        return _against_baseline(next(iter(rows.values())))
    frames = {name: scores.frames_of(name) for name in rows}
    groups = compare_factors(frames) or [compare(frames)]
    said = [_of_group(group) for group in groups]
    told, untold = [part for parts, _ in said for part in parts], [part for _, parts in said for part in parts]
    sentence = "; ".join([*told, *untold])
    return f"{sentence}."


def overall(scores: Scores) -> list[ScoreRow]:
    """The row of each configuration over all clips."""
    rows = scores.by_clip()
    return [row for row in rows if row.clip is None] or rows


def _against_baseline(row: ScoreRow) -> str:
    best = row.best_baseline
    words = {
        "yes": "beats the best baseline",
        "not shown": "is not shown to beat the best baseline",
        "no": "does not beat the best baseline",
    }
    rate = f"{row.configuration} is right in {100 * row.frr:.1f} % of {row.n} frames"
    ends = ""
    if not math.isnan(row.interval.low):
        ends = f" ({100 * row.interval.low:.1f} to {100 * row.interval.high:.1f}, {row.interval.unit}s resampled)"
    return f"{rate}{ends} and {words[row.beats]}, {best.replace('_', ' ')}, at {100 * row.baselines[best]:.1f} %."


def _of_group(comparisons: Sequence[Comparison]) -> tuple[list[str], list[str]]:
    """What the best one beats, and what cannot be told from it."""
    names = list(dict.fromkeys(name for each in comparisons for name in (each.reference, each.configuration)))
    against = {name: [_seen_from(name, each) for each in comparisons if name in _pair(each)] for name in names}
    best = max(names, key=lambda name: sum(0 if math.isnan(gain) else gain for _, gain, _ in against[name]))
    beaten = [(other, gain, each) for other, gain, each in against[best] if each.is_significant and gain > 0]
    tied = [other for other, _, each in against[best] if not each.is_significant]
    told = []
    if len(beaten) > _MOST_NAMES:
        gains = [gain for _, gain, _ in beaten]
        told = [f"{best} beats {len(beaten)} others by {100 * min(gains):.1f} to {100 * max(gains):.1f} points"]
    elif beaten:
        parts = [f"{other} by {100 * gain:.1f} points{_ends(best, each)}" for other, gain, each in beaten]
        told = [f"{best} beats {_joined(parts)}"]
    if len(tied) > _MOST_NAMES:
        return told, [f"{best} cannot be told from {len(tied)} others"]
    if len(tied) > 1:
        return told, [f"{best} cannot be told from {_joined(tied)}"]
    if not tied:
        return told, []
    ((gain, each),) = ((gain, each) for other, gain, each in against[best] if other == tied[0])
    apart = f"{_joined([name for name in names if name in (best, tied[0])])} cannot be told apart"
    return told, [apart if math.isnan(gain) else f"{apart} ({_points(best, gain, each)})"]


def _pair(each: Comparison) -> tuple[str, str]:
    return each.reference, each.configuration


def _seen_from(name: str, each: Comparison) -> tuple[str, float, Comparison]:
    if each.configuration == name:
        return each.reference, each.difference, each
    return each.configuration, 0.0 - each.difference, each


def _points(best: str, gain: float, each: Comparison) -> str:
    ends = _ends(best, each)
    return f"{100 * gain:.1f} points{',' if ends else ''}{ends.replace('(', '').replace(')', '')}"


def _ends(best: str, each: Comparison) -> str:
    low, high = each.interval.low, each.interval.high
    if math.isnan(low):
        return ""
    if each.configuration != best:
        low, high = -high, -low
    return f" ({100 * low:.1f} to {100 * high:.1f}, {each.interval.unit}s resampled)"


def _joined(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
