"""The target of each subject over a clip, by the labels and by each configuration, and its looks.

A frame is known to a source (the labels, or a configuration) if the source gives the subject's target there. Frames
that are labelled ``ignore``, such as saccades, are left out for all sources. A frame in which nothing got any attention
counts as looking at nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from harness.labels.labels import IGNORED, NOWHERE
from harness.score.looks import number_looks
from harness.score.outcomes import Outcomes
from harness.score.statistics import Codes
from harness.score.verdicts import NO_HIT, Verdict

TRUTH = "(truth)"
"""The name of the labels as a source, beside the names of the configurations."""

LONGEST_GAP_S = 0.5
"""Longest unknown time, such as a blink, that a look or a transition may span."""


class Look(NamedTuple):
    """A longest run of known frames with one state: its code, and its first and last position in the clip."""

    state: int
    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetSequence:
    """The targets of one subject in one clip by one source, at its known frames.

    ``states`` (n,) are codes of targets' names, the same in a whole run; ``positions`` (n,) count the clip's frames.
    ``rate_hz`` is NaN if it is not known. ``stride`` is the usual step between known frames: labels may be sparser than
    frames.
    """

    clip: str
    subject: str
    source: str
    states: Codes
    positions: Codes
    rate_hz: float
    stride: float

    @property
    def frame_s(self) -> float:
        """Seconds that a known frame stands for."""
        return self.stride / self.rate_hz

    def units(self) -> Codes:
        """The independent units of intervals: the look of each known frame, short ones joined (n,)."""
        return number_looks(self.states, self.positions, None if math.isnan(self.rate_hz) else self.rate_hz)

    def looks(self) -> list[Look]:
        """The looks, in order."""
        return self.runs(self.states)

    def runs(self, states: Codes) -> list[Look]:
        """Longest runs of one state (n,) of the known frames. Unknown time as short as a blink does not end a run."""
        if len(states) == 0:
            return []
        breaks = np.flatnonzero((np.diff(states) != 0) | (np.diff(self.positions) > self._longest_step())) + 1
        first, last = np.concatenate(([0], breaks)), np.concatenate((breaks, [len(states)])) - 1
        places = self.positions
        return [
            Look(*each)
            for each in zip(states[first].tolist(), places[first].tolist(), places[last].tolist(), strict=True)
        ]

    def length_s(self, look: Look) -> float:
        """Duration of a look in seconds."""
        return (look.last - look.first + self.stride) / self.rate_hz

    def follows(self, before: Look, after: Look) -> bool:
        """Whether a look begins at once after another one, or after a gap as short as a blink."""
        return after.first - before.last <= self._longest_step()

    def _longest_step(self) -> float:
        gap = 0.0 if math.isnan(self.rate_hz) else LONGEST_GAP_S * self.rate_hz
        return max(1.5 * self.stride, self.stride + gap)

    def at(self, keep: Codes) -> TargetSequence:
        """Return the sequence at some of its frames."""
        positions = self.positions[keep]
        return replace(self, states=self.states[keep], positions=positions, stride=_stride(positions))


def read_sequences(outcomes: Iterable[Outcomes], codes: dict[str, int]) -> list[TargetSequence]:
    """The sequences of a run, without those that know no frame; the labels' come before the configurations'.

    ``codes`` gets a code for each new target name.
    """
    found: dict[tuple[str, str], list[TargetSequence]] = {}
    for each in outcomes:
        sources = found.setdefault((each.clip, each.subject), [])
        if not sources:
            sources.append(_sequence(each, TRUTH, [_truth(verdict) for verdict in each.verdicts], codes))
        sources.append(_sequence(each, each.configuration, [_answer(verdict) for verdict in each.verdicts], codes))
    return [each for sources in found.values() for each in sources if len(each.states)]


def _sequence(outcomes: Outcomes, source: str, targets: list[str | None], codes: dict[str, int]) -> TargetSequence:
    states = [None if target is None else codes.setdefault(target, len(codes)) for target in targets]
    known = np.array([state is not None for state in states], dtype=np.bool_)
    positions = outcomes.all_positions[known]
    return TargetSequence(
        clip=outcomes.clip,
        subject=outcomes.subject,
        source=source,
        states=np.array([state for state in states if state is not None], dtype=np.intp),
        positions=positions,
        rate_hz=outcomes.rate_hz or math.nan,
        stride=_stride(positions),
    )


def _stride(positions: Codes) -> float:
    return float(np.median(np.diff(positions))) if len(positions) > 1 else 1.0


def _truth(verdict: Verdict) -> str | None:
    return None if verdict.truth == IGNORED else verdict.truth


def _answer(verdict: Verdict) -> str | None:
    if verdict.truth == IGNORED:
        return None
    return NOWHERE if verdict.predicted == NO_HIT else verdict.predicted
