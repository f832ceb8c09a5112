"""Evidence of behaviour in one clip by source, as sums over looks; :mod:`harness.score.behaviour` pools it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, permutations
from operator import attrgetter

import numpy as np

from harness.score.sequences import Look, TargetSequence
from harness.score.statistics import Codes
from vfoa.types import Float

FOLLOWED_WITHIN_S = 2.0
"""Longest time from the beginning of a look to the beginning of a look that follows it."""

Key = tuple[str | None, str | None]
"""The target that is left, and the target; None for measures without one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """Evidence of one source for one measure in one clip: a column per key; sizes and values (U, K) of its units."""

    clip: str
    subject: str
    partner: str | None
    source: str
    measure: str
    keys: tuple[Key, ...]
    sizes: Float
    values: Float


def by_clips(sequences: Iterable[TargetSequence]) -> Iterator[dict[str, list[TargetSequence]]]:
    """Yield the sequences of each clip by subject."""
    clips: dict[str, dict[str, list[TargetSequence]]] = {}
    for each in sequences:
        clips.setdefault(each.clip, {}).setdefault(each.subject, []).append(each)
    yield from clips.values()


def clip_evidence(found: Mapping[str, list[TargetSequence]], names: Sequence[str]) -> Iterator[Evidence]:
    """Yield the evidence of every subject, every pair and every leader in one clip, by every source."""
    for sequences in found.values():
        yield from _subject_evidence(sequences, names)
    for one, other in combinations(found, 2):
        for first, second in _same_source(found[one], found[other]):
            yield from _pair_evidence(first, second, names)
    for follower, leader in permutations(found, 2):
        for following, leading in _same_source(found[follower], found[leader]):
            yield from _following_evidence(following, leading, names)


def _same_source(
    first: Iterable[TargetSequence], second: Iterable[TargetSequence]
) -> Iterator[tuple[TargetSequence, TargetSequence]]:
    others = {each.source: each for each in second}
    return ((each, others[each.source]) for each in first if each.source in others)


def _subject_evidence(sequences: Sequence[TargetSequence], names: Sequence[str]) -> Iterator[Evidence]:
    """Evidence of all sources on one subject in one clip, with the same columns."""
    looks = [each.looks() for each in sequences]
    moves = [_transitions(each, found) for each, found in zip(sequences, looks, strict=True)]
    targets = sorted({look.state for found in looks for look in found})
    ways = sorted({(before.state, after.state) for found in moves for before, after in found})
    column, way_column = ({key: place for place, key in enumerate(keys)} for keys in (targets, ways))
    at_targets = tuple((None, names[state]) for state in targets)
    for each, found, moved in zip(sequences, looks, moves, strict=True):
        units = each.units()
        frames = np.bincount(units).astype(np.float64)
        on = _table(len(frames), len(targets), units, [column[state] for state in each.states.tolist()])
        begun = _table(len(frames), len(targets), _units_of(each, units, found), [column[look.state] for look in found])
        ended = _table(len(frames), 1, _units_of(each, units, [after for _, after in moved]), [0] * len(moved))
        went = _table(1, len(ways), [0] * len(moved), [way_column[a.state, b.state] for a, b in moved])
        yield _evidence(each, "time_share", at_targets, np.repeat(frames[:, None], len(targets), axis=1), on)
        yield _evidence(each, "looks", at_targets, begun, begun)
        if not math.isnan(each.rate_hz):
            minutes = frames[:, None] * each.frame_s / 60
            yield _evidence(each, "looks_per_min", at_targets, minutes.repeat(len(targets), axis=1), begun)
            one = _table(len(found), len(targets), range(len(found)), [column[look.state] for look in found])
            sizes = np.concatenate([one, np.ones((len(found), 1))], axis=1)
            lengths = np.array([each.length_s(look) for look in found])[:, None]
            yield _evidence(each, "look_length_s", (*at_targets, (None, None)), sizes, sizes * lengths)
        yield _evidence(each, "transitions", tuple((names[a], names[b]) for a, b in ways), went, went)
        if not math.isnan(each.rate_hz):
            yield _evidence(each, "transitions_per_min", _NO_KEY, minutes, ended)


def _transitions(sequence: TargetSequence, looks: Sequence[Look]) -> list[tuple[Look, Look]]:
    return [
        (before, after)
        for before, after in pairwise(looks)
        if before.state != after.state and sequence.follows(before, after)
    ]


