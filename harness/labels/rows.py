"""The rows of an annotation file: the cells of a row, and conditions between rows."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence

from harness.files.dialects import check_width
from harness.files.tables import whole_number
from harness.labels.labels import (
    IGNORED,
    RESERVED,
    Label,
    LabelRange,
    Timeline,
    format_seconds,
    missing_between,
    parse_seconds,
)
from vfoa.errors import VfoaError, check_known, did_you_mean

FRAME_COLUMNS = ("first_frame", "last_frame")
TIME_COLUMNS = ("start_s", "end_s")
WORD_COLUMNS = ("subject", "target", "note")
POINT_COLUMNS = ("u_px", "v_px")
TAG_COLUMN = "tag"
STATE_COLUMN = "state"
SUGGESTED = "suggested"
"""The state of a label that no person has confirmed; confirmed ones have an empty cell."""

_CONTROL = re.compile(r"[\x00-\x1f\ufffe\uffff]")
"""Characters that would end a row, or that no XML has, so that ELAN could not read them."""


Translation = Callable[[str, str], tuple[str, str] | None]
"""Gives the manifest's names of a row's subject and target; None leaves the row out."""


def as_they_are(subject: str, target: str) -> tuple[str, str]:
    """The translation of a file with the manifest's names."""
    return subject, target


class RowReader:
    """Reads the rows below one header; names are the manifest's, once they are translated."""

    def __init__(
        self,
        columns: Sequence[str],
        timeline: Timeline | None,
        subjects: set[str],
        targets: Iterable[str],
        former: Mapping[str, str],
        translate: Translation,
    ) -> None:
        self._translate = translate
        self.in_time = TIME_COLUMNS[0] in columns
        self._columns = columns
        self._with_points, self._with_states = POINT_COLUMNS[0] in columns, STATE_COLUMN in columns
        self._tag_place = columns.index(TAG_COLUMN) if TAG_COLUMN in columns else None
        self._timeline = timeline
        self._rounding_ns = timeline.rounding_ns if timeline and self.in_time else 0
        self._subjects, self._targets = subjects, {*targets, *subjects, *RESERVED}
        self._former = former

    def read(self, cells: list[str], where: str) -> LabelRange | None:
        """Parse the row at a place (for messages).

        None for one that is left out, and for a range of time in which a partly known clip has no frame.

        Raises
        ------
        VfoaError
            For the first wrong cell.
        """
        check_width(cells, self._columns, where)
        if (names := self._translate(*cells[2:4])) is None:
            return None
        cells = [*cells[:2], *names, *cells[4:]]
        ends = self._times(cells, where) if self.in_time else self._frames(cells, where)
        label = self._label(cells, where)
        if ends is None:
            return None
        first, last, span_ns = ends
        return LabelRange(first_frame=first, last_frame=last, subject=cells[2], label=label, span_ns=span_ns)

    def _label(self, cells: list[str], where: str) -> Label:
        check_text(cells, where)
        subject, target, note = cells[2:5]
        check_known(subject, self._subjects, f"{where}: unknown subject")
        if target not in self._targets:
            raise VfoaError(f"{where}: unknown target {target!r}; {expected_name(target, self._targets, self._former)}")
        if target == subject:
            raise VfoaError(f"{where}: {subject!r} looks at {subject!r}; expected another target, or none")
        return Label(
            target=target,
            note=note,
            point_px=parse_point(cells[5:7], where) if self._with_points else None,
            is_suggested=self._with_states and _state(cells[-1], where),
            tags=() if self._tag_place is None else parse_tags(cells[self._tag_place], where),
        )

    def _frames(self, cells: list[str], where: str) -> tuple[int, int, None]:
        for name, cell in zip(FRAME_COLUMNS, cells, strict=False):
            if whole_number(cell) is None:
                rounded = (
                    "; a spreadsheet program keeps 15 digits: give start_s and end_s" if "e+" in cell.lower() else ""
                )
                raise VfoaError(f"{where}: {name}: found {cell[:40]!r}; expected a frame number{rounded}")
        first, last = int(cells[0]), int(cells[1])
        check_ends(first, last, self._timeline, where)
        return first, last, None

    def _times(self, cells: list[str], where: str) -> tuple[int, int, tuple[int, int]] | None:
        times = [parse_seconds(cell) for cell in cells[:2]]
        for name, cell, time in zip(TIME_COLUMNS, cells, times, strict=False):
            if time is None:
                raise VfoaError(f"{where}: {name}: found {cell[:40]!r}; expected seconds, such as 12.5")
        start_ns, end_ns = (time for time in times if time is not None)
        if start_ns >= end_ns:
            raise VfoaError(f"{where}: start_s {cells[0]} does not come before end_s {cells[1]}")
        timeline = self._timeline
        assert timeline is not None
        frames = timeline.between(start_ns - self._rounding_ns, end_ns - self._rounding_ns)
        if frames is None and timeline.is_whole:
            clip = " to ".join(format_seconds(timeline.times_ns[end]) for end in (0, -1))
            raise VfoaError(f"{where}: no frame lies in {cells[0]} to {cells[1]} s; the clip's times: {clip} s")
        return (*frames, (start_ns, end_ns)) if frames else None


