"""Looks: the unit of inference within a clip, and what events count.

A look is a longest run of one true target of one subject. The frames of a look share what makes them right or wrong
(the target, its size and place, a slow error of the gaze), so they count as one observation, not as many. An error also
outlasts a short look, so a subject's looks are joined with the next ones until they last :data:`LEAST_S` seconds and
twice the time for which verdicts stay alike (:func:`correlation_time_s`). ``reports/coverage.md`` measures the effect.

An event is a longest run of one target, true or predicted, whatever its length. Frame rates reward long looks; events
count a glance as much as a stare (Ba and Odobez, "Recognizing visual focus of attention from head pose in natural
meetings", 2009).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from harness.labels.labels import IGNORED, Label
from vfoa.types import Codes, Flags, Float

LEAST_S = 2.0
"""Shortest duration of a unit in seconds, unless the subject's frames last less."""
_LAGS_S = np.geomspace(0.04, 60, 32)
"""Times between verdicts, and ranges that are tried, in seconds."""
_GAP = 1.5
"""A longer step between two scored frames, in usual ones, is a gap: it ends a look."""


def number_looks(truth: Codes, positions: Codes, frames_per_second: float | None, least_s: float = LEAST_S) -> Codes:
    """Number the looks of one subject's scored frames from 0: (n,).

    Parameters
    ----------
    truth, positions
        The code of the true target and the place in the clip of each scored frame, in order: (n,).
    frames_per_second
        The rate of the clip's frames; None if it is not known: looks are not joined then.
    least_s
        Shortest duration of a unit in seconds.
    """
    if len(truth) == 0:
        return np.zeros(0, dtype=np.intp)
    stride = _stride(positions)
    begins = np.concatenate(([True], (np.diff(truth) != 0) | gaps(positions)))
    looks = np.cumsum(begins) - 1
    if frames_per_second is None:
        return looks
    return joined(np.bincount(looks).astype(np.float64) * stride / frames_per_second, least_s)[looks]


def gaps(positions: Codes) -> Flags:
    """Whether (n - 1,) there is a gap between two scored frames: a longer step than the usual one."""
    return np.diff(positions) > _GAP * _stride(positions)


def _stride(positions: Codes) -> float:
    """The usual step from a scored frame to the next: labels may be sparser than the clip's frames."""
    return float(np.median(np.diff(positions))) if len(positions) > 1 else 1.0


def joined(lengths: Float, least: float) -> Codes:
    """Number the units of consecutive runs (m,) that are joined until they are this long.

    A short rest at the end joins the unit before it.
    """
    units = np.zeros(len(lengths), dtype=np.intp)
    unit, length = 0, 0.0
    for run, seconds in enumerate(lengths.tolist()):
        if length >= least:
            unit, length = unit + 1, 0.0
        units[run] = unit
        length += seconds
    if unit and length < least:
        units[units == unit] = unit - 1
    return units


def seconds_from_change(labels: Sequence[Label | None], seconds: Sequence[float]) -> list[float]:
    """Seconds from each frame to the nearest change between two labels of other targets; infinity without a change.

    A change is in the middle between two frames that are judged. Where labels begin or end, and at a gap between judged
    frames (:func:`gaps`), such as one of ``ignore``, nobody says that there is one.
    """
    judged = [(place, label.target) for place, label in enumerate(labels) if label and label.target != IGNORED]
    is_gap = gaps(np.array([place for place, _ in judged], dtype=np.intp))
    changes = [
        (seconds[place_before] + seconds[place_after]) / 2
        for ((place_before, before), (place_after, after)), is_apart in zip(pairwise(judged), is_gap, strict=True)
        if before != after and not is_apart
    ]
    if not changes:
        return [math.inf] * len(seconds)
    places = np.searchsorted(changes, seconds)
    ends = np.array([-math.inf, *changes, math.inf])
    return np.minimum(np.array(seconds) - ends[places], ends[places + 1] - np.array(seconds)).tolist()


