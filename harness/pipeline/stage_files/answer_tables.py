"""Tables of another system's answers: who looks at what, by names.

frame,subject,target[,instance_id][,p_NAME...]
time_s,subject,target[,instance_id][,p_NAME...]
frame,subject,u_px,v_px[,in_image]

CSV in any dialect, or Parquet. A row is one person in one frame. ``target`` is a name of the manifest (a target or a
subject), ``none`` for "looks at nothing", blank for no answer (a frame without a row has none either), or ``no_hit`` of
a method that cannot say "nothing" and hit nothing, such as cones: right if the label is ``none``, and no answer.
``instance_id`` says which one it is where things share a name; default: the first. ``p_NAME`` are probabilities of
targets, ``p_none`` that of nothing, which without a column has the rest up to 1; a blank cell is 0. With
probabilities a blank target is the likeliest one. A thing that the manifest does not name is ``label#id``, as vfoa's
own tables call it.

``u_px, v_px`` is the point of the left image that the person looks at, as gaze-following networks say it.
``in_image`` 0 is ``none``; a row without a point is no answer.

The file of Idiap's tracker holds the answers of its own model (:mod:`harness.sources.measured.idiap`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.clips.naming import is_automatic
from harness.files.safe_names import composed
from harness.files.tables import TableColumns, read_columns
from harness.labels.labels import NOWHERE
from harness.pipeline.stage_files.heads import frame_numbers
from harness.sources.measured.idiap import answers_of_idiap, is_tracker_output
from harness.sources.media.frame_times import SINCE_1970_NS
from vfoa.errors import VfoaError, did_you_mean
from vfoa.scoring import SUM_TOLERANCE
from vfoa.types import NoAttention

KEYS = ("frame", "time_s")
"""Columns that say which frame a row is of; a table has one of them."""
NAMED = ("target", "instance_id")
POINT = ("u_px", "v_px")
NO_HIT = NoAttention.NO_HIT.value
"""The target of a person for whom a method hit nothing that cannot say "looks at nothing"."""
CHANCE = "p_"
"""How the name of a column of probabilities begins."""

_MANY_POINTS = 20
"""Points that are not all in one corner of the image."""
_IN_IMAGE = {"": False, "1": False, "true": False, "1.0": False, "0": True, "false": True, "0.0": True}
"""Cells of ``in_image``, and whether they say that the point is outside."""
_TOLERANCE = 1e-3
"""By how much the rounding of a time may exceed half a frame, as a share of that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One person's answer in a frame: a name, :data:`NOWHERE` or :data:`NO_HIT`; ``instance_id``: which one of a name.

    ``chances`` are the probabilities of names above 0; empty where the system gives none. ``point_px`` (u, v) is the
    point looked at, in place of a name.
    """

    target: str = NOWHERE
    instance_id: int | None = None
    chances: Mapping[str, float] = field(default_factory=dict)
    point_px: tuple[float, float] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all that it speaks of."""
        return tuple(name for name in (self.target, *self.chances) if name not in (NOWHERE, NO_HIT))


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """The answers of a table by frame and subject; whether it has probabilities, and whether it has points.

    ``most_px`` is the greatest coordinate of its points, of many. ``own_begin_s`` is the time of the clip's first frame
    where the table's times, which count from there, could as well be of the clip's own clock.
    """

    probabilistic: bool
    has_points: bool
    most_px: float | None
    own_begin_s: float | None
    by_frame: Mapping[int, Mapping[str, Answer]]


def read_answers(
    path: Path,
    frames: Sequence[int],
    times_ns: Sequence[int],
    names: Sequence[str],
    people: Sequence[str],
    *,
    frame_offset: int = 0,
) -> Answers:
    """Read the answers of a clip.

    Parameters
    ----------
    frames, times_ns
        The clip's frame numbers in ascending order, and their times in ns.
    names, people
        The manifest's names of all targets, and of the subjects, who are targets, too.
    frame_offset
        Added to the table's frame numbers.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line: a column or a name that is unknown, a frame that the clip does not
        have, two rows of one person in one frame, probabilities that do not add up.
    """
    columns = _read(path)
    table = _CheckedTable(columns, tuple(names), tuple(people))
    by_frame: dict[int, dict[str, Answer]] = {}
    keys = [(frame, table.subject(row)) for row, frame in enumerate(_frames(table, frames, times_ns, frame_offset))]
    columns.refuse_repeated(f"frame {frame}, subject {subject!r}" for frame, subject in keys)
    for row, (frame, subject) in enumerate(keys):
        if (answer := table.answer(row, subject)) is not None:
            by_frame.setdefault(frame, {})[subject] = answer
    points = [answer.point_px for people in by_frame.values() for answer in people.values() if answer.point_px]
    return Answers(
        probabilistic=bool(table.chances),
        has_points=table.has_points,
        most_px=max(map(max, points)) if len(points) >= _MANY_POINTS else None,
        own_begin_s=_own_begin_s(columns, times_ns) if "time_s" in columns.cells else None,
        by_frame=by_frame,
    )


