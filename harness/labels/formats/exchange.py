"""Mapping of another program's labels to ours: names, frame numbers, times, gaps."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from harness.labels.bodies import Bodies, Box
from harness.labels.formats.names import NameLog
from harness.labels.labels import IGNORED, RESERVED, UNLABELLED, Label, LabelRange, Labels, gaps
from harness.labels.timeline import timeline_of
from harness.sources import Clip, MeasuredClip
from vfoa.errors import VfoaError

_LARGEST = 1e9
"""Largest offset and rate: seconds, frames, or frames per second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Imported:
    """Labels that were read, and a note for everything in the file that they do not hold."""

    labels: Labels
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Exchange:
    """The mapping between the other program's names, frames and times and ours.

    Parameters
    ----------
    clip, subjects, targets
        The clip and the manifest's names.
    fps
        The rate at which the other program shows the clip's frames; None: at the clip's own times.
    offset
        Position of the clip's first frame in the other program: seconds in formats of times, frames in formats of
        frames.
    renamed
        The other program's name -> ours; ``SUBJECT:NAME`` -> ours for targets of one subject.
    gaps
        Meaning of frames without a label between two labels of a subject.
    bodies
        Positions of heads and targets, for formats of boxes and points.
    unnamed
        The fallback target: that of a point on nothing with a name; None: ``ignore``.
    attribute
        In CVAT: the attribute that holds the target.
    observation
        In BORIS: the observation to read, if a file has several.
    """

    clip: Clip | MeasuredClip
    subjects: Collection[str]
    targets: Collection[str]
    fps: float | None = None
    offset: float = 0.0
    renamed: Mapping[str, str] = field(default_factory=dict)
    gaps: Literal["ignore", "none"] = "ignore"
    bodies: Bodies | None = None
    unnamed: str | None = None
    attribute: str = "target"
    observation: str | None = None

    def __post_init__(self) -> None:
        for option, value in (("--fps", self.fps), ("--offset", self.offset)):
            if value is not None and not abs(value) <= _LARGEST:
                raise VfoaError(f"{option}: found {value:g}; expected a number within {_LARGEST:g}")

    @cached_property
    def names(self) -> NameLog:
        """The names found while a file is read."""
        return NameLog(renamed=self.renamed)

    @cached_property
    def frames(self) -> Sequence[int]:
        """The clip's frame numbers, by position; position 0 is its first frame."""
        return tuple(self.clip.frames)

    @cached_property
    def times_ms(self) -> list[int]:
        """Time of each frame in the other program, to the millisecond of its formats.

        Raises
        ------
        VfoaError
            If neither the clip nor ``fps`` gives the frame rate.
        """
        if self.fps is None and self.clip.rate_hz is None:
            raise VfoaError("--fps: the clip does not know its rate, and this format holds times; expected --fps RATE")
        offset_ns = round(self.offset * 1e9)
        if self.fps is not None:
            times_ns = [round(position * 1e9 / self.fps) for position in range(len(self.frames))]
        else:
            own = timeline_of(self.clip).times_ns
            times_ns = [time - own[0] for time in own]
        return [(time + offset_ns + 500_000) // 1_000_000 for time in times_ns]

    @property
    def step_ms(self) -> int:
        """Duration of the last frame, ms."""
        steps = np.diff(self.times_ms)
        return max(1, round(float(np.median(steps)))) if len(steps) else 1000

    @cached_property
    def first_number(self) -> int:
        """The number of the clip's first frame in a format of frames that counts from 0.

        Raises
        ------
        VfoaError
            If ``fps`` is given, which has no meaning here, or the offset is no whole number.
        """
        if self.fps is not None:
            raise VfoaError("--fps: this format holds frame numbers, not times; expected only --offset, in frames")
        if self.offset != int(self.offset):
            raise VfoaError(f"--offset: found {self.offset:g}; expected whole frames: this format holds frame numbers")
        return int(self.offset)

    @cached_property
    def image_box(self) -> Box:
        """The whole left image, pixels.

        Raises
        ------
        VfoaError
            If the clip has no images.
        """
        if isinstance(self.clip, MeasuredClip):
            raise VfoaError("this format holds points in images, and the clip has none; expected another --format")
        rig = self.clip.frame(self.frames[0]).rig
        return 0.0, 0.0, float(rig.width_px), float(rig.height_px)

    def head_box(self, frame: int, subject: str) -> Box | None:
        """The box of a subject's head, pixels; None if it is not known."""
        return self.bodies.head_box(frame, subject) if self.bodies else None

    def positions(self, row: LabelRange) -> range:
        """The positions of a range's frames in the clip."""
        return range(bisect_left(self.frames, row.first_frame), bisect_right(self.frames, row.last_frame))

    def subject(self, name: str, where: str) -> str:
        """Our name of a subject; :meth:`labels` raises for all unknown names, each with its first ``where``."""
        return self.names.expect(name, self.subjects, "subject", where)

    def target(self, name: str, subject: str, where: str) -> str:
        """Our name of a subject's target, as :meth:`subject`; :class:`VfoaError` if it is the subject itself."""
        found = self.names.expect(name, {*self.targets, *self.subjects, *RESERVED}, "target", where, subject)
        if found == subject:
            raise VfoaError(f"{where}: {subject!r} looks at {subject!r}; expected another target, or none")
        return found

    def labels(self, rows: Iterable[LabelRange], path: object) -> Imported:
        """Return labels with filled gaps, with notes: the number of filled frames, renames that matched nothing.

        Raises
        ------
        VfoaError
            For unknown names.
        """
        rows = list(rows)  # the rows may be read from the file only now
        notes = list(self.names.check(path))
        labels, filled = Labels(rows), []
        label = Label(target=self.gaps, note=UNLABELLED if self.gaps == IGNORED else "")
        for subject in labels.subjects:
            rows = [
                LabelRange(first_frame=first, last_frame=last, subject=subject, label=label)
                for first, last in gaps(labels, subject, self.frames)
            ]
            if rows:
                frames = sum(len(self.positions(row)) for row in rows)
                notes.append(f"{path}: {subject}: {frames} frames between labels have none: {self.gaps!r}.")
            filled += rows
        return Imported(labels=Labels([*labels.ranges, *filled]), notes=tuple(notes))


def one_line(text: str | None) -> str:
    """Text for a note: each run of white space and line breaks becomes one space."""
    return " ".join((text or "").split())


def left_out(labels: Labels, what: str, *, notes: bool = False, points: bool = False) -> list[str]:
    """A note for each kind of content of these labels that a format cannot hold."""
    found = [row.label for row in labels.ranges]
    counts = {
        "suggested labels stand in it as if a person had confirmed them": sum(each.is_suggested for each in found),
        "notes are left out": 0 if notes else sum(bool(each.note) for each in found),
        "image points are left out": 0 if points else sum(each.point_px is not None for each in found),
    }
    return [f"{what} cannot hold it: {count} {words}." for words, count in counts.items() if count]
