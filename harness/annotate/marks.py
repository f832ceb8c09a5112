"""The marks of a clip's frames while it is being labelled, and their conversion to and from the CSV.

Frames are counted by position here: 0 is the clip's first frame, whatever its number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import groupby, islice, pairwise
from typing import Any

from harness.labels.labels import IGNORED, UNLABELLED, Label, LabelRange, Labels, ranges_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark(Label):
    """One frame's label.

    ``carried``: it is carried on from an earlier frame until the next change; it counts only after the frame was seen.
    """

    carried: bool = False


SubjectMarks = list[Mark | None]
"""One subject's marks, one per frame; None: unlabelled."""


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
        values = mark.target, mark.note, mark.point_px, mark.is_suggested, mark.carried
        return [self.first, self.last, *values, *([list(mark.tags)] if mark.tags else [])]

    @classmethod
    def parse(cls, plain: Sequence[Any]) -> Stretch:
        """Parse the output of :meth:`plain`."""
        first, last, *values = plain
        if not values:
            return cls(first=first, last=last, mark=None)
        target, note, point, suggested, carried, *tags = values
        if not (isinstance(target, str) and isinstance(note, str)):
            raise TypeError(f"expected the names of a target and a note, found {target!r} and {note!r}")
        point_px = (float(point[0]), float(point[1])) if point else None
        mark = Mark(
            target=target,
            note=note,
            point_px=point_px,
            is_suggested=suggested,
            carried=carried,
            tags=tuple(map(str, *tags)) if tags else (),
        )
        return cls(first=first, last=last, mark=mark)


def stretches(track: Sequence[Mark | None], first: int, last: int) -> tuple[Stretch, ...]:
    """The part of a track between two positions, both included, as maximal stretches."""
    pairs = enumerate(pairwise(islice(track, first, last + 1)), start=first)
    ends = [at for at, (one, next_one) in pairs if one is not next_one and one != next_one]  # mostly one object
    starts = [first, *(end + 1 for end in ends)]
    return tuple(
        Stretch(first=low, last=high, mark=track[low]) for low, high in zip(starts, [*ends, last], strict=True)
    )


def joined(parts: Iterable[Stretch]) -> list[Stretch]:
    """Stretches that follow each other without a gap as maximal ones."""
    runs = (list(run) for _, run in groupby(parts, key=lambda part: part.mark))
    return [replace(run[0], last=run[-1].last) for run in runs]


def plain_stretches(parts: Iterable[Stretch]) -> list[list[Any]]:
    """Stretches as JSON."""
    return [part.plain() for part in parts]


def looked_at(mark: Mark | None) -> object:
    """What a mark says of the target, without what is noted about it."""
    return mark and (mark.target, mark.is_suggested)


def stretch_at(track: Sequence[Mark | None], at: int, key: Callable[[Mark | None], object]) -> tuple[int, int]:
    """First and last position around ``at`` whose marks have the same key."""
    here = key(track[at])
    first = last = at
    while first > 0 and (track[first - 1] is track[first] or key(track[first - 1]) == here):
        first -= 1
    while last + 1 < len(track) and (track[last + 1] is track[last] or key(track[last + 1]) == here):
        last += 1
    return first, last


def counts(mark: Mark | None, position: int, seen: int) -> bool:
    """Whether a mark is a label by now: a mark carried beyond the last frame that was ``seen`` is not."""
    return mark is not None and (not mark.carried or position <= seen)


def _counted(part: Stretch, seen: int) -> Iterator[Stretch]:
    """A stretch with the marks that are labels by now (:func:`counts`): two, if it was seen in part."""
    if part.mark is None or counts(part.mark, part.last, seen):
        yield part
        return
    if part.first <= seen:
        yield replace(part, last=seen)
    yield Stretch(first=max(part.first, seen + 1), last=part.last, mark=None)


def labelled(part: Stretch, seen: int) -> int:
    """Number of frames of a stretch that a person has labelled."""
    given = (each for each in _counted(part, seen) if each.mark is not None and not each.mark.is_suggested)
    return sum(each.last - each.first + 1 for each in given)


def to_labels(tracks: dict[str, SubjectMarks], seen: dict[str, int], frames: Sequence[int]) -> Labels:
    """The labels for the file. Gaps between labels, which the file does not allow, become ``ignore`` with a note."""
    return Labels(row for subject in tracks for row in _rows(subject, tracks[subject], seen[subject], frames))


def _rows(subject: str, track: SubjectMarks, seen: int, frames: Sequence[int]) -> Iterator[LabelRange]:
    parts = [each for part in stretches(track, 0, len(track) - 1) for each in _counted(part, seen)]
    marked = [place for place, part in enumerate(parts) if part.mark is not None]
    if not marked:
        return iter(())
    between = parts[marked[0] : marked[-1] + 1]
    return ranges_of(subject, ((frames[at], _label(part.mark)) for part in between for at in (part.first, part.last)))


def _label(mark: Mark | None) -> Label:
    if mark is None:
        return Label(target=IGNORED, note=UNLABELLED)
    return Label(**{each.name: getattr(mark, each.name) for each in fields(Label)})


def from_labels(labels: Labels, subject: str, frames: Sequence[int]) -> SubjectMarks:
    """A subject's track from the file."""
    mark_of = cache(_mark)  # one object for all frames of a label
    return [mark_of(labels.at(frame, subject)) for frame in frames]


def _mark(label: Label | None) -> Mark | None:
    if label is None or label.is_placeholder:
        return None
    return Mark(**{each.name: getattr(label, each.name) for each in fields(Label)})
