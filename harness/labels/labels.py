"""Labels: the target of each subject in each frame, as judged by people."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

NOWHERE = "none"
"""The target of a subject who looks at nothing in the scene."""
IGNORED = "ignore"
"""The target of a frame that is not scored."""
RESERVED = (NOWHERE, IGNORED)
UNLABELLED = "not labelled yet"
"""The note of an ``ignore`` for frames that nobody has labelled yet."""
BLOCKED = "blocked"
"""Beginning of a label's note if something stands between the eyes and the target."""
TO_DECIDE = "to decide: "
"""Beginning of the note of an ``ignore`` on which annotators differ, for a person to decide; their answers follow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """The target of a subject: a name of the manifest, ``none`` or ``ignore``; ``point_px``: its image point, if noted.

    ``is_suggested`` marks a program's proposal that no person has confirmed: it is never scored.
    """

    target: str
    note: str = ""
    point_px: tuple[float, float] | None = None
    is_suggested: bool = False

    @property
    def is_placeholder(self) -> bool:
        """Whether it says that nobody has labelled the frame yet."""
        return self.target == IGNORED and self.note == UNLABELLED

    @property
    def is_blocked(self) -> bool:
        """Whether the note's first word says that something stands in the line of sight."""
        return self.note.split(maxsplit=1)[:1] == [BLOCKED]


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelRange:
    """One row: the same label for a subject from ``first_frame`` to ``last_frame``, both included.

    ``span_ns`` are the times [start, end) of a range that was given by time, None for one given by frames.
    """

    first_frame: int
    last_frame: int
    subject: str
    label: Label
    span_ns: tuple[int, int] | None = None


class Labels:
    """All labels of a clip. ``ranges`` are in the order of the file: by first frame, then subject.

    A subject has at most one label in a frame; ``ValueError`` if ranges overlap or end before they begin.
    """

    def __init__(self, ranges: Iterable[LabelRange]) -> None:
        self.ranges = tuple(sorted(ranges, key=lambda each: (each.first_frame, each.subject)))
        self._by_subject: dict[str, list[LabelRange]] = {}
        for each in self.ranges:
            rows = self._by_subject.setdefault(each.subject, [])
            if each.first_frame > each.last_frame or (rows and rows[-1].last_frame >= each.first_frame):
                raise ValueError(f"{each} overlaps with {rows[-1] if rows else 'itself'}")
            rows.append(each)
        self._firsts = {name: [each.first_frame for each in rows] for name, rows in self._by_subject.items()}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Labels) and self.ranges == other.ranges

    def __hash__(self) -> int:
        return hash(self.ranges)

    @property
    def subjects(self) -> tuple[str, ...]:
        """The subjects that have labels, sorted."""
        return tuple(sorted(self._by_subject))

    def of(self, subject: str) -> tuple[LabelRange, ...]:
        """The ranges of one subject, in order."""
        return tuple(self._by_subject.get(subject, ()))

    def at(self, frame: int, subject: str) -> Label | None:
        """The label of a subject in a frame; None if there is none. Takes logarithmic time."""
        position = bisect_right(self._firsts.get(subject, []), frame) - 1
        if position < 0:
            return None
        found = self._by_subject[subject][position]
        return found.label if frame <= found.last_frame else None

    def is_given(self, frame: int, subject: str) -> bool:
        """Whether a subject has a label in a frame; the note that nobody has labelled it yet is none."""
        label = self.at(frame, subject)
        return label is not None and not label.is_placeholder

    def labelled(self, frames: Iterable[int]) -> Iterator[tuple[int, str, Label]]:
        """Every (frame, subject, label) among these frames, in their order, subjects sorted."""
        subjects = self.subjects
        for frame in frames:
            for subject in subjects:
                if (label := self.at(frame, subject)) is not None:
                    yield frame, subject, label

    def confirmed(self) -> Labels:
        """Return the labels to score: suggestions become ``ignore``, so that no run is scored by a run."""
        return Labels(
            replace(each, label=Label(target=IGNORED, note=f"suggested: {each.label.target}"))
            if each.label.is_suggested
            else each
            for each in self.ranges
        )


def is_undecided(target: str, note: str) -> bool:
    """Whether this target and note mark a disagreement that is not decided yet."""
    return target == IGNORED and note.startswith(TO_DECIDE)


def gaps(labels: Labels, subject: str, frames: Sequence[int]) -> Iterator[tuple[int, int]]:
    """First and last frame of every gap between two labels of a subject; ``frames`` are the clip's, ascending."""
    for before, after in pairwise(labels.of(subject)):
        low, high = bisect_right(frames, before.last_frame), bisect_left(frames, after.first_frame)
        if low < high:
            yield frames[low], frames[high - 1]


def ranges_of(subject: str, labels: Iterable[tuple[int, Label | None]]) -> Iterator[LabelRange]:
    """One subject's ranges from its (frame, label) in order: one for each run of equal labels; None ends a run."""
    first = last = 0
    current: Label | None = None
    for frame, label in labels:
        if label != current:
            if current is not None:
                yield LabelRange(first_frame=first, last_frame=last, subject=subject, label=current)
            first, current = frame, label
        last = frame
    if current is not None:
        yield LabelRange(first_frame=first, last_frame=last, subject=subject, label=current)
