"""Merge several annotators' labels of one clip by a rule."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, get_args

from harness.labels.labels import (
    IGNORED,
    TO_DECIDE,
    UNLABELLED,
    Label,
    LabelRange,
    Labels,
    gaps,
    is_undecided,
    ranges_of,
)

Rule = Literal["agree", "first", "adjudicate"]
RULES: tuple[Rule, ...] = get_args(Rule)

DIFFER = "annotators differ"
_UNLABELLED = Label(target=IGNORED, note=UNLABELLED)


def merge_labels(labels: Mapping[str, Labels], frames: Sequence[int], rule: Rule) -> Labels:
    """Merge labels, annotators in order of precedence.

    Parameters
    ----------
    rule
        ``agree``: a label if all annotators name the same target, else ``ignore``. ``first``: the label of the
        first annotator who has one. ``adjudicate``: as ``agree``, but the note lists the annotators' answers, for a
        person to decide. Note and image point are the first annotator's.

    Unconfirmed suggestions, and frames noted as not labelled yet, are no labels. Gaps between labels become ``ignore``.
    """
    subjects = sorted({subject for each in labels.values() for subject in each.subjects})
    merged = Labels(
        row
        for subject in subjects
        for row in ranges_of(subject, ((frame, _merged(_said(labels, frame, subject), rule)) for frame in frames))
    )
    return Labels([*merged.ranges, *_fillings(merged, frames)])


def to_decide(labels: Labels) -> list[LabelRange]:
    """Return the ranges that a person must decide."""
    return [row for row in labels.ranges if is_undecided(row.label.target, row.label.note)]


def _said(labels: Mapping[str, Labels], frame: int, subject: str) -> dict[str, Label | None]:
    found = {name: each.at(frame, subject) for name, each in labels.items()}
    return {name: label if label and _is_given(label) else None for name, label in found.items()}


def _is_given(label: Label) -> bool:
    return not label.is_suggested and not label.is_placeholder


def _merged(said: Mapping[str, Label | None], rule: Rule) -> Label | None:
    given = [label for label in said.values() if label is not None]
    if not given:
        return None
    if rule == "first" or (len(given) == len(said) and len({label.target for label in given}) == 1):
        return given[0]
    if rule == "agree":
        return Label(target=IGNORED, note=DIFFER)
    words = ", ".join(f"{name} {label.target if label else '-'}" for name, label in said.items())
    return Label(target=IGNORED, note=f"{TO_DECIDE}{words}")


def _fillings(labels: Labels, frames: Sequence[int]) -> Iterator[LabelRange]:
    for subject in labels.subjects:
        for first, last in gaps(labels, subject, frames):
            yield LabelRange(first_frame=first, last_frame=last, subject=subject, label=_UNLABELLED)
