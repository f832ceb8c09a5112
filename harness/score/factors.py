"""The factors of a grid, such as the matcher and the cones, each compared over all values of the others."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from harness.score.comparison import Comparison, compare, with_holm
from harness.score.scored_frames import ScoredFrames


def factor_levels(configurations: Sequence[str]) -> list[tuple[str, ...]]:
    """The values of each factor of a grid, from names like bm-one, bm-two, sgbm-one, sgbm-two; () for one value.

    Empty where the names are not all combinations, or where fewer than two factors have several values.
    """
    words = [name.split("-") for name in configurations]
    if len({len(each) for each in words}) != 1:
        return []
    levels = [tuple(dict.fromkeys(column)) for column in zip(*words, strict=True)]
    if math.prod(map(len, levels)) != len(configurations) or sum(len(each) > 1 for each in levels) < 2:
        return []
    return [each if len(each) > 1 else () for each in levels]


def compare_factors(frames: Mapping[str, Sequence[ScoredFrames]]) -> list[tuple[Comparison, ...]]:
    """For each factor of a grid, every two of its values compared on the frames of all configurations that have them.

    A frame counts once for each value of the other factors. p values are corrected over all factors together.
    ``frames`` are by configuration; names that are no grid give nothing.
    """
    names = list(frames)
    found = []
    for place, levels in enumerate(factor_levels(names)):
        pooled = {
            level: _pooled([frames[name] for name in names if name.split("-")[place] == level]) for level in levels
        }
        found.append(compare(pooled))
    corrected = list(with_holm([each for group in found for each in group]))
    return [tuple(corrected.pop(0) for _ in group) for group in found if group]


def _pooled(configurations: Sequence[Sequence[ScoredFrames]]) -> list[ScoredFrames]:
    """Several configurations as seeds of one: the frames that all of them scored."""
    by_subject = [{(each.clip, each.subject): each for each in frames} for frames in configurations]
    pooled = []
    for key, first in by_subject[0].items():
        others = [each[key] for each in by_subject[1:] if key in each]
        if len(others) < len(by_subject) - 1:
            continue
        right = [dict(zip(each.frames, each.correct, strict=True)) for each in (first, *others)]
        kept = [i for i, frame in enumerate(first.frames) if all(frame in each for each in right)]
        frames = tuple(first.frames[i] for i in kept)
        pooled.append(
            ScoredFrames(
                clip=first.clip,
                subject=first.subject,
                frames=frames,
                looks=tuple(first.looks[i] for i in kept),
                truth=tuple(first.truth[i] for i in kept),
                correct=tuple(sum(each[frame] for each in right) for frame in frames),
                seeds=sum(each.seeds for each in (first, *others)),
            )
        )
    return pooled
