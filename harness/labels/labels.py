"""Labels: the target of each subject in each frame, as judged by people; the times of a clip's frames."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from harness.files.safe_names import composed
from harness.sources import AnyClip
from vfoa import scoring

NOWHERE = scoring.NOWHERE
"""The target of a subject who looks at nothing in the scene."""
IGNORED = scoring.IGNORED
"""The target of a frame that is not scored."""
RESERVED = (NOWHERE, IGNORED)
UNLABELLED = "not labelled yet"
"""The note of an ``ignore`` for frames that nobody has labelled yet."""
BLOCKED = "blocked"
"""First word of a label's note if an object is between the eyes and the target."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Label:
    """The target of a subject: a name of the manifest, ``none`` or ``ignore``; ``point_px``: its image point, if noted.

    ``tags`` are words that frames are selected by, such as ``occluded``, each once and in order.
    ``is_suggested`` marks a program's proposal that no person has confirmed: it is never scored. Accents of the note
    are in their letters, as in a file that is read.
    """

    target: str
    note: str = ""
    point_px: tuple[float, float] | None = None
    is_suggested: bool = False
    tags: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "note", composed(self.note))

    @property
    def is_placeholder(self) -> bool:
        """Whether it says that nobody has labelled the frame yet."""
        return self.target == IGNORED and self.note == UNLABELLED

    @property
    def is_blocked(self) -> bool:
        """Whether the note says that an object blocks the line of sight."""
        return self.note.split(maxsplit=1)[:1] == [BLOCKED]


_ENDS = ("first_frame", "last_frame")


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
        self.ranges = tuple(sorted(ranges, key=lambda row: (row.first_frame, row.subject)))
        self._by_subject: dict[str, list[LabelRange]] = {}
        for label_range in self.ranges:
            rows = self._by_subject.setdefault(label_range.subject, [])
            if label_range.first_frame > label_range.last_frame or (
                rows and rows[-1].last_frame >= label_range.first_frame
            ):
                raise ValueError(f"{label_range} overlaps with {rows[-1] if rows else 'itself'}")
            rows.append(label_range)
        self._firsts = {name: [row.first_frame for row in rows] for name, rows in self._by_subject.items()}

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
        row = self._by_subject[subject][position]
        return row.label if frame <= row.last_frame else None

    def places(self, subject: str, frames: NDArray[np.int64]) -> NDArray[np.intp]:
        """For each of the frames (n,), the position of the subject's label in :meth:`of`; -1 where there is none."""
        rows = self.of(subject)
        firsts, lasts = (np.array([getattr(row, name) for row in rows], dtype=np.int64) for name in _ENDS)
        places = np.searchsorted(firsts, frames, side="right") - 1
        return np.where(frames <= np.append(lasts, np.iinfo(np.int64).min)[places], places, -1)

    def labelled(self, frames: Iterable[int]) -> Iterator[tuple[int, str, Label]]:
        """Every (frame, subject, label) among these frames, in their order, subjects sorted."""
        subjects = self.subjects
        return (
            (frame, subject, label)
            for frame in frames
            for subject in subjects
            if (label := self.at(frame, subject)) is not None
        )

    @property
    def are_scored(self) -> bool:
        """Whether any label counts: one of a target or of ``none``, not of ``ignore``."""
        return any(row.label.target != IGNORED for row in self.ranges)

    def confirmed(self) -> Labels:
        """Return the labels to score: suggestions become ``ignore``, so that no run is scored by a run."""
        return Labels(
            replace(label_range, label=Label(target=IGNORED, note=f"suggested: {label_range.label.target}"))
            if label_range.label.is_suggested
            else label_range
            for label_range in self.ranges
        )


def missing_between(last: int, first: int, frames: Sequence[int]) -> tuple[int, int] | None:
    """First and last of these frames strictly between two; None if there is none. ``frames`` are ascending."""
    low, high = bisect_right(frames, last), bisect_left(frames, first)
    return (frames[low], frames[high - 1]) if low < high else None


