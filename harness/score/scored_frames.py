"""Frames of one configuration for a comparison: their correctness, subject, clip and look."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.score.intervals import Units
from harness.score.outcomes import Outcomes
from vfoa.errors import VfoaError
from vfoa.types import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredFrames:
    """A subject's scored frames in one clip.

    ``frames`` are their numbers, ``looks`` the number of the look of each, ``truth`` its true target. ``correct``
    counts the seeds, of ``seeds``, under which each is right; with one seed it is 0 or 1.
    """

    clip: str
    subject: str
    frames: tuple[int, ...]
    looks: tuple[int, ...]
    truth: tuple[str, ...]
    correct: tuple[int, ...]
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
    others = {
        (each.clip, each.subject): dict(zip(each.frames, zip(each.truth, each.correct, strict=True), strict=True))
        for each in second
    }
    clips: dict[str, int] = {}
    codes: list[int] = []
    frames: list[int] = []
    values: list[int] = []
    better = worse = 0
    for each in first:
        other = others.get((each.clip, each.subject), {})
        look = None
        columns = zip(each.frames, each.looks, each.truth, each.correct, strict=True)
        for frame, number, truth, was_right in columns:
            if frame not in other:
                continue
            other_truth, is_right = other[frame]
            if other_truth != truth:
                raise VfoaError(
                    f"{each.clip}: frame {frame}: {each.subject} looks at {truth!r} in one and at {other_truth!r} in "
                    "the other; expected the same labels"
                )
            if number != look:
                look = number
                codes.append(clips.setdefault(each.clip, len(clips)))
                frames.append(0)
                values.append(0)
            gain = int(is_right) - int(was_right)
            frames[-1] += repeats
            values[-1] += gain
            better, worse = better + (gain > 0), worse + (gain < 0)
    if not frames:
        return Pairs(n=0, better=0, worse=0, units=None)
    units = Units(
        clips=np.array(codes, dtype=np.intp),
        frames=np.array(frames, dtype=np.float64),
        values=np.array(values, dtype=np.float64),
    )
    return Pairs(n=sum(frames) // repeats, better=better, worse=worse, units=units)


def units_of(group: Sequence[Outcomes], values: Sequence[NDArray[Any]]) -> Units:
    """The looks of some outcomes, with the sums over their frames of a value (n,) per frame."""
    clips: dict[str, int] = {}
    sums: dict[tuple[str, str], Float] = {}  # (looks, 2) by clip and subject: seeds share the looks
    for each, value in zip(group, values, strict=True):
        of_looks = np.stack([np.bincount(each.looks), np.bincount(each.looks, value)], axis=1).astype(np.float64)
        key = each.clip, each.subject
        sums[key] = sums[key] + of_looks if key in sums else of_looks
    codes = [np.full(len(each), clips.setdefault(clip, len(clips)), dtype=np.intp) for (clip, _), each in sums.items()]
    frames, totals = np.concatenate(list(sums.values())).T
    return Units(clips=np.concatenate(codes), frames=frames, values=totals)
