"""Agreement of annotators, as tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from harness.labels.labels import Labels
from harness.report.formats import UNKNOWN, Table, number, percent
from harness.score.agreement import Agreement, differences

_NOTE = (
    "Frames that both annotators judged: no ignore, no suggestion. Kappa: Cohen 1960; its interval: 95 %, from "
    "resampled looks of the first annotator, because the frames of a look are not independent; unknown with few "
    "looks. Specific agreement: 2 both / (first + second)."
)


def agreement_table(clip: str, found: Sequence[Agreement]) -> Table:
    """Kappa of every pair of annotators, pooled and by subject."""
    return Table(
        title=f"{clip}: agreement of annotators",
        columns=("First", "Second", "Subject", "n", "Not compared", "Same %", "Kappa", "95 %"),
        words=3,
        rows=tuple(
            (
                *(each.first, each.second, each.subject or "(all)", str(each.n), str(each.skipped)),
                *(percent(each.agreed / each.n if each.n else None), number(each.kappa, 2)),
                UNKNOWN if math.isnan(each.interval.low) else f"{each.interval.low:.2f} to {each.interval.high:.2f}",
            )
            for each in found
        ),
        notes=(_NOTE,),
    )


def targets_table(clip: str, found: Sequence[Agreement]) -> Table:
    """Agreement of every pair of annotators by target, all subjects pooled."""
    return Table(
        title=f"{clip}: agreement by target",
        columns=("First", "Second", "Target", "n first", "n second", "n both", "Specific %", "Kappa"),
        words=3,
        rows=tuple(
            (
                *(pair.first, pair.second, each.target, str(each.first), str(each.second), str(each.both)),
                *(percent(each.share), number(each.kappa, 2)),
            )
            for pair in found
            if pair.subject is None
            for each in pair.by_target()
        ),
    )


def confusion_table(clip: str, pair: Agreement) -> Table:
    """Confusion matrix of two annotators: the first in rows, the second in columns."""
    return Table(
        title=f"{clip}: {pair.first} (rows) and {pair.second} (columns), frames",
        columns=("", *pair.targets),
        words=1,
        rows=tuple(
            (name, *(str(count) for count in counts))
            for name, counts in zip(pair.targets, pair.confusion.tolist(), strict=True)
        ),
    )


def differences_table(
    clip: str, labels: Mapping[str, Labels], pairs: Sequence[Agreement], frames: Sequence[int]
) -> Table:
    """Every range in which two annotators differ."""
    return Table(
        title=f"{clip}: where annotators differ",
        columns=("First", "Second", "Subject", "First says", "Second says", "From frame", "To frame", "Frames"),
        words=5,
        rows=tuple(
            (
                *(pair.first, pair.second, each.subject, each.first, each.second),
                *(str(each.first_frame), str(each.last_frame), str(each.frames)),
            )
            for pair in pairs
            if pair.subject is None
            for each in differences(labels[pair.first], labels[pair.second], frames)
        ),
    )


def agreement_tables(
    clip: str, labels: Mapping[str, Labels], found: Sequence[Agreement], frames: Sequence[int]
) -> dict[str, Table]:
    """Return all tables, by the name of their file."""
    confusions = {
        f"confusion_{pair.first}_{pair.second}": confusion_table(clip, pair) for pair in found if pair.subject is None
    }
    return {
        "agreement": agreement_table(clip, found),
        "agreement_by_target": targets_table(clip, found),
        **confusions,
        "differences": differences_table(clip, labels, found, frames),
    }