def fill_gaps(labels: Labels, frames: Sequence[int], label: Label) -> Labels:
    """Return labels in which every gap between two labels of a subject has this one."""
    filled = (
        LabelRange(first_frame=gap[0], last_frame=gap[1], subject=subject, label=label)
        for subject in labels.subjects
        for before, after in pairwise(labels.of(subject))
        if (gap := missing_between(before.last_frame, after.first_frame, frames))
    )
    return Labels([*labels.ranges, *filled])


def ranges_of(subject: str, labels: Iterable[tuple[int, Label | None]]) -> Iterator[LabelRange]:
    """One subject's ranges from its (frame, label) in order: one for each run of equal labels; None ends a run."""
    for label, run in groupby(labels, key=itemgetter(1)):
        frames = [frame for frame, _ in run]
        if label is not None:
            yield LabelRange(first_frame=frames[0], last_frame=frames[-1], subject=subject, label=label)


_SECONDS = re.compile(r"(-?)([0-9]{1,10})(?:\.([0-9]{1,9}))?")
_NS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """A clip's frame numbers and their times in ns, both ascending.

    ``times_ns`` is empty if the times are not known. ``is_whole`` is False if only some of the clip's frames are known,
    such as those of a run with a limit.
    """

    frames: Sequence[int]
    times_ns: Sequence[int]
    is_whole: bool = True

    def between(self, start_ns: int, end_ns: int) -> tuple[int, int] | None:
        """First and last frame whose time lies in [start, end); None if there is none."""
        first, stop = bisect_left(self.times_ns, start_ns), bisect_left(self.times_ns, end_ns)
        return (self.frames[first], self.frames[stop - 1]) if first < stop else None

    def span_ns(self, first_frame: int, last_frame: int) -> tuple[int, int]:
        """The times [start, end) of a range of frames: it ends when the next frame begins.

        The last frame of the clip lasts for the median step; that of a part, after which the next one may come sooner,
        for half of the shortest step, at least 1 ms. :meth:`between` gives the range back.
        """
        low, high = bisect_left(self.frames, first_frame), bisect_right(self.frames, last_frame) - 1
        after = bisect_right(self.times_ns, self.times_ns[high])
        if after < len(self.times_ns):
            return self.times_ns[low], self.times_ns[after]
        last_ns = self.step_ns if self.is_whole else max(_NS // 1000, self._shortest_ns // 2)
        return self.times_ns[low], self.times_ns[high] + last_ns

    @property
    def rounding_ns(self) -> int:
        """By how much a time that stands for a frame's may be off: half a millisecond, or half of the shortest step."""
        return min(_NS // 2000, (self._shortest_ns or _NS) // 2)

    @property
    def _shortest_ns(self) -> int:
        """The shortest time between two frames, ns; 0 if there is only one frame."""
        steps = np.diff(np.array(self.times_ns, dtype=np.int64))
        return min(steps[steps > 0].tolist(), default=0)

    @property
    def step_ns(self) -> int:
        """The median time between two frames, ns; one second if there is only one frame."""
        return max(1, round(float(np.median(np.diff(self.times_ns))))) if len(self.times_ns) > 1 else _NS


def timeline_of(clip: AnyClip) -> Timeline:
    """Return a clip's frames and their times; no image is read."""
    return Timeline(frames=clip.frames, times_ns=[clip.time_ns(number) for number in clip.frames])


def parse_seconds(text: str) -> int | None:
    """Parse decimal seconds as ns, exactly (today's time stamps exceed a float's precision); None for other text."""
    match = _SECONDS.fullmatch(text)
    if match is None:
        return None
    sign, whole, fraction = match.groups()
    return (-1 if sign else 1) * (int(whole) * _NS + int((fraction or "").ljust(9, "0")))


def format_seconds(time_ns: int) -> str:
    """Format nanoseconds as decimal seconds, exactly, with as few digits as possible."""
    whole, fraction = divmod(abs(time_ns), _NS)
    return f"{'-' * (time_ns < 0)}{whole}.{fraction:09d}".rstrip("0").rstrip(".")
