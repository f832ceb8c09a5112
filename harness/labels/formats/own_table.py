"""A table of one's own, of a spreadsheet or a script: a row for each look, or for each frame.

Its columns are found by their names (:mod:`harness.labels.formats.table_columns`), in any order, case and dialect of
CSV (:mod:`harness.files.dialects`); others are left out, with a note. A row holds from ``start`` up to ``end``, or for
a ``duration``, in seconds, milliseconds or ``h:mm:ss``; or from ``first_frame`` to ``last_frame``, both included; or in
one frame, which is that of the number ``frame``, or in the name of an ``image``, or nearest to ``time_s``, ``time_ms``,
``time_us`` or ``time_ns``; of several such rows, a frame takes the nearest. Nanoseconds, and times since 1970 in any
unit or as dates, are of the clip's own clock, if no offset is given. If asked for (:attr:`Exchange.until_next`), a row
holds from its time or frame until the next row of its subject.

In place of ``subject`` and ``target`` there may be a column named after each subject, with the subject's targets; in
place of ``target``, a column named after each target, with 1 where it is looked at and else 0. What eye trackers export
of areas of interest is made such a table first (:mod:`harness.labels.formats.eye_trackers`).
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from harness.files.dialects import Row, check_width, is_missing, plain_name, table_rows
from harness.labels.formats.exchange import (
    MS,
    Exchange,
    Imported,
    ReadOnly,
    file_name,
    in_ms,
    rounded_ms,
)
from harness.labels.formats.eye_trackers import area_of, check_no_recording, of_eye_tracker, with_target
from harness.labels.formats.spans import Span, from_spans, without
from harness.labels.formats.table_columns import known_columns, meant_by
from harness.labels.formats.table_images import check_images, with_frames_of_images
from harness.labels.formats.table_times import (
    MS_PER_UNIT,
    UNITS,
    Cells,
    check_milliseconds,
    check_minutes,
    check_unit,
    clock_notes,
    on_own_clock,
    time_ms_of,
    to_last_pictures,
    until_next,
    whole_of,
    without_times,
)
from harness.labels.labels import NOWHERE, Label, LabelRange, Timeline, ranges_of
from harness.labels.rows import check_ends, check_sequence, check_text
from vfoa.errors import VfoaError, check_known, counted, listed

_PLACES = (
    *(("start_s", "end_s"), ("start_ms", "end_ms"), ("start_ns", "end_ns"), ("first_frame", "last_frame")),
    *(("start_s", "duration_s"), ("start_ms", "duration_ms"), ("time_s", "duration_s"), ("time_ms", "duration_ms")),
    *(("frame",), ("time_s",), ("time_ms",), ("time_us",), ("time_ns",)),
)
"""The columns that say where a row holds; a table has those of one kind. A duration beside an end is not read."""
_MOMENTS, _DURATIONS = ("time_s", "time_ms", "time_us", "time_ns"), ("duration_s", "duration_ms")
_ENDS = tuple(dict.fromkeys(place[-1] for place in _PLACES if len(place) > 1))
_ONSETS = tuple(dict.fromkeys(place[:1] for place in _PLACES))
"""Those that say where a row ends, and from where on it holds."""
_SPARSE = 2
"""Frames for each row, from the first one to the last one, from which a table may be one of onsets."""


class OwnTable(ReadOnly):
    """Reads such a table."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read labels. Without a column of subjects they are those of the clip's only one."""
        check_no_recording(path)
        rows = _of_recording(of_eye_tracker(even_rows(path), path), exchange, path)
        exchange = on_own_clock(rows, meant_by(rows[0][1]), exchange)
        rows, notes = with_frames_of_images(rows, meant_by(rows[0][1]), exchange, path)
        check_images(rows, meant_by(rows[0][1]), exchange, path)
        imported = from_rows(_by_target(_by_subject(rows, exchange), exchange, path), exchange, path)
        return replace(imported, notes=(*notes, *imported.notes))


