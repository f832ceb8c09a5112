"""Looks: the unit of inference within a clip, and what events count.

A look is a longest run of one true target of one subject. The frames of a look share what makes them right or wrong
(the target, its size and place, a slow error of the gaze), so they count as one observation, not as many. An error also
outlasts a short look: looks of less than :data:`LEAST_S` seconds are joined with the subject's next ones until they
last that long. ``reports/coverage.md`` shows the effect: without joining, a test by looks of 0.7 s calls equal
configurations different in about 10 % of experiments; with it, in about 6 %.

An event is a longest run of one target, true or predicted, whatever its length. Frame rates reward long looks; events
count a glance as much as a stare (Ba and Odobez, "Recognizing visual focus of attention from head pose in natural
meetings", 2009).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness.score.statistics import Codes

LEAST_S = 2.0
"""Shortest duration of a unit in seconds, unless the subject's frames last less."""


def number_looks(truth: Codes, positions: Codes, frames_per_second: float | None) -> Codes:
    """Number the looks of one subject's scored frames from 0: (n,).

    Parameters
    ----------
    truth, positions
        The code of the true target and the place in the clip of each scored frame, in order: (n,).
    frames_per_second
        The rate of the clip's frames; None if it is not known: looks are not joined then.
    """
    if len(truth) == 0:
        return np.zeros(0, dtype=np.intp)
    steps = np.diff(positions)
    stride = float(np.median(steps)) if len(steps) else 1.0  # labels may be sparser than the clip's frames
    begins = np.concatenate(([True], (np.diff(truth) != 0) | (steps > 1.5 * stride)))
    looks = np.cumsum(begins) - 1
    if frames_per_second is None:
        return looks
    return _joined(np.bincount(looks) * stride / frames_per_second)[looks]


def _joined(seconds: np.ndarray) -> Codes:
    """The number of the unit that each look belongs to; a short rest at the end joins the unit before it."""
    units = np.zeros(len(seconds), dtype=np.intp)
    unit, lasted = 0, 0.0
    for look, each in enumerate(seconds.tolist()):
        if lasted >= LEAST_S:
            unit, lasted = unit + 1, 0.0
        units[look] = unit
        lasted += each
    if unit and lasted < LEAST_S:
        units[units == unit] = unit - 1
    return units


class Event(NamedTuple):
    """A run of one target: its code, and its first and last position in the clip."""

    code: int
    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True)
class EventCounts:
    """Numbers of true events, predicted events, and matching pairs."""

    true: int
    found: int
    matched: int

    @property
    def recall(self) -> float:
        """Share of the true events that were found; NaN without true events."""
        return self.matched / self.true if self.true else math.nan

    @property
    def precision(self) -> float:
        """Share of the found events that are true; NaN without found events."""
        return self.matched / self.found if self.found else math.nan

    @property
    def f_measure(self) -> float:
        """Harmonic mean of recall and precision; NaN without any events."""
        events = self.true + self.found
        return 2 * self.matched / events if events else math.nan

    @property
    def rates(self) -> tuple[float, float, float]:
        """Recall, precision and F."""
        return self.recall, self.precision, self.f_measure


def find_events(codes: Codes, positions: Codes) -> list[Event]:
    """Return the runs of one code over consecutive positions. Negative codes (no prediction) end a run and start none.

    ``positions`` (n,) ascend; a gap, such as frames that are not scored, ends a run too.
    """
    if len(codes) == 0:
        return []
    breaks = np.flatnonzero((np.diff(codes) != 0) | (np.diff(positions) != 1)) + 1
    first = np.concatenate(([0], breaks))
    last = np.concatenate((breaks, [len(codes)])) - 1
    runs = zip(codes[first].tolist(), positions[first].tolist(), positions[last].tolist(), strict=True)
    return [Event(*run) for run in runs if run[0] >= 0]


def match_events(true: list[Event], found: list[Event]) -> int:
    """The greatest number of pairs of a true and a found event with the same target that overlap; each is used once.

    Both lists are in order. Events of one list do not overlap, so the sweep below finds the best alignment: if the
    first two do not match, the one that ends first can match no later event.
    """
    matched = i = j = 0
    while i < len(true) and j < len(found):
        overlap = true[i].first <= found[j].last and found[j].first <= true[i].last
        if overlap and true[i].code == found[j].code:
            matched, i, j = matched + 1, i + 1, j + 1
        elif true[i].last <= found[j].last:
            i += 1
        else:
            j += 1
    return matched


def count_events(sequences: Iterable[tuple[Codes, Codes, Codes]]) -> EventCounts:
    """Events of several sequences together; each is (truth codes, predicted codes, positions), all (n,)."""
    true = found = matched = 0
    for truth, predicted, positions in sequences:
        true_events, found_events = find_events(truth, positions), find_events(predicted, positions)
        true += len(true_events)
        found += len(found_events)
        matched += match_events(true_events, found_events)
    return EventCounts(true=true, found=found, matched=matched)
