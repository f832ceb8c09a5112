"""What a recording holds, to compare two of them: files of equal recordings have other bytes."""

from __future__ import annotations

from pathlib import Path

from rerun.chunk import RrdReader

Values = dict[tuple[str, str, int | None], object]


def values_of(recording: Path) -> Values:
    """Every value of a recording by entity, component and frame (None: static), without the properties of its run."""
    values: Values = {}
    for chunk in RrdReader(recording).stream():
        if chunk.entity_path.startswith("/__properties"):  # the time at which it was begun
            continue
        batch = chunk.to_record_batch()
        names = batch.schema.names
        frames = batch.column("frame").cast("int64").to_pylist() if "frame" in names else [None] * batch.num_rows
        for name in (name for name in names if ":" in name):
            rows = zip(frames, batch.column(name), strict=True)
            values |= {(chunk.entity_path, name, frame): value.as_py() for frame, value in rows if value.is_valid}
    return values