def _pair_evidence(one: TargetSequence, other: TargetSequence, names: Sequence[str]) -> Iterator[Evidence]:
    """Evidence of one source on two subjects together, at the frames known for both."""
    _, ours, theirs = np.intersect1d(one.positions, other.positions, assume_unique=True, return_indices=True)
    if len(ours) == 0:
        return
    first, second = one.at(ours), other.at(theirs)
    me, you = (_code(each.subject, names) for each in (one, other))
    mutual = (first.states == you) & (second.states == me)
    is_thing = (first.states != 0) & (first.states != me) & (first.states != you)
    joint = np.where((first.states == second.states) & is_thing, first.states, -1)
    both = replace(first, states=first.states * len(names) + second.states)
    units = both.units()
    frames = np.bincount(units).astype(np.float64)[:, None]
    states = (("mutual_gaze", np.where(mutual, 0, -1)), ("joint_attention", joint))
    for name, state in states:
        found = [look for look in first.runs(state) if look.state >= 0]
        inside = np.bincount(units, state >= 0).astype(np.float64)[:, None]
        yield _evidence(one, f"{name}_share", _NO_KEY, frames, inside, other.subject)
        count = np.full((1, 1), float(len(found)))
        yield _evidence(one, _PLURALS[name], _NO_KEY, count, count, other.subject)
        if not math.isnan(one.rate_hz):
            lengths = np.array([first.length_s(look) for look in found]).reshape(-1, 1)
            yield _evidence(one, f"{name}_length_s", _NO_KEY, np.ones_like(lengths), lengths, other.subject)


_PLURALS = {"mutual_gaze": "mutual_gazes", "joint_attention": "joint_attentions"}


_begin = attrgetter("first")


def _following_evidence(follower: TargetSequence, leader: TargetSequence, names: Sequence[str]) -> Iterator[Evidence]:
    """Evidence of one source on how one subject follows the looks of another."""
    if math.isnan(leader.rate_hz):
        return
    people = {0, _code(leader.subject, names), _code(follower.subject, names)}
    theirs: dict[int, list[Look]] = {}
    for look in follower.looks():
        theirs.setdefault(look.state, []).append(look)
    latencies_s: list[float] = []  # NaN for a look that is not followed
    for _, look in _transitions(leader, leader.looks()):
        same = theirs.get(look.state, [])
        after = bisect_right(same, look.first, key=_begin)
        if look.state in people or (after and same[after - 1].last >= look.first):
            continue
        latency_s = (same[after].first - look.first) / leader.rate_hz if after < len(same) else math.inf
        latencies_s.append(latency_s if latency_s <= FOLLOWED_WITHIN_S else math.nan)
    found = np.array(latencies_s).reshape(-1, 1)
    followed = np.isfinite(found).astype(np.float64)
    yield _evidence(follower, "followed_share", _NO_KEY, np.ones_like(found), followed, leader.subject)
    yield _evidence(follower, "following_latency_s", _NO_KEY, followed, np.nan_to_num(found), leader.subject)


_NO_KEY: tuple[Key, ...] = ((None, None),)


def _evidence(
    sequence: TargetSequence,
    measure: str,
    keys: tuple[Key, ...],
    sizes: Float,
    values: Float,
    partner: str | None = None,
) -> Evidence:
    return Evidence(
        clip=sequence.clip,
        subject=sequence.subject,
        partner=partner,
        source=sequence.source,
        measure=measure,
        keys=keys,
        sizes=sizes,
        values=values,
    )


def _code(name: str, names: Sequence[str]) -> int:
    """The code of a subject as a target; a code that no frame has if nobody looks at the subject."""
    return names.index(name) if name in names else len(names)


def _units_of(sequence: TargetSequence, units: Codes, looks: Iterable[Look]) -> Codes:
    """The unit in which each look begins."""
    return units[np.searchsorted(sequence.positions, np.array([look.first for look in looks], dtype=np.intp))]


def _table(rows: int, columns: int, row: Iterable[int] | Codes, column: Iterable[int]) -> Float:
    """Count each (row, column)."""
    table = np.zeros((rows, columns))
    np.add.at(table, (np.array(list(row), dtype=np.intp), np.array(list(column), dtype=np.intp)), 1.0)
    return table
