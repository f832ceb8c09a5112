"""Frames of one configuration for a comparison: their correctness, subject, clip and look."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.score.intervals import Units
from harness.score.outcomes import Outcomes
from harness.score.statistics import Codes
from vfoa.errors import VfoaError
from vfoa.types import Float


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


def pair(first: Iterable[ScoredFrames], second: Iterable[ScoredFrames]) -> Pairs:
    """Pair frames by clip, subject and frame. Looks are those of the first, reduced to the common frames.

    Raises
    ------
    VfoaError
        If a frame has another true target in the second, or one was run under more seeds.
    """
    first, second = list(first), list(second)
    seeds = {each.seeds for each in (*first, *second)}
    if len(seeds) > 1:
        raise VfoaError(f"found runs under {min(seeds)} and under {max(seeds)} seeds; expected as many in both")
    (repeats,) = seeds or {1}
    others = {(each.clip, each.subject): each for each in second}
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
    return Pairs(n=int(units.frames.sum()) // repeats, better=better, worse=worse, units=units)


def _common(one: ScoredFrames, other: ScoredFrames) -> tuple[Codes, Codes]:
    """The indices of the common frames in both. Raises as :func:`pair` does."""
    _, ours, theirs = np.intersect1d(one.frames, other.frames, assume_unique=True, return_indices=True)
    for place in np.flatnonzero(one.truth[ours] != other.truth[theirs])[:1]:
        raise VfoaError(
            f"{one.clip}: frame {one.frames[ours[place]]}: {one.subject} looks at {one.truth[ours[place]]!r} in one "
            f"and at {other.truth[theirs[place]]!r} in the other; expected the same labels"
        )
    return ours, theirs


def units_of(group: Sequence[Outcomes], values: Sequence[NDArray[Any]]) -> Units:
    """The looks of some outcomes, with the sums over their frames of a value (n,) per frame."""
    clips: dict[str, int] = {}
    sums: dict[tuple[str, str], Float] = {}  # (looks, 2) by clip and subject: seeds share the looks
    for each, value in zip(group, values, strict=True):
        of_looks = np.stack([np.bincount(each.looks), np.bincount(each.looks, value)], axis=1).astype(np.float64)
        key = each.clip, each.subject
        sums[key] = sums[key] + of_looks if key in sums else of_looks
    codes = [np.full(len(each), clips.setdefault(clip, len(clips)), dtype=np.intp) for (clip, _), each in sums.items()]
    tracks = np.repeat(np.arange(len(sums)), [len(each) for each in sums.values()])
    frames, totals = np.concatenate(list(sums.values())).T
    return Units(clips=np.concatenate(codes), frames=frames, values=totals, tracks=tracks)