def expected_name(unknown: str, known: Iterable[str], former: Mapping[str, str]) -> str:
    """What is expected instead of an unknown name; ``former``: present names of renamed targets by earlier name."""
    if unknown in former:
        return f"this target is called {former[unknown]!r} now; expected that name"
    return did_you_mean(unknown, known)


def check_text(cells: Iterable[str], where: str) -> None:
    """Reject line breaks, control characters and noncharacters: a row is one line of text."""
    for cell in cells:
        if not cell.isprintable() and _CONTROL.search(cell):
            raise VfoaError(f"{where}: {cell!r} holds a control character; expected one line of text")


def check_ends(first: int, last: int, timeline: Timeline | None, where: str, hint: str = "") -> None:
    """Reject a range that ends before it begins, or outside of the clip, if all of its frames are known.

    ``hint`` ends the message on a frame outside.
    """
    if first > last:
        raise VfoaError(f"{where}: first_frame {first} comes after last_frame {last}")
    if timeline is None or not timeline.is_whole:
        return
    frames = timeline.frames
    for frame in (first, last):
        if not frames or not frames[0] <= frame <= frames[-1]:
            clip = f"{frames[0]} to {frames[-1]}" if frames else "none"
            raise VfoaError(f"{where}: frame {frame} is outside the clip; its frames: {clip}{hint}")


def check_sequence(rows: Sequence[tuple[str, LabelRange]], timeline: Timeline | None, *, allow_gaps: bool) -> None:
    """Reject overlaps, and gaps unless allowed; frames that the clip does not have need no label.

    Each row is preceded by its place for messages; of two rows, the later one is named first.
    """
    last: dict[str, int] = {}
    for number in sorted(range(len(rows)), key=lambda number: (rows[number][1].first_frame, number)):
        where, row = rows[number]
        before_number = last.get(row.subject)
        last[row.subject] = number
        if before_number is None:
            continue
        before_where, before = rows[before_number]
        if row.first_frame <= before.last_frame:
            earlier, later = sorted((number, before_number))
            raise VfoaError(
                f"{rows[later][0]}: {row.subject!r} has two labels in frame {row.first_frame}: overlaps with "
                f"{rows[earlier][0]}"
            )
        frames = timeline.frames if timeline else range(before.last_frame, row.first_frame + 1)
        if not allow_gaps and (gap := missing_between(before.last_frame, row.first_frame, frames)):
            raise VfoaError(
                f"{where}: {row.subject!r} has no label for frames {gap[0]} to {gap[1]}, after {before_where}; "
                f"expected no gap (target {IGNORED!r}: not scored)"
            )


def parse_point(cells: Sequence[str], where: str) -> tuple[float, float] | None:
    """Parse two finite numbers; None if both cells are empty; :class:`VfoaError` for anything else."""
    if not any(cells):
        return None
    try:
        u, v = (float(cell) for cell in cells)
    except ValueError:
        u = v = math.nan
    if not (math.isfinite(u) and math.isfinite(v)):
        raise VfoaError(f"{where}: u_px,v_px: found {','.join(cells)!r}; expected two numbers, or neither")
    return u, v


def parse_tags(cell: str, where: str) -> tuple[str, ...]:
    """Parse words that are separated by spaces, such as ``far child``; :class:`VfoaError` for anything but words."""
    for tag in cell.split():
        if not re.fullmatch(r"[\w.-]+", tag):
            raise VfoaError(f"{where}: {TAG_COLUMN}: found {tag[:40]!r}; expected words, separated by spaces")
    return tuple(sorted(set(cell.split())))


def _state(cell: str, where: str) -> bool:
    if cell not in ("", SUGGESTED):
        raise VfoaError(f"{where}: {STATE_COLUMN}: found {cell[:40]!r}; expected {SUGGESTED!r}, or nothing")
    return cell == SUGGESTED