def from_rows(rows: Sequence[Row], exchange: Exchange, path: Path) -> Imported:
    """Return the labels of a header and rows with one subject and one target each; ``path`` opens the messages.

    Raises
    ------
    VfoaError
        If columns are missing, or a cell is wrong: with its line.
    """
    lines = rows[1:]
    found = _columns(rows, exchange, path)
    given = [_row(cells, found.columns, f"{path}:{line}") for line, cells in lines]
    with_target = [row for row in given if row[1]["target"] == NOWHERE or not is_missing(row[1]["target"])]
    known = [row for row in with_target if not exchange.names.leaves_out(row[1].get("subject"), row[1]["target"])]
    _check_places(known, found, exchange, path)
    place = found.place
    if exchange.until_next:
        timeline = None if found.is_own else _timeline(place[0], exchange, path)
        known, place = until_next(given, known, place[0], exchange, timeline)
    imported = _labels(known, place, exchange, path)
    held = sum(len(exchange.positions(row)) for row in imported.labels.ranges)
    is_sparse = len(place) == 1 and held >= _SPARSE * max(len(given), 1)
    if is_sparse and found.durations:
        raise VfoaError(
            f"{path}: {place[0]} and {found.durations[0]}: found rows that are frames apart, and a duration of unknown "
            "unit; expected last_frame, or in place of the frame time_s"
        )
    notes = (
        (found.left_out, f"columns that are not read: {', '.join(found.left_out)}."),
        (is_sparse, "a row is read as a label of one frame; --until-next: it holds until the person's next one."),
        (len(with_target) < len(given), f"left out: {counted(len(given) - len(with_target), 'row')} without a target."),
    )
    return replace(imported, notes=(*(f"{path}: {note}" for is_so, note in notes if is_so), *imported.notes))


class _Columns(NamedTuple):
    """The place of each column that is read, and the columns that say where a row holds: those of ``place``.

    ``durations`` are columns beside a moment whose unit is not known, as they are called in the file. ``is_own``: the
    rows have the clip's own frame numbers. ``has_unit``: the name of the column says its unit.
    """

    columns: Mapping[str, int]
    place: tuple[str, ...]
    left_out: Sequence[str]
    durations: Sequence[str]
    is_own: bool
    has_unit: bool


def _columns(rows: Sequence[Row], exchange: Exchange, path: Path) -> _Columns:
    (line, header), *lines = rows
    where = f"{path}:{line}"
    columns, left_out = known_columns(header, where)
    if exchange.until_next:
        columns = _without_ends(columns, lines, where)
    elif columns.keys() & {*_MOMENTS}:
        columns = _without_empty(columns, lines, _DURATIONS)
    columns, times = without_times(columns, lines, exchange, path)
    left_out += [header[at] for at in times]
    place = _place(columns, left_out, where, _ONSETS if exchange.until_next else _PLACES)
    is_own = place[0] in ("frame", "first_frame") and exchange.fps is None
    if is_own and exchange.offset is not None and not times:
        raise VfoaError(
            f"{path}: --offset {exchange.offset:g}: no effect on {place[0]}, the clip's own numbers; expected --fps "
            "RATE with it (numbers of another program, from 0), or no --offset"
        )
    if "subject" not in columns and len(exchange.subjects) != 1:
        raise VfoaError(
            f"{where}: no column of subjects; expected subject, since the clip has "
            f"{', '.join(exchange.subjects) or 'none'}"
        )
    durations = [header[columns[column]] for column in _DURATIONS if column in columns and len(place) == 1]
    has_unit = plain_name(header[columns[place[0]]]).rpartition("_")[2] in UNITS
    return _Columns(columns, place, [*left_out, *durations], durations, is_own, has_unit)


def _check_places(rows: Sequence[Cells], found: _Columns, exchange: Exchange, path: Path) -> None:
    """Reject rows whose times are of another unit, or whose last frames are not included."""
    if not found.has_unit:
        check_unit(rows, found.place, exchange, path)
    check_minutes(rows, found.place, exchange, path)
    if found.place[0] in ("start_ms", "time_ms"):
        check_milliseconds(rows, found.place, exchange, path)
    if found.place == ("first_frame", "last_frame"):
        _check_included(rows)


def _check_included(rows: Sequence[Cells]) -> None:
    """Reject rows that end with the frame with which the next one of their subject begins, and none before it."""
    by_subject = dict[str, list[tuple[int, int, str]]]()
    for where, cells in rows:
        first, last = (whole_of(cells[column], f"{where}: {column}") for column in ("first_frame", "last_frame"))
        by_subject.setdefault(cells.get("subject", ""), []).append((first, last, where))
    pairs = [(subject, *pair) for subject, found in by_subject.items() for pair in pairwise(sorted(found))]
    touching = [(subject, before, after) for subject, before, after in pairs if before[1] == after[0]]
    is_included = any(after[0] in (before[1] + 1, before[0]) or after[0] == after[1] for _, before, after in pairs)
    if touching and not is_included:
        subject, before, after = touching[0]
        raise VfoaError(
            f"{after[2]}: {subject!r} has two labels in frame {after[0]}: a row ends with it ({before[2]}); last_frame "
            "is included: expected it less 1 in each row, if rows end before it"
        )


