"""The result of a run in one sentence: which configurations are better, by how much, and which are not distinguished.

Further sentences say why the wrong frames are wrong, and what to do next.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from harness.report.advice import advice
from harness.score.comparison import Comparison, compare, identical_on, with_holm
from harness.score.intervals import ScoredFrames, pair
from harness.score.oracle_ablation import without_oracles
from harness.score.score import ScoreRow, Scores
from harness.score.verdicts import ERROR_TYPES

_MOST_NAMES = 4
_MOST_STEPS = 2


def verdict_sentence(scores: Scores) -> str:
    """The result of a run, from the comparisons of its configurations without the oracle ablation.

    A grid is compared by its factors, over all values of the others.
    """
    rows = {row.configuration: row for row in compared_rows(scores)}
    if not rows:
        return "Nothing is scored: no frame has a label."
    losses = _log_losses(list(rows.values()))
    if len(rows) == 1:
        return f"There is one configuration, and none to compare it with.{losses}"
    frames = {name: scores.frames_of(name) for name in rows}
    groups = compare_factors(frames, scores.factors) or [compare(frames)]
    said = [_of_group(group) for group in groups]
    better, untold = [part for parts, _ in said for part in parts], [part for _, parts in said for part in parts]
    sentence = "; ".join([*better, *untold])
    return f"{sentence}.{losses}"


def _log_losses(rows: Sequence[ScoreRow]) -> str:
    """The log losses, lowest first, where all configurations give probabilities."""
    losses = sorted((row.metrics["log_loss"], row.configuration) for row in rows)
    if any(math.isnan(loss) for loss, _ in losses):
        return ""
    shown = [f"{name} {loss:.3f}" for loss, name in losses[:_MOST_NAMES]]
    return f" Log loss, lower is better: {', '.join(shown)}{' ...' if len(losses) > _MOST_NAMES else ''}."


def headline(scores: Scores) -> str:
    """The best configuration over all clips, its best baseline and whether it beats that; empty without labels.

    By a sign-flip test of the units that the interval resamples.
    """
    rows = compared_rows(scores)
    if not rows:
        return ""
    best = max(rows, key=lambda row: row.frr)
    of = f", best of {len(rows)}" if len(rows) > 1 else ""
    baseline = f"'{best.best_baseline.replace('_', ' ')}' ({100 * best.baselines[best.best_baseline]:.1f} %)"
    verb = {"yes": "beats", "not shown": "not shown to beat", "no": "not better than"}[best.beats]
    test = f", sign-flip test of {best.interval.unit}s" if best.beats != "no" else ""
    return f"{best.configuration} {100 * best.frr:.1f} %{of}; {verb} {baseline}{test}"


def compared_rows(scores: Scores) -> list[ScoreRow]:
    """The row of each configuration over all clips, without the oracle ablation."""
    compared = without_oracles(scores.scored_configurations)
    return [row for row in scores.overall() if row.configuration in compared]


def _of_group(comparisons: Sequence[Comparison]) -> tuple[list[str], list[str]]:
    """The configurations that the best one beats, and those that cannot be told from it."""
    names = list(dict.fromkeys(name for comparison in comparisons for name in comparison.names))
    leads = dict.fromkeys(names, 0.0)
    for comparison in comparisons:
        if not math.isnan(comparison.difference):
            leads[comparison.configuration] += comparison.difference
            leads[comparison.reference] -= comparison.difference
    best = max(names, key=lambda name: leads[name])
    against = [_seen_from(best, comparison) for comparison in comparisons if best in comparison.names]
    beaten = [comparison for comparison in against if comparison.is_significant and comparison.difference > 0]
    tied = [comparison for comparison in against if not comparison.is_significant]
    better, untold = [], []
    if len(beaten) > _MOST_NAMES:
        gains = [100 * comparison.difference for comparison in beaten]
        better = [f"{best} beats {len(beaten)} others by {min(gains):.1f} to {max(gains):.1f} points"]
    elif beaten:
        parts = [f"{lost.reference} by {100 * lost.difference:.1f} points{_ends(lost, ' (', ')')}" for lost in beaten]
        better = [f"{best} beats {_joined(parts)}"]
    if len(tied) > _MOST_NAMES:
        untold = [f"{best} cannot be told from {len(tied)} others"]
    elif len(tied) > 1:
        untold = [f"{best} cannot be told from {_joined([comparison.reference for comparison in tied])}"]
    elif tied:
        (only,) = tied
        both = _joined([name for name in names if name in only.names])
        points = "" if math.isnan(only.difference) else f" ({100 * only.difference:.1f} points{_ends(only, ', ')})"
        untold = [f"{both} are {identical_on(only.n)}" if only.is_identical else f"{both} cannot be told apart{points}"]
    return better, untold


def _seen_from(name: str, comparison: Comparison) -> Comparison:
    """The comparison with this one of its two configurations as the later one."""
    if comparison.configuration == name:
        return comparison
    return replace(
        comparison,
        reference=comparison.configuration,
        configuration=name,
        difference=0.0 - comparison.difference,
        interval=replace(comparison.interval, low=-comparison.interval.high, high=-comparison.interval.low),
    )


def _ends(comparison: Comparison, before: str, after: str = "") -> str:
    """The interval that belongs to the test, as corrected as it is, between two texts; empty without one."""
    low, high = comparison.interval.low, comparison.interval.high
    if math.isnan(low):
        too_few = comparison.units and not comparison.can_be_significant
        return f"{before}{comparison.counted_units} are too few for a test{after}" if too_few else ""
    only = "" if comparison.interval.unit == "clip" else ", these clips only"
    corrected = f", corrected for {comparison.family} comparisons" if comparison.family > 1 else ""
    return f"{before}95 %: {100 * low:.1f} to {100 * high:.1f}{only}{corrected}{after}"


def _joined(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def grid_levels(factors: Mapping[str, Mapping[str, str]]) -> dict[str, list[str]]:
    """The labels of each factor of a grid that has several, by dotted key, from those of each configuration.

    Empty if the configurations are not all combinations, or if fewer than two factors have several labels.
    """
    keys = {tuple(labels) for labels in factors.values()}
    if len(keys) != 1:
        return {}
    levels = {key: list(dict.fromkeys(labels[key] for labels in factors.values())) for key in keys.pop()}
    if math.prod(map(len, levels.values())) != len(factors):
        return {}
    several = {key: labels for key, labels in levels.items() if len(labels) > 1}
    return several if len(several) > 1 else {}


def compare_factors(
    frames: Mapping[str, Sequence[ScoredFrames]], factors: Mapping[str, Mapping[str, str]]
) -> list[tuple[Comparison, ...]]:
    """For each factor of a grid, compare every two of its labels on the frames of all configurations that have them.

    A frame counts once for each label of the other factors. p values are corrected over all factors together.
    ``frames`` and ``factors`` are by configuration; the result is empty if the configurations are no grid.
    """
    grid = grid_levels({name: factors.get(name, {}) for name in frames})
    labels = Counter(label for levels in grid.values() for label in levels)
    groups = []
    for key, levels in grid.items():
        pooled = {
            level if labels[level] == 1 else f"{key}={level}": _pooled(
                [scored for name, scored in frames.items() if factors[name][key] == level]
            )
            for level in levels
        }
        by_level = {shown: _without(key, level, factors, frames) for shown, level in zip(pooled, levels, strict=True)}
        groups.append(
            tuple(
                replace(found, is_identical=_are_identical(*(by_level[name] for name in found.names)))
                if found.better == found.worse == 0
                else found
                for found in compare(pooled)
            )
        )
    corrected = list(with_holm([comparison for group in groups for comparison in group]))
    return [tuple(corrected.pop(0) for _ in group) for group in groups]


_ByOthers = Mapping[tuple[str, ...], Sequence[ScoredFrames]]
"""The frames of configurations by the labels of all factors but one."""


def _without(
    key: str,
    level: str,
    factors: Mapping[str, Mapping[str, str]],
    frames: Mapping[str, Sequence[ScoredFrames]],
) -> _ByOthers:
    return {
        tuple(label for other, label in factors[name].items() if other != key): scored
        for name, scored in frames.items()
        if factors[name][key] == level
    }


def _are_identical(first: _ByOthers, second: _ByOthers) -> bool:
    """Whether the configurations are identical one by one: equal sums over them say less."""
    return all(pair(first[others], second[others]).is_identical for others in first)


def _pooled(configurations: Sequence[Sequence[ScoredFrames]]) -> list[ScoredFrames]:
    """Return the frames that all of several configurations scored, as if these were seeds of one configuration."""
    by_subject = [{(scored.clip, scored.subject): scored for scored in frames} for frames in configurations]
    pooled = []
    for key, first in by_subject[0].items():
        parts = [by_key[key] for by_key in by_subject if key in by_key]
        if len(parts) == len(by_subject):
            frames = reduce(np.intersect1d, [part.frames for part in parts])
            kept = np.searchsorted(first.frames, frames)
            pooled.append(
                replace(
                    first,
                    frames=frames,
                    looks=first.looks[kept],
                    truth=first.truth[kept],
                    correct=np.sum([part.correct[np.searchsorted(part.frames, frames)] for part in parts], axis=0),
                    seeds=sum(part.seeds for part in parts),
                )
            )
    return pooled


def next_steps(scores: Scores, configurations: Collection[str]) -> list[str]:
    """A sentence for each of the most frequent error types: its number of wrong frames, its meaning, and what to try.

    Empty if nothing is wrong under these configurations. Frames of several configurations count each.
    """
    verdicts = (verdict for verdict in scores.verdicts if verdict.configuration in configurations)
    counts = Counter(verdict.error_type for verdict in verdicts if verdict.error_type is not None)
    wrong = sum(counts.values())
    order = list(ERROR_TYPES)
    top = sorted(counts.items(), key=lambda item: (-item[1], order.index(item[0])))
    return [
        f"{count} of {wrong} wrong frames: {name} ({ERROR_TYPES[name]}). Next: "
        f"{advice(name, scores.settings.values())}."
        for name, count in top[:_MOST_STEPS]
    ]
