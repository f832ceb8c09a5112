"""Confusion matrices."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from harness.score.outcomes import answer
from harness.score.verdicts import NO_HIT, Verdict

NO_PREDICTION = "no prediction"

Confusion = Counter[tuple[str, str]]
"""Scored frames by truth and answer."""


def confusions(verdicts: Iterable[Verdict]) -> dict[tuple[str, str], Confusion]:
    """By clip and configuration, in the order of the verdicts."""
    found: dict[tuple[str, str], Confusion] = {}
    for verdict in verdicts:
        if verdict.outcome != "unscored":
            of_pair = found.setdefault((verdict.clip, verdict.configuration), Counter())
            of_pair[str(verdict.truth), answered(verdict)] += 1
    return found


def answered(verdict: Verdict) -> str:
    """The answer for people: a target, "nothing hit" where that is an error, or :data:`NO_PREDICTION`."""
    if verdict.outcome == "wrong" and verdict.predicted == NO_HIT:
        return NO_HIT
    return answer(verdict) or NO_PREDICTION
