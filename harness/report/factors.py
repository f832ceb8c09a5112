"""The factors of a grid: the labels of each, and their comparisons over all values of the others."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import islice

import numpy as np

from harness.score.comparison import Comparison, compare, with_holm
from harness.score.intervals import ScoredFrames, pair


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
) -> dict[str, tuple[Comparison, ...]]:
    """For each factor of a grid, compare every two of its labels on the frames of all configurations that have them.

    A frame counts once for each label of the other factors. p values are corrected over all factors together.
    ``frames`` and ``factors`` are by configuration, the result by factor; it is empty if they are no grid.
    """
    grid = grid_levels({name: factors.get(name, {}) for name in frames})
    labels = Counter(label for levels in grid.values() for label in levels)
    groups: dict[str, tuple[Comparison, ...]] = {}
    for key, levels in grid.items():
        pooled = {
            level if labels[level] == 1 else f"{key}={level}": _pooled(
                [scored for name, scored in frames.items() if factors[name][key] == level]
            )
            for level in levels
        }
        by_level = {shown: _without(key, level, factors, frames) for shown, level in zip(pooled, levels, strict=True)}
        groups[key] = tuple(
            replace(found, is_identical=_are_identical(*(by_level[name] for name in found.names)))
            if found.better == found.worse == 0
            else found
            for found in compare(pooled)
        )
    corrected = iter(with_holm([comparison for group in groups.values() for comparison in group]))
    return {key: tuple(islice(corrected, len(group))) for key, group in groups.items()}


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
    """Whether each pair of configurations answers identically: their rates together may be equal by chance."""
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