def _own_begin_s(columns: TableColumns, times_ns: Sequence[int]) -> float | None:
    """When the clip begins on its own clock, if all times of a table are on frames by this clock, too; else None."""
    times_s, wanted = np.array(times_ns, np.int64) / 1e9, columns.numbers("time_s")
    half_s = float(np.median(np.diff(times_s))) / 2
    is_inside = wanted.size and times_s[0] - half_s < wanted.min() and wanted.max() < times_s[-1] + half_s
    return float(times_s[0]) if is_inside and half_s < times_s[0] < SINCE_1970_NS / 1e9 else None


def _read(path: Path) -> TableColumns:
    """The columns of a table in any of the formats."""
    if path.suffix == ".parquet":
        return _read_parquet(path)
    if is_tracker_output(path):
        return answers_of_idiap(path)
    return read_columns(path, None, ("subject",), known=(*KEYS, *NAMED, *POINT, "in_image"))


def _read_parquet(path: Path) -> TableColumns:
    """Read the columns of a table in Parquet, its cells as text; its first row has the number 1.

    Raises
    ------
    VfoaError
        If the file is missing or damaged.
    """
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyarrow.parquet import ParquetFile  # type: ignore[import-untyped]

    try:
        with ParquetFile(path) as file:
            table = file.read(use_threads=False)
    except FileNotFoundError:
        raise VfoaError(f"{path}: no such file; expected a table") from None
    except (ValueError, pa.ArrowException, OSError) as error:
        raise VfoaError(f"{path}: damaged: {' '.join(str(error).split())}") from None
    cells = {
        composed(name): tuple(map(_text, column.to_pylist()))
        for name, column in zip(table.column_names, table.columns, strict=True)
    }
    return TableColumns(path=path, lines=tuple(range(1, table.num_rows + 1)), cells=cells)


def _text(value: Any) -> str:
    """A cell; blank for a null and for NaN."""
    return "" if value is None or value != value else composed(str(value))


class _CheckedTable:
    """A table of answers while it is checked."""

    def __init__(self, columns: TableColumns, names: tuple[str, ...], people: tuple[str, ...]) -> None:
        self.columns, self._names, self._people = columns, names, people
        answers = (*names, NOWHERE)
        expected = (*KEYS, "subject", *NAMED, *(CHANCE + name for name in answers), *POINT, "in_image")
        unnamed = tuple(
            column.removeprefix(CHANCE)
            for column in columns.cells
            if column.startswith(CHANCE) and is_automatic(column.removeprefix(CHANCE))
        )
        answers = (*answers, *unnamed)
        for column in columns.cells:
            if column not in expected and column.removeprefix(CHANCE) not in unnamed:
                raise VfoaError(f"{columns.path}:1: no column {column!r} here; {did_you_mean(column, expected)}")
        self.has_points = any(column in columns.cells for column in POINT)
        named = [column for column in columns.cells if column in NAMED or column.startswith(CHANCE)]
        if "subject" not in columns.cells or self.has_points == bool(named):
            found = f"{named[0]} beside points" if named and self.has_points else ",".join(columns.cells)
            raise VfoaError(
                f"{columns.path}:1: found {found}; expected frame,subject,target,... or frame,subject,u_px,v_px,..."
            )
        self._points = columns.group(POINT) if self.has_points else None
        self._out = self._are_out() if self.has_points else ()
        self._check_points()
        self._targets = columns.cells.get("target") or ("",) * len(columns.lines)
        self._numbers = columns.integers_or_none("instance_id")
        given = {name: columns.numbers(CHANCE + name) for name in answers if CHANCE + name in columns.cells}
        self.chances = {name: np.nan_to_num(column) for name, column in given.items()}
        self._has_chances = np.zeros(len(columns.lines), np.bool_)
        for numbers in given.values():
            self._has_chances |= ~np.isnan(numbers)
        self._sums = np.sum([*self.chances.values()], axis=0) if self.chances else None
        self._check_chances()

    def subject(self, row: int) -> str:
        """The person of a row."""
        subject = self.columns.cells["subject"][row]
        if subject not in self._people:
            raise VfoaError(f"{self.columns.where(row)}: subject {subject!r}: {did_you_mean(subject, self._people)}")
        return subject

    def answer(self, row: int, subject: str) -> Answer | None:
        """The answer in a row; None for no answer."""
        if self._points is not None:
            u, v = self._points[row].tolist()
            if self._out[row]:
                return Answer()
            return None if math.isnan(u) else Answer(point_px=(u, v))
        target, where = self._targets[row], self.columns.where(row)
        chances = {name: float(column[row]) for name, column in self.chances.items() if column[row] > 0}
        if self._has_chances[row] and NOWHERE not in self.chances and (rest := 1 - sum(chances.values())) > 0:
            chances[NOWHERE] = rest
        if target == NO_HIT and not chances:
            return Answer(target=NO_HIT)
        if self.chances and not chances:
            if target:
                raise VfoaError(f"{where}: target {target!r}: found no probability; expected those of this row, too")
            return None
        if not target and not chances:
            return None
        target = target or max(chances, key=lambda name: chances[name])
        if target not in (*self._names, NOWHERE) and not is_automatic(target):
            raise VfoaError(f"{where}: target {target!r}: {did_you_mean(target, (*self._names, NOWHERE))}")
        if subject in (target, *chances):
            raise VfoaError(f"{where}: {subject!r} looks at {subject!r}; expected another target")
        return Answer(target=target, instance_id=self._numbers[row], chances=chances)

    def _are_out(self) -> tuple[bool, ...]:
        """Which rows say that the point is not in the image."""
        cells = self.columns.cells.get("in_image", ("",) * len(self.columns.lines))
        for row, cell in enumerate(cells):
            if cell.lower() not in _IN_IMAGE:
                where = self.columns.where(row)
                raise VfoaError(f"{where}: in_image: found {cell!r}; expected 1, 0 or nothing")
        return tuple(_IN_IMAGE[cell.lower()] for cell in cells)

    def _check_points(self) -> None:
        """Reject points that are fractions of the image's size instead of pixels."""
        points = np.zeros((0, 2)) if self._points is None else self._points[~np.isnan(self._points[:, 0])]
        if len(points) > 1 and (points >= 0).all() and (points <= 1).all():
            raise VfoaError(
                f"{self.columns.path}: u_px, v_px: all are from 0 to 1; expected pixels of the left image: multiply by "
                "its width and height"
            )

    def _check_chances(self) -> None:
        for name, column in self.chances.items():
            for row in np.flatnonzero((column < 0) | (column > 1))[:1].tolist():
                where = self.columns.where(row)
                raise VfoaError(f"{where}: {CHANCE}{name}: expected a probability from 0 to 1, found {column[row]:g}")
        if self._sums is None:
            return
        least = 1.0 if NOWHERE in self.chances else 0.0
        wrong = (self._sums > 1 + SUM_TOLERANCE) | ((self._sums < least - SUM_TOLERANCE) & self._has_chances)
        for row in np.flatnonzero(wrong)[:1].tolist():
            names = ", ".join(CHANCE + name for name in self.chances)
            limit = "1" if least else f"at most 1 (the rest is that of {NOWHERE})"
            where, total = self.columns.where(row), self._sums[row]
            raise VfoaError(f"{where}: {names}: the probabilities add up to {total:.4g}; expected {limit}")


