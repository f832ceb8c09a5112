"""The rows of an annotation file: the cells of a row, and conditions between rows."""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from pathlib import Path

from harness.files.tables import INTEGER
from harness.labels.labels import IGNORED, RESERVED, Label, LabelRange, Timeline, format_seconds, parse_seconds
from vfoa.errors import VfoaError, did_you_mean

FRAME_COLUMNS = ("first_frame", "last_frame")
TIME_COLUMNS = ("start_s", "end_s")
WORD_COLUMNS = ("subject", "target", "note")
POINT_COLUMNS = ("u_px", "v_px")
STATE_COLUMN = "state"
SUGGESTED = "suggested"
"""The state of a label that no person has confirmed; confirmed ones have an empty cell."""

_CONTROL = re.compile(r"[\x00-\x1f]")
_LARGEST = 2**63 - 1


class RowReader:
    """Reads the rows below one header; names are the manifest's."""

    def __init__(
        self, columns: Sequence[str], timeline: Timeline | None, subjects: set[str], targets: Iterable[str]
    ) -> None:
        self.in_time = TIME_COLUMNS[0] in columns
        self._width = len(columns)
        self._with_points, self._with_states = POINT_COLUMNS[0] in columns, STATE_COLUMN in columns
        self._timeline = timeline
        self._subjects, self._targets = subjects, {*targets, *subjects, *RESERVED}
        self._labels: dict[tuple[str, ...], Label] = {}

    def read(self, cells: list[str], path: Path, line: int) -> LabelRange | None:
        """Parse one row; None for a range of time in which a partly known clip has no frame.

        Raises
        ------
        VfoaError
            For the first wrong cell.
        """
        if len(cells) != self._width:
            raise VfoaError(f"{path}:{line}: found {len(cells)} cells; expected {self._width}, as in the header")
        ends = self._times(cells, path, line) if self.in_time else self._frames(cells, path, line)
        words = tuple(cells[2:])
        label = self._labels.get(words)
        if label is None:  # long files repeat the same few texts
            label = self._labels[words] = self._label(cells, f"{path}:{line}")
        if ends is None:
            return None
        first, last, span_ns = ends
        return LabelRange(first_frame=first, last_frame=last, subject=cells[2], label=label, span_ns=span_ns)

    def _label(self, cells: list[str], where: str) -> Label:
        check_text(cells, where)
        subject, target, note = cells[2:5]
        if subject not in self._subjects:
            raise VfoaError(f"{where}: unknown subject {subject!r}; {did_you_mean(subject, self._subjects)}")
        if target not in self._targets:
            raise VfoaError(f"{where}: unknown target {target!r}; {did_you_mean(target, self._targets)}")
        if target == subject:
            raise VfoaError(f"{where}: {subject!r} looks at {subject!r}; expected another target, or none")
        return Label(
            target=target,
            note=note,
            point_px=parse_point(cells[5:7], where) if self._with_points else None,
            is_suggested=self._with_states and _state(cells[-1], where),
        )

    def _frames(self, cells: list[str], path: Path, line: int) -> tuple[int, int, None]:
        for name, cell in zip(FRAME_COLUMNS, cells, strict=False):
            if not INTEGER.fullmatch(cell) or abs(int(cell)) > _LARGEST:
                raise VfoaError(f"{path}:{line}: {name}: found {cell[:40]!r}; expected a frame number")
        first, last = int(cells[0]), int(cells[1])
        if first > last:
            raise VfoaError(f"{path}:{line}: first_frame {first} comes after last_frame {last}")
        if self._timeline is not None and self._timeline.is_whole:
            frames = self._timeline.frames
            for frame in (first, last):
                if not frames or not frames[0] <= frame <= frames[-1]:
                    clip = f"{frames[0]} to {frames[-1]}" if frames else "none"
                    raise VfoaError(f"{path}:{line}: frame {frame} is outside the clip; its frames: {clip}")
        return first, last, None

    def _times(self, cells: list[str], path: Path, line: int) -> tuple[int, int, tuple[int, int]] | None:
        times = [parse_seconds(cell) for cell in cells[:2]]
        for name, cell, time in zip(TIME_COLUMNS, cells, times, strict=False):
            if time is None:
                raise VfoaError(f"{path}:{line}: {name}: found {cell[:40]!r}; expected seconds, such as 12.5")
        start_ns, end_ns = (time for time in times if time is not None)
        if start_ns >= end_ns:
            raise VfoaError(f"{path}:{line}: start_s {cells[0]} does not come before end_s {cells[1]}")
        timeline = self._timeline
        assert timeline is not None
        frames = timeline.between(start_ns, end_ns)
        if frames is None and timeline.is_whole:
            clip = " to ".join(format_seconds(timeline.times_ns[end]) for end in (0, -1))
            raise VfoaError(f"{path}:{line}: no frame lies in {cells[0]} to {cells[1]} s; the clip's times: {clip} s")
        return (*frames, (start_ns, end_ns)) if frames else None


def check_text(cells: Iterable[str], where: str) -> None:
    """Reject line breaks and other control characters: a row is one line of text."""
    for cell in cells:
        if not cell.isprintable() and _CONTROL.search(cell):
            raise VfoaError(f"{where}: {cell!r} holds a control character; expected one line of text")


def check_sequence(
    path: Path, rows: Iterable[tuple[int, LabelRange]], timeline: Timeline | None, *, allow_gaps: bool
) -> None:
    """Reject overlaps, and gaps unless allowed; frames that the clip does not have need no label."""
    last: dict[str, tuple[int, LabelRange]] = {}
    for line, row in sorted(rows, key=lambda numbered: (numbered[1].first_frame, numbered[0])):
        before_line, before = last.get(row.subject, (0, None))
        last[row.subject] = line, row
        if before is None:
            continue
        if row.first_frame <= before.last_frame:
            raise VfoaError(
                f"{path}:{max(line, before_line)}: {row.subject!r} has two labels in frame {row.first_frame}: "
                f"overlaps with line {min(line, before_line)}"
            )
        gap = None if allow_gaps else _missing_between(before.last_frame, row.first_frame, timeline)
        if gap is not None:
            raise VfoaError(
                f"{path}:{line}: {row.subject!r} has no label for frames {gap[0]} to {gap[1]}, after line "
                f"{before_line}; expected no gap (target {IGNORED!r}: not scored)"
            )


def _missing_between(last: int, first: int, timeline: Timeline | None) -> tuple[int, int] | None:
    """First and last frame strictly between two ranges, None if there is none."""
    if timeline is None:
        return (last + 1, first - 1) if first > last + 1 else None
    frames = timeline.frames
    low, high = bisect_right(frames, last), bisect_left(frames, first)
    return (frames[low], frames[high - 1]) if high > low else None


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


def _state(cell: str, where: str) -> bool:
    if cell not in ("", SUGGESTED):
        raise VfoaError(f"{where}: {STATE_COLUMN}: found {cell[:40]!r}; expected {SUGGESTED!r}, or nothing")
    return cell == SUGGESTED
