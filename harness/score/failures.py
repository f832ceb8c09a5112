"""The wrong frames of a run, and stepping through them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from harness.score.score import Scores
from harness.score.verdicts import Verdict

KEYS = "Enter or n: next, p: previous, w: the label is wrong, q: quit"


def failures(scores: Scores, clip: str | None, configuration: str | None) -> list[Verdict]:
    """The wrong verdicts, grouped by recording and sorted by frame; None: of every clip, every configuration."""
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
    """Yield the places, 0 to ``count`` - 1, that these keys lead to, beginning with ``start``.

    ``n`` or nothing is the next place, ``p`` the one before, ``q`` the end; every other key stays. At either end, a
    step beyond it yields the same place again.
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
    """One line: position among the wrong frames, clip, configuration, frame, subject, truth, prediction, error type."""
    each = wrong[place]
    where = f"{each.clip}, {each.configuration}, frame {each.frame}"
    predicted = "no prediction" if each.predicted is None else f"predicted {each.predicted}"
    return f"{place + 1}/{len(wrong)}  {where}: {each.subject} looks at {each.truth}, {predicted} ({each.error_type})"
