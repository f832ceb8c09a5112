"""What a recording holds, to compare two of them: files of equal recordings have other bytes."""

from __future__ import annotations

from pathlib import Path

from rerun.chunk import RrdReader

Values = dict[tuple[str, str, int | None], str]

OF_THE_RUN = ("rerun.controls.RowId", "RecordingInfo:start_time", "made_from")
"""Columns that differ between equal runs: ids of rows, the time at which a file was begun, and digests of inputs."""


def values_of(recording: Path) -> Values:
    """Every value as text (NaN equals NaN), by entity, component or timeline, and frame (None: static)."""
    values: Values = {}
    for chunk in RrdReader(recording).stream():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        frames = batch.column("frame").cast("int64").to_pylist() if "frame" in names else [None] * batch.num_rows
        for name in (name for name in names if name not in OF_THE_RUN):
            rows = zip(frames, batch.column(name), strict=True)
            values |= {(chunk.entity_path, name, frame): repr(value.as_py()) for frame, value in rows if value.is_valid}
    return values
