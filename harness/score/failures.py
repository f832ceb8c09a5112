"""The wrong frames of a run, and the way from one to the next."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from harness.score.score import Scores
from harness.score.verdicts import Verdict

KEYS = "Enter or n: next, p: previous, w: the label is wrong, q: quit"


def failures(scores: Scores, clip: str | None, configuration: str | None) -> list[Verdict]:
    """The wrong verdicts, all of one recording together and there by frame; None: of every clip, configuration."""
    wrong = [
        verdict
        for verdict in scores.verdicts
        if verdict.outcome == "wrong"
        and clip in (None, verdict.clip)
        and configuration in (None, verdict.configuration)
    ]
    clips, configurations = scores.clips.index, scores.configurations.index
    return sorted(wrong, key=lambda each: (clips(each.clip), configurations(each.configuration), each.frame))


def walk(count: int, keys: Iterable[str], start: int = 0) -> Iterator[int]:
    """The places, 0 to ``count`` - 1, that somebody who starts at ``start`` and presses these keys sees.

    ``n`` or nothing is the next, ``p`` the one before, ``q`` the end; every other key stays. Beyond either end there is
    no step: it stays there, and says so by giving that place again.
    """
    place = min(start, count - 1)
    yield place
    for key in keys:
        match key.strip().lower():
            case "q":
                return
            case "" | "n":
                place = min(place + 1, count - 1)
            case "p":
                place = max(place - 1, 0)
        yield place


def describe(wrong: Sequence[Verdict], place: int) -> str:
    """One line: which of them it is, where, the subject, truth, prediction, and error type."""
    each = wrong[place]
    where = f"{each.clip}, {each.configuration}, frame {each.frame}"
    predicted = "no prediction" if each.predicted is None else f"predicted {each.predicted}"
    return f"{place + 1}/{len(wrong)}  {where}: {each.subject} looks at {each.truth}, {predicted} ({each.error_type})"
