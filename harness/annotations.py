"""Who looks at what: the CSV files under ``annotations/``, read strictly and written canonically.

    # vfoa annotations 1
    first_frame,last_frame,subject,target,note[,u_px,v_px]

Ranges are inclusive, in the source's own frame numbers. ``annotations/README.md`` tells it to those who label.
"""

from __future__ import annotations

import csv
import io
import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from harness.files import atomic_write, read_bytes
from harness.labels import IGNORED, NOWHERE, RESERVED, Label, LabelRange, Labels
from vfoa.errors import VfoaError, did_you_mean

__all__ = [
    "IGNORED",
    "NOWHERE",
    "RESERVED",
    "VERSION_LINE",
    "Label",
    "LabelRange",
    "Labels",
    "read_annotations",
    "write_annotations",
]

VERSION_LINE = "# vfoa annotations 1"
_COLUMNS = ["first_frame", "last_frame", "subject", "target", "note"]
_POINT_COLUMNS = ["u_px", "v_px"]
_CONTROL = re.compile(r"[\x00-\x1f]")
_FRAME = re.compile(r"-?[0-9]{1,18}")


def read_annotations(
    path: Path, *, frames: Sequence[int] | None, subjects: Iterable[str], targets: Iterable[str]
) -> Labels:
    """Read a clip's annotations.

    Parameters
    ----------
    path
        The file. A byte-order mark and CRLF line ends are read rightly; blank lines are skipped.
    frames
        The clip's frame numbers, ascending; None where the clip cannot be opened, then they are not checked.
    subjects, targets
        The manifest's names. A subject may be looked at, too, but not by itself.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line: another version or header, a wrong number, an unknown name, a
        frame outside the clip, a range that ends before it begins, an overlap, or a gap between the first and the
        last label of a subject.
    """
    subjects = set(subjects)
    names = (subjects, {*targets, *subjects, *RESERVED})
    rows = [(line, _parse_row(row, f"{path}:{line}")) for line, row in _rows(path)]
    for line, row in rows:
        _check_row(row, f"{path}:{line}", frames, *names)
    _check_sequence(path, rows, frames)
    return Labels(row for _, row in rows)


