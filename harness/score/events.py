"""Events: how many looks were recognised, whatever their length.

An event is a longest run of one target. Frame rates reward long looks; events count a glance as much as a stare
(Ba and Odobez, "Recognizing visual focus of attention from head pose in natural meetings", 2009).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness.score.statistics import Codes


class Event(NamedTuple):
    """A run of one target: its code, and its first and last position in the clip."""

    code: int
    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True)
class EventCounts:
    """Events in the truth, in the predictions, and pairs of them that match."""

    true: int
    found: int
    matched: int

    @property
    def recall(self) -> float:
        """Share of the true events that were found; NaN where there are none."""
        return self.matched / self.true if self.true else math.nan

    @property
    def precision(self) -> float:
        """Share of the found events that are true; NaN where there are none."""
        return self.matched / self.found if self.found else math.nan

    @property
    def f_measure(self) -> float:
        """Harmonic mean of recall and precision; NaN where there are no events at all."""
        events = self.true + self.found
        return 2 * self.matched / events if events else math.nan

    @property
    def rates(self) -> tuple[float, float, float]:
        """Recall, precision and F."""
        return self.recall, self.precision, self.f_measure


def find_events(codes: Codes, positions: Codes) -> list[Event]:
    """Runs of one code over consecutive positions. Negative codes (no prediction) are no events and end one.

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
    """The most pairs of a true and a found event with the same target that overlap, each event used once.

    Both lists are in order. Events of a list do not overlap each other, so that the sweep below finds the best
    alignment: when the first two do not match, whichever ends first can match nothing that comes later.
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