def _frames(table: _CheckedTable, frames: Sequence[int], times_ns: Sequence[int], offset: int) -> Iterator[int]:
    """The frame of each row."""
    columns = table.columns
    given = [key for key in KEYS if key in columns.cells]
    if len(given) != 1:
        found = " and ".join(given) or "neither"
        raise VfoaError(f"{columns.path}:1: found {found} of the columns {' and '.join(KEYS)}; expected one of them")
    if given == ["time_s"]:
        numbers = _by_time(columns, frames, times_ns)
    else:
        numbers = frame_numbers(columns, [number - offset for number in frames]) + offset
    outside = np.flatnonzero(~np.isin(numbers, np.array([*frames], np.int64)))
    if len(outside):
        row, first, last = int(outside[0]), frames[0], frames[-1]
        raise VfoaError(
            f"{columns.where(row)}: frame {numbers[row] - offset}: not in the clip, whose frames are {first} to {last}"
            f"{_shift_hint(numbers, first, last, offset)}"
        )
    yield from numbers.tolist()


def _shift_hint(numbers: NDArray[np.int64], first: int, last: int, offset: int) -> str:
    """What to set where all frames of a table are in the clip when they are counted from one more, or one less."""
    for shift in (1, -1):
        if first <= numbers.min() + shift and numbers.max() + shift <= last:
            return f"; if the table counts from {first - shift}, set attention.frame_offset = {offset + shift}"
    return ""


def _by_time(columns: TableColumns, frames: Sequence[int], times_ns: Sequence[int]) -> NDArray[np.int64]:
    """The nearest frame to each time, in seconds from the clip's first frame, or since 1970 as the clip's own times."""
    times_s = (np.array(times_ns, np.int64) - times_ns[0]) / 1e9
    wanted = columns.numbers("time_s")
    if times_ns[0] > SINCE_1970_NS and (wanted[~np.isnan(wanted)] > SINCE_1970_NS / 1e9).all():
        wanted = wanted - times_ns[0] / 1e9
    if len(times_s) < 2 or times_s[-1] <= 0:
        raise VfoaError(f"{columns.path}:1: time_s: the clip's frames have no times; expected the column frame")
    right = np.clip(np.searchsorted(times_s, wanted), 1, len(times_s) - 1)
    nearest = np.where(wanted - times_s[right - 1] <= times_s[right] - wanted, right - 1, right)
    half_s = float(np.median(np.diff(times_s))) / 2
    far = np.isnan(wanted) | (np.abs(wanted - times_s[nearest]) > half_s * (1 + _TOLERANCE))
    for row in np.flatnonzero(far)[:1].tolist():
        raise VfoaError(
            f"{columns.where(row)}: time_s: found {columns.cells['time_s'][row]!r}, no time of a frame; expected "
            f"seconds from the clip's first frame, 0 to {times_s[-1]:.3f}, within {half_s:.3f}, or its stamps"
        )
    return np.array(frames, np.int64)[nearest]
