"""The columns of a table of labels, by the names that people and programs give them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from harness.files.dialects import plain_name
from vfoa.errors import VfoaError

COLUMNS: Mapping[str, tuple[str, ...]] = {
    "subject": ("subject", "person", "who", "participant", "participant_name"),
    "target": ("target", "object", "what", "looks_at", "label", "aoi", "aoi_name", "gaze_target", "vfoa", "trial_type"),
    "note": ("note", "notes", "comment", "comments"),
    "frame": ("frame", "frame_number", "frame_index"),
    "first_frame": ("first_frame", "start_frame", "frame_start"),
    "last_frame": ("last_frame", "end_frame", "frame_end"),
    "start_s": (
        *("start_s", "start", "start_time", "start_time_s", "start_sec"),
        *("begin", "begin_time", "onset", "onset_s"),
    ),
    "end_s": ("end_s", "end", "end_time", "stop", "stop_time", "end_time_s", "end_sec", "offset", "offset_s"),
    "duration_s": ("duration_s", "duration", "duration_sec"),
    "start_ms": ("start_ms", "start_time_ms", "begin_ms", "onset_ms"),
    "end_ms": ("end_ms", "end_time_ms", "stop_ms", "offset_ms"),
    "duration_ms": ("duration_ms",),
    "start_ns": ("start_ns", "start_timestamp_ns", "start_time_ns"),
    "end_ns": ("end_ns", "end_timestamp_ns", "end_time_ns"),
    "time_s": ("time_s", "time", "time_sec", "timestamp", "timestamp_s"),
    "time_ms": ("time_ms", "timestamp_ms", "recording_timestamp_ms"),
    "time_us": ("time_us", "timestamp_us", "recording_timestamp_us"),
    "time_ns": ("time_ns", "timestamp_ns", "stamp_ns"),
}
"""The names of each column, as :func:`plain_name` has them."""
FURTHER_COLUMNS: Mapping[str, tuple[str, ...]] = {
    "subject": ("person_id", "person_name", "subject_id", "subject_name", "participant_id"),
    "target": (
        *("looking_at", "look_at", "gaze_at", "attention_target", "look_target", "gaze_label"),
        *("target_name", "object_name"),
    ),
    "frame": ("frame_idx", "frame_id", "frame_no", "frame_num", "frame_nr"),
    "start_s": (
        *("start_timestamp", "start_seconds", "start_time_sec", "t_start", "time_start"),
        *("onset_sec", "onset_time"),
    ),
    "end_s": (
        *("end_timestamp", "end_seconds", "end_time_sec", "t_end", "time_end", "finish"),
        *("offset_sec", "offset_time"),
    ),
    "duration_s": ("duration_seconds",),
    "time_s": ("timestamp_sec", "timestamp_seconds", "time_seconds", "seconds", "t"),
}
"""Names that count where no column has one of the others."""


def known_columns(header: Sequence[str], where: str) -> tuple[dict[str, int], list[str]]:
    """The position of each known column, and the names of the others."""
    found, left_out = dict[str, int](), list[str]()
    for at, (name, column) in enumerate(zip(header, meant_by(header), strict=True)):
        if column is None:
            left_out.append(name)
        elif column in found:
            raise VfoaError(f"{where}: {header[found[column]]} and {name} both are {column}; expected one of them")
        else:
            found[column] = at
    if "target" not in found:
        raise VfoaError(
            f"{where}: found {', '.join(header)[:120]}; expected a column of targets ({', '.join(COLUMNS['target'])}), "
            "or one for each person, or object of 0 and 1 (--rename COLUMN=NAME)"
        )
    return found, left_out


def meant_by(header: Sequence[str]) -> list[str | None]:
    """The column that is meant by each name; None for any other."""
    meant = [_column(name, COLUMNS) for name in header]
    for at, name in enumerate(header):
        if meant[at] is None and (column := _column(name, FURTHER_COLUMNS)) not in meant:
            meant[at] = column
    return meant


def _column(name: str, columns: Mapping[str, tuple[str, ...]]) -> str | None:
    return next((column for column, names in columns.items() if plain_name(name) in names), None)