def _labels(rows: Sequence[Cells], place: Sequence[str], exchange: Exchange, path: Path) -> Imported:
    """The labels of rows that hold where these columns say."""
    if place[0] in _MOMENTS and len(place) == 1:
        return _moments(rows, place[0], exchange, path)
    if place[0] in (*MS_PER_UNIT, "start_ns") or exchange.fps is not None:
        return _spans(rows, place, exchange, path)
    return _frames(rows, place, exchange, path)


def even_rows(path: Path) -> Sequence[Row]:
    """The header, which may be empty, and the rows, all as long as it is."""
    rows = table_rows(path) or [(1, [])]
    for line, cells in rows:
        check_width(cells, rows[0][1], f"{path}:{line}")
    return rows


_RECORDING = (
    *("recording_name", "recording_id", "video", "video_name", "video_file", "video_id", "film", "movie"),
    *("clip", "clip_name", "media_file", "observation", "observation_id"),
    *("coder", "coder_id", "annotator", "annotator_id", "rater"),
)
"""Columns that say of which recording a row is, or whose coding: rows of several are not of one clip."""


def _of_recording(rows: Sequence[Row], exchange: Exchange, path: Path) -> Sequence[Row]:
    """The rows of the recording, or coder, that is ``exchange.observation``, or of the clip's film; else all rows.

    Raises
    ------
    VfoaError
        If there is no such recording, or somebody has several, whose times are not of one clip.
    """
    line, header = rows[0]
    places = [at for at, name in enumerate(header) if plain_name(name) in _RECORDING]
    if exchange.observation is not None:
        known = {cells[place]: place for place in places for _, cells in rows[1:] if not is_missing(cells[place])}
        check_known(exchange.observation, known, f"{path}: --observation: no recording")
        rows = _rows_of(rows, known[exchange.observation], [exchange.observation])
    subject = next((at for at, column in enumerate(meant_by(header)) if column == "subject"), None)
    for place in places:
        named = dict.fromkeys(cells[place] for _, cells in rows[1:] if not is_missing(cells[place]))
        if of_films := [name for name in named if file_name(name) in exchange.films]:
            rows = _rows_of(rows, place, of_films)
        pairs = {
            ("" if subject is None else cells[subject], cells[place])
            for _, cells in rows[1:]
            if not is_missing(cells[place])
        }
        if len(pairs) > len({person for person, _ in pairs}):
            raise VfoaError(
                f"{path}:{line}: {header[place]}: found {listed([*map(repr, named)], 8)}, several of one person; "
                "expected --observation NAME, the one of the clip, or no such column"
            )
    return rows


def _rows_of(rows: Sequence[Row], place: int, names: Collection[str]) -> list[Row]:
    """The header, and the rows that have one of these names at a place."""
    return [rows[0], *(row for row in rows[1:] if row[1][place] in names)]


def _by_subject(rows: Sequence[Row], exchange: Exchange) -> Sequence[Row]:
    """Rows with a subject and a target each, of those with a column for each subject; others as they are."""
    (line, header), *lines = rows
    subjects = [place for place, name in enumerate(header) if exchange.names.translate(name) in exchange.subjects]
    if not subjects or {"subject", "target"} & {*meant_by(header)}:
        return rows
    others = [place for place in range(len(header)) if place not in subjects]
    return [
        (line, [*(header[place] for place in others), "subject", "target"]),
        *(
            (number, [*(cells[place] for place in others), header[subject], cells[subject]])
            for subject in subjects
            for number, cells in lines
        ),
    ]


def _by_target(rows: Sequence[Row], exchange: Exchange, path: Path) -> Sequence[Row]:
    """Rows with a target each, of those with a column of 0 and 1 for each target; others as they are."""
    header = rows[0][1]
    if "target" in meant_by(header):
        return rows
    known = {*exchange.targets, *exchange.subjects, ""}
    areas = {place: area for place, name in enumerate(header) if (area := area_of(name))}
    named = {place: name for place, name in enumerate(header) if name and exchange.names.translate(name) in known}
    called = dict(sorted({**named, **areas}.items()))
    return with_target(rows, called, exchange.names, path)


