"""A few frames of a recording as one small file, for sharing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]
from rerun.chunk import Chunk

from harness.files.io import replacing
from harness.record import entities
from harness.record.blueprint import clip_layout
from harness.record.composed import RecordedClip, content_of
from harness.record.images import key_frame_every
from harness.record.layer_file import write_whole
from harness.record.reading import RecordingFile, has_video
from vfoa.errors import VfoaError


def write_excerpt(clip: RecordedClip, subject: str | None, frame: int, margin: int, excerpt: Path) -> None:
    """Write a frame and ``margin`` neighbours on either side of all layers, with all static data.

    It opens at the frame, in the layout of these frames, with the subject's tab in front. With a video it begins at the
    preceding key frame, since decoding begins there.

    Raises
    ------
    VfoaError
        If a file cannot be read, the clip does not have that frame or subject, or the margin is negative.
    """
    if margin < 0:
        raise VfoaError(f"--margin: expected at least 0 frames, found {margin}")
    recording = clip.compose()
    clip.expect_subject(subject)
    recording.expect_frame(frame)
    place = clip.frames.index(frame)
    first = max(place - margin, 0)
    if clip.files.images.is_file() and has_video(clip.files.images):
        first -= first % key_frame_every(clip.rate_hz)
    inside = clip.frames[first : place + margin + 1]
    ids = RecordingFile(recording.files[0]).ids
    ids = ids._replace(recording=f"{ids.recording}-{frame}")
    shown = replace(content_of([replace(clip, frames=inside)]), opens_at=frame)
    layout = clip_layout(clip.layers, shown, clip.subjects, subject)
    with replacing(excerpt) as draft:
        chunks = _all_cut(recording.files, inside[0], inside[-1])
        write_whole(draft, ids, layout, chunks)


def _all_cut(files: Iterable[Path], first: int, last: int) -> Iterator[Chunk]:
    for file in files:
        yield from _cut(RecordingFile(file).chunks(), first, last)


def _cut(chunks: Iterable[Chunk], first: int, last: int) -> Iterator[Chunk]:
    """Yield the static chunks, and of the others the rows from ``first`` to ``last``.

    The camera is logged only when it changes: its latest row before ``first`` is kept.
    """
    camera: pa.RecordBatch | None = None
    first_time: pa.Scalar | None = None
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if "frame" not in batch.schema.names:
            yield chunk
            continue
        frames = batch.column("frame")
        rows = batch.filter(pc.and_(pc.greater_equal(frames, first), pc.less_equal(frames, last)))
        if rows.num_rows:
            yield from Chunk.from_record_batch(rows)
        at_first = batch.filter(pc.equal(frames, first))
        if at_first.num_rows:
            first_time = at_first.column("time")[0]
        before = batch.filter(pc.less(frames, first))
        if chunk.entity_path == entities.CAMERA and before.num_rows:
            camera = before.slice(before.num_rows - 1, 1)
    if camera is not None and first_time is not None:
        yield from Chunk.from_record_batch(_at(camera, first, first_time))


def _at(row: pa.RecordBatch, frame: int, time: pa.Scalar) -> pa.RecordBatch:
    """Return a row at another time."""
    for name, value in (("frame", frame), ("time", time.as_py())):
        index = row.schema.get_field_index(name)
        field = row.schema.field(index)
        row = row.set_column(index, field, pa.array([value], field.type))
    return row
