"""What the frames of a clip are marked with while it is being labelled, and how that stands in the CSV.

Frames are counted by position here: 0 is the clip's first frame, whatever its number.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from harness.labels import IGNORED, Label, LabelRange, Labels

UNLABELLED = "not labelled yet"
"""The note of an ``ignore`` that stands between labels where nothing was said: the format allows no gaps."""

SUGGESTED = "suggested: "
"""The note of an ``ignore`` for a suggestion nobody has confirmed; the suggested target follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One frame's label. ``suggested``: no person has confirmed it.

    ``carried``: it holds because an earlier frame's label holds until the next change; it counts only once the frame
    was seen.
    """

    target: str
    note: str = ""
    point_px: tuple[float, float] | None = None
    suggested: bool = False
    carried: bool = False


Track = list[Mark | None]
"""One subject's marks, one a frame; None: unlabelled."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """The same mark from position ``first`` to ``last``, both included."""

    first: int
    last: int
    mark: Mark | None

    def plain(self) -> list[Any]:
        """As JSON: first, last, and the mark's values, or nothing more for an unlabelled stretch."""
        if self.mark is None:
            return [self.first, self.last]
        mark = self.mark
        return [self.first, self.last, mark.target, mark.note, mark.point_px, mark.suggested, mark.carried]

    @classmethod
    def parse(cls, plain: Sequence[Any]) -> Stretch:
        """What :meth:`plain` gave."""
        first, last, *values = plain
        if not values:
            return cls(first=first, last=last, mark=None)
        target, note, point, suggested, carried = values
        point_px = (float(point[0]), float(point[1])) if point else None
        mark = Mark(target=target, note=note, point_px=point_px, suggested=suggested, carried=carried)
        return cls(first=first, last=last, mark=mark)


def stretches(track: Sequence[Mark | None], first: int, last: int) -> tuple[Stretch, ...]:
    """The part of a track between two positions, both included, as maximal stretches."""
    found = []
    for mark, positions in groupby(range(first, last + 1), key=lambda position: track[position]):
        run = list(positions)
        found.append(Stretch(first=run[0], last=run[-1], mark=mark))
    return tuple(found)


def stretch_at(track: Sequence[Mark | None], at: int, *, same_target: bool = False) -> tuple[int, int]:
    """First and last position around ``at`` with the same mark (or, if so asked, a mark with the same target)."""

    def key(position: int) -> object:
        mark = track[position]
        return (mark.target, mark.suggested) if same_target and mark else mark

    first = last = at
    while first > 0 and key(first - 1) == key(at):
        first -= 1
    while last + 1 < len(track) and key(last + 1) == key(at):
        last += 1
    return first, last


def counts(mark: Mark | None, position: int, seen: int) -> bool:
    """Whether a mark is a label by now: what is carried past the last frame that was ``seen`` is not."""
    return mark is not None and (not mark.carried or position <= seen)


def to_labels(tracks: dict[str, Track], seen: dict[str, int], frames: Sequence[int]) -> Labels:
    """The labels of the file. What nobody confirmed, and gaps between labels, are ``ignore`` with a note."""
    return Labels(row for subject in tracks for row in _rows(subject, tracks[subject], seen[subject], frames))


def _rows(subject: str, track: Track, seen: int, frames: Sequence[int]) -> Iterator[LabelRange]:
    marked = [position for position, mark in enumerate(track) if counts(mark, position, seen)]
    if not marked:
        return
    labels = [_label(track[at] if counts(track[at], at, seen) else None) for at in range(marked[0], marked[-1] + 1)]
    for label, positions in groupby(range(len(labels)), key=labels.__getitem__):
        run = list(positions)
        first, last = frames[marked[0] + run[0]], frames[marked[0] + run[-1]]
        yield LabelRange(first_frame=first, last_frame=last, subject=subject, label=label)


def _label(mark: Mark | None) -> Label:
    if mark is None:
        return Label(target=IGNORED, note=UNLABELLED)
    if mark.suggested:
        return Label(target=IGNORED, note=f"{SUGGESTED}{mark.target}")
    return Label(target=mark.target, note=mark.note, point_px=mark.point_px)


def from_labels(labels: Labels, subject: str, frames: Sequence[int], targets: Collection[str]) -> Track:
    """A subject's track from the file; ``targets`` are the names that a suggestion may have."""
    return [_mark(labels.at(frame, subject), targets) for frame in frames]


def _mark(label: Label | None, targets: Collection[str]) -> Mark | None:
    if label is None or (label.target == IGNORED and label.note == UNLABELLED):
        return None
    suggested = label.note.removeprefix(SUGGESTED)
    if label.target == IGNORED and suggested != label.note and suggested in targets:
        return Mark(target=suggested, suggested=True)
    return Mark(target=label.target, note=label.note, point_px=label.point_px)