def _row(cells: Sequence[str], columns: Mapping[str, int], where: str) -> Cells:
    """The cells by column. The word ``none`` is a target, however it is written: no program fills it in there."""
    row = {name: cells[at] for name, at in columns.items()}
    return where, {**row, "target": NOWHERE} if row["target"].lower() == NOWHERE else row


def _without_ends(columns: Mapping[str, int], lines: Sequence[Row], where: str) -> dict[str, int]:
    """The columns without those of ends, in which nothing may stand, or 0."""
    columns = _without_empty(columns, lines, _ENDS)
    if found := [column for column in columns if column in _ENDS]:
        raise VfoaError(f"{where}: --until-next: found {found[0]}, where rows end; expected their beginnings alone")
    return columns


def _without_empty(columns: Mapping[str, int], lines: Sequence[Row], names: Sequence[str]) -> dict[str, int]:
    """The columns without those of these names in which nothing stands, or 0."""
    empty = {
        column
        for column in columns.keys() & {*names}
        if all(is_missing(cells[columns[column]].strip("0.,:")) for _, cells in lines)
    }
    return {column: at for column, at in columns.items() if column not in empty}


def _place(
    columns: Mapping[str, int], left_out: Sequence[str], where: str, kinds: Sequence[tuple[str, ...]]
) -> tuple[str, ...]:
    """The columns that say where a row holds; ``left_out`` are those of which it is not known what they say."""
    whole = [place for place in kinds if columns.keys() >= {*place}]
    whole = [place for place in whole if "duration" not in place[-1] or {*whole} <= {place, place[:1]}]
    whole = [place for place in whole if not any(place == other[:1] != other for other in whole)]
    if len(whole) != 1:
        expected = "; ".join(" and ".join(place) for place in kinds)
        found = " and of ".join(" and ".join(place) for place in whole)
        onset = next((name for (name,) in _ONSETS if name in columns and not found), None)
        hint = "" if onset is None else f" (--until-next: {onset} alone, until the person's next row)"
        expected += "; image (the names of the clip's images)" if ("frame",) in kinds else ""
        found = found or f"none of them (not known: {listed(left_out, 8) or 'none'})"
        raise VfoaError(
            f"{where}: where a row holds: found {found}; expected the columns of one kind: {expected}{hint}"
        )
    return whole[0]


def _label(cells: Mapping[str, str], where: str, exchange: Exchange) -> tuple[str, Label]:
    """The subject, ours, and the label of a row."""
    check_text(cells.values(), where)
    subject = exchange.subject(cells["subject"], where) if "subject" in cells else next(iter(exchange.subjects))
    return subject, Label(target=exchange.target(cells["target"], subject, where), note=cells.get("note", ""))


def _spans(rows: Sequence[Cells], place: Sequence[str], exchange: Exchange, path: Path) -> Imported:
    """Labels by time: that of the columns, or of frames from 0 at the rate of ``--fps``."""
    spans = []
    for where, cells in rows:
        subject, label = _label(cells, where, exchange)
        ends = [(cells[column], f"{where}: {column}") for column in (place[0], place[-1])]
        if place[0] in MS_PER_UNIT:
            first, last = (time_ms_of(*each, unit_ms=MS_PER_UNIT[place[0]], fps=exchange.fps) for each in ends)
            if place[-1] in _DURATIONS:
                last, where = first + last, f"{where} ({place[-1]} {cells[place[-1]]})"
            start, end = round(first), round(last)
        elif place[0] == "start_ns":
            start, end = (rounded_ms(whole_of(*each, "ns")) for each in ends)
        else:
            numbers = [whole_of(*each) for each in ends]
            start, end = (round(1000 * frame / (exchange.fps or 1.0)) for frame in (numbers[0], numbers[1] + 1))
        spans.append(Span(start_ms=start, end_ms=end, subject=subject, label=label, where=where))
    ends_of_rows = [cells[place[-1]] for _, cells in rows]
    whole, notes = to_last_pictures(spans, ends_of_rows, exchange.fps, path)
    timeline = in_ms(_timeline(place[0], exchange, path))
    ends_ns = [time_ms * MS for span in whole for time_ms in (span.start_ms, span.end_ms)]
    imported = from_spans(whole, exchange, path, shown=timeline)
    return replace(imported, notes=(*clock_notes(ends_ns, timeline, exchange, path), *notes, *imported.notes))


def _timeline(column: str, exchange: Exchange, path: Path) -> Timeline:
    """The frames at the times of a column: nanoseconds are of the clip's own clock, if no offset says another."""
    timeline = exchange.timeline if column.endswith("_ns") and exchange.offset is None else exchange.shown
    if not timeline.times_ns:
        raise VfoaError(f"{path}: {column}: the times of the clip's frames are not known; expected a column of frames")
    return timeline