def write_annotations(path: Path, labels: Labels) -> None:
    """Write a clip's annotations, whole or not at all.

    The form is canonical: rows by first frame and subject, UTF-8 without a mark, LF; the point's columns only where a
    label has a point. Reading and writing such a file again gives the same bytes.

    Raises
    ------
    VfoaError
        If a name or note holds a line break or another control character.
    """
    with_points = any(row.label.point_px is not None for row in labels.ranges)
    text = io.StringIO()
    text.write(f"{VERSION_LINE}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS + (_POINT_COLUMNS if with_points else []))
    for row in labels.ranges:
        cells = [row.subject, row.label.target, row.label.note]
        _check_text(cells, str(path))
        point = [_number(each) for each in row.label.point_px or ()] or ["", ""]
        writer.writerow([row.first_frame, row.last_frame, *cells, *(point if with_points else [])])
    atomic_write(path, text.getvalue())


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every row below the header, blank lines left out."""
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise VfoaError(f"{path}:{line}: not UTF-8 text: found byte {error.object[error.start]:#04x}") from None
    version, _, rest = text.partition("\n")
    if version.rstrip("\r") != VERSION_LINE:
        raise VfoaError(f"{path}:1: found {version.rstrip()[:80]!r}; expected {VERSION_LINE!r}")
    reader = csv.reader(io.StringIO(rest, newline=""), strict=True)
    columns: list[str] = []
    try:
        for row in reader:
            line = reader.line_num + 1
            if not columns:
                columns = _check_header(row, f"{path}:{line}")
            elif row:
                if len(row) != len(columns):
                    raise VfoaError(f"{path}:{line}: found {len(row)} cells; expected {len(columns)}, as in the header")
                yield line, row
    except csv.Error as error:
        raise VfoaError(f"{path}:{reader.line_num + 1}: not CSV: {error}") from None
    if not columns:
        raise VfoaError(f"{path}:2: no header; expected {','.join(_COLUMNS)}")


def _check_header(row: list[str], where: str) -> list[str]:
    if row not in (_COLUMNS, _COLUMNS + _POINT_COLUMNS):
        found = ",".join(row)[:120]
        raise VfoaError(f"{where}: header {found!r}; expected {','.join(_COLUMNS)} (and {','.join(_POINT_COLUMNS)})")
    return row


def _parse_row(row: list[str], where: str) -> LabelRange:
    for name, cell in zip(_COLUMNS[:2], row, strict=False):
        if not _FRAME.fullmatch(cell):
            raise VfoaError(f"{where}: {name}: found {cell!r}; expected a frame number")
    _check_text(row, where)
    label = Label(target=row[3], note=row[4], point_px=_parse_point(row[5:], where))
    return LabelRange(first_frame=int(row[0]), last_frame=int(row[1]), subject=row[2], label=label)


def _parse_point(cells: list[str], where: str) -> tuple[float, float] | None:
    if not any(cells):
        return None
    try:
        u, v = (float(cell) for cell in cells)
    except ValueError:
        u = v = math.nan
    if not (math.isfinite(u) and math.isfinite(v)):
        raise VfoaError(f"{where}: u_px,v_px: found {','.join(cells)!r}; expected two numbers, or neither")
    return u, v


def _check_text(cells: Iterable[str], where: str) -> None:
    for cell in cells:
        if _CONTROL.search(cell):
            raise VfoaError(f"{where}: {cell!r} holds a control character; expected one line of text")


def _check_row(
    row: LabelRange, where: str, frames: Sequence[int] | None, subjects: set[str], targets: set[str]
) -> None:
    if row.first_frame > row.last_frame:
        raise VfoaError(f"{where}: first_frame {row.first_frame} comes after last_frame {row.last_frame}")
    if row.subject not in subjects:
        raise VfoaError(f"{where}: unknown subject {row.subject!r}; {did_you_mean(row.subject, subjects)}")
    if row.label.target not in targets:
        raise VfoaError(f"{where}: unknown target {row.label.target!r}; {did_you_mean(row.label.target, targets)}")
    if row.label.target == row.subject:
        raise VfoaError(f"{where}: {row.subject!r} looks at {row.subject!r}; expected another target, or none")
    if frames is None:
        return
    for frame in (row.first_frame, row.last_frame):
        if not frames or not frames[0] <= frame <= frames[-1]:
            clip = f"{frames[0]} to {frames[-1]}" if frames else "none"
            raise VfoaError(f"{where}: frame {frame} is outside the clip; its frames: {clip}")


def _check_sequence(path: Path, rows: list[tuple[int, LabelRange]], frames: Sequence[int] | None) -> None:
    """Refuse overlaps and gaps; frames that the clip does not have need no label."""
    last: dict[str, tuple[int, LabelRange]] = {}
    for line, row in sorted(rows, key=lambda each: (each[1].first_frame, each[0])):
        before_line, before = last.get(row.subject, (0, None))
        last[row.subject] = line, row
        if before is None:
            continue
        if row.first_frame <= before.last_frame:
            later = max(line, before_line)
            raise VfoaError(
                f"{path}:{later}: {row.subject!r} has two labels in frame {row.first_frame}: "
                f"overlaps with line {min(line, before_line)}"
            )
        gap = _missing_between(before.last_frame, row.first_frame, frames)
        if gap is not None:
            raise VfoaError(
                f"{path}:{line}: {row.subject!r} has no label for frames {gap[0]} to {gap[1]}, after line "
                f"{before_line}; expected no gap (target {IGNORED!r}: not scored)"
            )


def _missing_between(last: int, first: int, frames: Sequence[int] | None) -> tuple[int, int] | None:
    """First and last frame strictly between two ranges, None where there is none."""
    if frames is None:
        return (last + 1, first - 1) if first > last + 1 else None
    low, high = bisect_right(frames, last), bisect_left(frames, first)
    return (frames[low], frames[high - 1]) if high > low else None


def _number(value: float) -> str:
    return repr(float(value)).removesuffix(".0")