def correlation_time_s(sequences: Iterable[tuple[Flags, Codes, float | None]]) -> float:
    """The time for which verdicts stay alike, in seconds: the range of an exponential variogram.

    The variogram is half the mean squared difference of verdicts of one subject in one clip, by the time between them
    (Cressie, "Statistics for Spatial Data", 1993, chapter 2). It needs no mean, which short sequences do not give.

    Parameters
    ----------
    sequences
        Whether each frame is right and its place in the clip, both (n,), and the rate of the clip's frames. Sequences
        of unknown rate are left out.

    Returns
    -------
    float
        At most 60, also where no sequence lasts so long: then they change once, or few times. 0 if verdicts do not
        change, or change as independent ones.
    """
    squares, counts = np.zeros(len(_LAGS_S)), np.zeros(len(_LAGS_S))
    for right, positions, rate in sequences:
        if rate is None or len(right) < 2:
            continue
        values = np.full(positions[-1] - positions[0] + 1, np.nan)
        values[positions - positions[0]] = right
        steps = _LAGS_S * rate / (stride := round(_stride(positions)))
        # labels may be sparser than the frames: only frames that are so far apart have a label
        for place in np.flatnonzero(abs(np.rint(steps) - steps) <= steps / 3).tolist():
            lag = stride * round(steps[place])
            if lag >= len(values):
                break
            change = values[lag:] - values[:-lag]
            squares[place] += np.nansum(change**2)
            counts[place] += np.count_nonzero(~np.isnan(change))
    known = counts > 0
    if not squares.any():
        return 0.0
    seconds, heights = _LAGS_S[known], 0.5 * squares[known] / counts[known]
    weights = counts[known] / seconds  # pairs that are further apart overlap more
    fits = [_fitted(1 - np.exp(-seconds / range_s), heights, weights) for range_s in _LAGS_S]
    best = int(np.argmin([error for error, _ in fits]))
    return float(_LAGS_S[best]) if fits[best][1] > 0 else 0.0


def _fitted(shape: Float, heights: Float, weights: Float) -> tuple[float, float]:
    """The weighted squared error of the best line over a shape, with a slope of at least 0, and the slope."""
    center, level = np.average(shape, weights=weights), np.average(heights, weights=weights)
    across = float(np.average((shape - center) ** 2, weights=weights))
    slope = max(float(np.average((shape - center) * heights, weights=weights)) / across, 0.0) if across > 0 else 0.0
    rest = heights - level - slope * (shape - center)
    return float(np.average(rest**2, weights=weights)), slope


class Event(NamedTuple):
    """A run of one target: its code, and its first and last position in the clip."""

    code: int
    first: int
    last: int


class MatchCounts(NamedTuple):
    """Numbers of what is true (events, or frames), what was found, and what matches; and the rates of detection."""

    true: int
    predicted: int
    matched: int

    @property
    def recall(self) -> float:
        """Share of the true ones that were found; NaN without any."""
        return self.matched / self.true if self.true else math.nan

    @property
    def precision(self) -> float:
        """Share of the found ones that are true; NaN without any."""
        return self.matched / self.predicted if self.predicted else math.nan

    @property
    def f_measure(self) -> float:
        """Harmonic mean of recall and precision; NaN without any."""
        both = self.true + self.predicted
        return 2 * self.matched / both if both else math.nan

    @property
    def rates(self) -> tuple[float, float, float]:
        """Recall, precision and F."""
        return self.recall, self.precision, self.f_measure


def find_events(codes: Codes, positions: Codes) -> list[Event]:
    """Return the runs of one code without a gap. Negative codes (no prediction) end a run and start none.

    ``positions`` (n,) ascend; a gap, such as frames that are not scored, ends a run too: a step above the usual one.
    """
    if len(codes) == 0:
        return []
    breaks = np.flatnonzero((np.diff(codes) != 0) | gaps(positions)) + 1
    first = np.concatenate(([0], breaks))
    last = np.concatenate((breaks, [len(codes)])) - 1
    runs = zip(codes[first].tolist(), positions[first].tolist(), positions[last].tolist(), strict=True)
    return [Event(*run) for run in runs if run[0] >= 0]


def match_events(true: list[Event], predicted: list[Event]) -> int:
    """The greatest number of pairs of a true and a found event with the same target that overlap; each is used once.

    Both lists are in order. Events of one list do not overlap, so the pass below finds the best alignment: if the
    first two do not match, the one that ends first can match no later event.
    """
    matched = i = j = 0
    while i < len(true) and j < len(predicted):
        overlap = true[i].first <= predicted[j].last and predicted[j].first <= true[i].last
        if overlap and true[i].code == predicted[j].code:
            matched, i, j = matched + 1, i + 1, j + 1
        elif true[i].last <= predicted[j].last:
            i += 1
        else:
            j += 1
    return matched


def count_events(sequences: Iterable[tuple[Codes, Codes, Codes]]) -> MatchCounts:
    """Events of several sequences together; each is (truth codes, predicted codes, positions), all (n,)."""
    true = n_predicted = matched = 0
    for truth, predicted, positions in sequences:
        true_events, predicted_events = find_events(truth, positions), find_events(predicted, positions)
        true += len(true_events)
        n_predicted += len(predicted_events)
        matched += match_events(true_events, predicted_events)
    return MatchCounts(true=true, predicted=n_predicted, matched=matched)