def _frames(rows: Sequence[Cells], place: Sequence[str], exchange: Exchange, path: Path) -> Imported:
    """Labels by the clip's own frame numbers."""
    ranges = [(where, _range(where, cells, place, exchange)) for where, cells in rows]
    exchange.names.check(path)
    check_sequence(ranges, exchange.timeline, allow_gaps=True)
    found = [row for _, row in ranges if exchange.positions(row)]
    of_frames = found if len(place) > 1 else _joined(found, exchange.frames)
    outside = [where for where, row in ranges if not exchange.positions(row)]  # the clip may lack numbers in between
    return without(outside, exchange.labels(of_frames, path), path)


def _range(where: str, cells: Mapping[str, str], place: Sequence[str], exchange: Exchange) -> LabelRange:
    subject, label = _label(cells, where, exchange)
    first, last = (whole_of(cells[column], f"{where}: {column}") for column in (place[0], place[-1]))
    check_ends(first, last, exchange.timeline, where, " (numbers of another program, from 0: --fps RATE)")
    return LabelRange(first_frame=first, last_frame=last, subject=subject, label=label)


def _joined(rows: Sequence[LabelRange], frames: Sequence[int]) -> Iterator[LabelRange]:
    """Ranges of rows that hold for a frame each."""
    labels: dict[str, dict[int, Label]] = {}
    for row in rows:
        labels.setdefault(row.subject, {})[row.first_frame] = row.label
    for subject, by_frame in labels.items():
        yield from ranges_of(subject, ((frame, by_frame.get(frame)) for frame in frames))


def _moments(rows: Sequence[Cells], column: str, exchange: Exchange, path: Path) -> Imported:
    """Labels of the frames that are nearest to times, by at most half a step; each frame has its nearest row."""
    timeline = _timeline(column, exchange, path)
    outside, moments, within_ns, times_ns = list[str](), list[_Moment](), timeline.step_ns / 2, list[int]()
    for where, cells in rows:
        subject, label = _label(cells, where, exchange)
        place = f"{where}: {column}"
        if column == "time_ns":
            time_ns = whole_of(cells[column], place, "ns")
        else:
            time_ns = round(MS * time_ms_of(cells[column], place, unit_ms=MS_PER_UNIT[column], fps=exchange.fps))
        times_ns.append(time_ns)
        frame, apart_ns = _nearest(time_ns, timeline)
        row = LabelRange(first_frame=frame, last_frame=frame, subject=subject, label=label)
        if apart_ns > within_ns:
            outside.append(where)
        else:
            moments.append(_Moment(apart_ns, time_ns, where, row))
    found = [(moment.where, moment.row) for moment in _nearest_rows(moments)]
    exchange.names.check(path)
    check_sequence(found, exchange.timeline, allow_gaps=True)
    imported = without(outside, exchange.labels(_joined([row for _, row in found], exchange.frames), path), path)
    between = len(moments) - len(found)
    note = f"{path}: {counted(between, 'row')} between frames: each frame has the label of the nearest row."
    notes = (*clock_notes(times_ns, timeline, exchange, path), *imported.notes, *([note] if between else []))
    return replace(imported, notes=notes)


class _Moment(NamedTuple):
    """A row's time and how far it is from that of its frame."""

    apart_ns: int
    time_ns: int
    where: str
    row: LabelRange


def _nearest_rows(moments: Sequence[_Moment]) -> list[_Moment]:
    """Of each subject's frame, those at the time that is nearest to it."""
    nearest = dict[tuple[str, int], tuple[int, int]]()
    for moment in moments:
        key, time = (moment.row.subject, moment.row.first_frame), (moment.apart_ns, moment.time_ns)
        nearest[key] = min(nearest.get(key, time), time)
    return [
        moment
        for moment in moments
        if nearest[moment.row.subject, moment.row.first_frame] == (moment.apart_ns, moment.time_ns)
    ]


def _nearest(time_ns: int, timeline: Timeline) -> tuple[int, int]:
    """The frame nearest to a time, and how far it is from it, ns."""
    after = bisect_left(timeline.times_ns, time_ns)
    near = (place for place in (after - 1, after) if 0 <= place < len(timeline.times_ns))
    apart_ns, place = min((abs(timeline.times_ns[place] - time_ns), place) for place in near)
    return timeline.frames[place], apart_ns
