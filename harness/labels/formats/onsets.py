"""Rows of a table that have a beginning alone: each holds until the next one of its person."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from harness.files.dialects import is_missing
from harness.labels.formats.exchange import MS, Exchange
from harness.labels.formats.table_times import MS_PER_UNIT, Cells, time_ms_of, whole_of
from harness.labels.labels import Timeline
from vfoa.errors import VfoaError


def until_next(
    given: Sequence[Cells], known: Sequence[Cells], column: str, exchange: Exchange, timeline: Timeline | None
) -> tuple[list[Cells], tuple[str, str]]:
    """Rows that hold until the next one of their person, the last one until the clip ends; the columns of both ends.

    ``known`` are the given rows that are labels; the others only end the one before. ``timeline`` has the clip's frames
    at the times of the column; None: it has the clip's own frame numbers.

    Raises
    ------
    VfoaError
        If a cell is no time or number, or two targets of a person begin at once.
    """
    is_frames, is_ns = column in ("frame", "first_frame"), column.endswith("_ns")
    place = ("first_frame", "last_frame") if is_frames else ("start_ns", "end_ns") if is_ns else ("start_ms", "end_ms")
    end: float = exchange.frames[-1] + 1
    if timeline is not None:
        _, end_ns = timeline.span_ns(timeline.frames[0], timeline.frames[-1])
        end = math.ceil(end_ns / 1e9 * (exchange.fps or 1.0)) if is_frames else end_ns if is_ns else end_ns / MS
    labels, onsets = {id(row) for row in known}, dict[str, dict[float, list[Cells]]]()
    for row in given:
        where, cells = row
        if id(row) in labels or not is_missing(cells[column]):
            cell = cells[column], f"{where}: {column}"
            onset = whole_of(*cell) if is_frames or is_ns else time_ms_of(*cell, unit_ms=MS_PER_UNIT[column])
            person = exchange.names.translate(cells.get("subject", ""))
            onsets.setdefault(person, {}).setdefault(onset, []).append(row)
    rows = list[Cells]()
    for by_onset in onsets.values():
        states = [(onset, _state([row for row in by_onset[onset] if id(row) in labels])) for onset in sorted(by_onset)]
        changes = [state for before, state in pairwise([(0, None), *states]) if not _are_same(before[1], state[1])]
        for (onset, state), (after, _) in pairwise([*changes, (math.inf, None)]):
            stop = max(onset + is_frames, min(after, end))
            if state is not None:
                ends = dict(zip(place, (_cell(onset), _cell(stop - is_frames)), strict=True))
                rows.append((state[0], {**state[1], **ends}))
    return rows, place


def _state(rows: Sequence[Cells]) -> Cells | None:
    """The only one of the rows of a person that begin at the same time; None if there is none: nothing is known then.

    Raises
    ------
    VfoaError
        If they have several targets.
    """
    for where, cells in rows[1:]:
        if cells["target"] != rows[0][1]["target"]:
            both = f"{rows[0][1]['target']!r} ({rows[0][0]}) and {cells['target']!r}"
            raise VfoaError(f"{where}: {cells.get('subject', '')!r} begins to look at {both} at once; expected one")
    return next(iter(rows), None)


def _are_same(before: Cells | None, after: Cells | None) -> bool:
    """Whether a row goes on with the one before: it has the same target and note."""
    if before is None or after is None:
        return before is after
    return all(before[1].get(column) == after[1].get(column) for column in ("target", "note"))


def _cell(number: float) -> str:
    return str(number) if isinstance(number, int) else f"{number:.3f}"
