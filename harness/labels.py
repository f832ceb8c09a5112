"""Labels: what each subject looks at in each frame, as people judged it."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

NOWHERE = "none"
"""The target of a subject who looks at nothing in the scene."""
IGNORED = "ignore"
"""The target of a frame that is not scored."""
RESERVED = (NOWHERE, IGNORED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """What a subject looks at: a name of the manifest, ``none`` or ``ignore``; ``point_px`` where, if it was noted."""

    target: str
    note: str = ""
    point_px: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelRange:
    """One row: the same label for a subject from ``first_frame`` to ``last_frame``, both included."""

    first_frame: int
    last_frame: int
    subject: str
    label: Label


class Labels:
    """All labels of a clip. ``ranges`` are in the order in which they are written: by first frame, then subject."""

    def __init__(self, ranges: Iterable[LabelRange]) -> None:
        self.ranges = tuple(sorted(ranges, key=lambda each: (each.first_frame, each.subject)))
        self._by_subject: dict[str, list[LabelRange]] = {}
        for each in self.ranges:
            self._by_subject.setdefault(each.subject, []).append(each)
        self._firsts = {name: [each.first_frame for each in rows] for name, rows in self._by_subject.items()}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Labels) and self.ranges == other.ranges

    def __hash__(self) -> int:
        return hash(self.ranges)

    @property
    def subjects(self) -> tuple[str, ...]:
        """The subjects that have labels, sorted."""
        return tuple(sorted(self._by_subject))

    def at(self, frame: int, subject: str) -> Label | None:
        """The label of a subject in a frame; None where there is none. Takes logarithmic time."""
        position = bisect_right(self._firsts.get(subject, []), frame) - 1
        if position < 0:
            return None
        found = self._by_subject[subject][position]
        return found.label if frame <= found.last_frame else None

    def labelled(self, frames: Iterable[int]) -> Iterator[tuple[int, str, Label]]:
        """Every (frame, subject, label) among these frames, in their order, subjects sorted."""
        for frame in frames:
            for subject in self.subjects:
                if (label := self.at(frame, subject)) is not None:
                    yield frame, subject, label
