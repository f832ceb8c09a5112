"""Notes: sentences that are shown with the tables of a run. A note's kind says where else it is shown."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum, auto


class NoteKind(StrEnum):
    """What a note says, in a word that a run's manifest holds."""

    FACT = auto()
    """How clips, settings or scores are."""
    FITTED_ON_REPORTED = auto()
    """Rates are too good: the weights have seen the labels of a clip that is reported."""
    DOUBT = auto()
    """The axes, units, labels or names of a clip are in question."""
    PARTLY_SET = auto()
    """A setting that was given has no effect under some configurations, or under all."""
    UNLABELLED = auto()
    """A clip is not scored."""
    UNFINISHED = auto()
    """The run is not finished, and what is complete is shown."""


WARNINGS = (NoteKind.FITTED_ON_REPORTED, NoteKind.DOUBT, NoteKind.PARTLY_SET)
"""Kinds of notes that stand with the rates on the terminal, too."""


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence or more for readers of a table. ``clip`` is the clip that is not scored, of a note that says so."""

    text: str
    kind: NoteKind = NoteKind.FACT
    clip: str | None = None

    def __str__(self) -> str:
        return self.text


def fitted_on_reported(weights: str, clips: Iterable[str]) -> Note:
    """Return the warning that weights, such as "the weights of my.toml", were fitted on clips that are reported."""
    text = f"FITTED ON WHAT IS REPORTED: {weights} were fitted on {', '.join(clips)}."
    return Note(text, NoteKind.FITTED_ON_REPORTED)


def unlabelled(clip: str, reason: str) -> Note:
    """Return the note that a clip is not scored; ``reason`` follows the clip's name."""
    return Note(f"{clip}: {reason}", NoteKind.UNLABELLED, clip)
