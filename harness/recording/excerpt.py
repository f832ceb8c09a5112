"""A few frames of a recording as a recording of their own, small enough to send to a colleague."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]
from rerun.chunk import Chunk, LazyChunkStream, RrdReader

from harness.files import replacing
from harness.recording import entities
from harness.recording.reading import reading
from harness.recording.recorder import APPLICATION
from harness.recording.viewer import viewer_binary
from vfoa.errors import VfoaError


def write_excerpt(recording: Path, frame: int, margin: int, excerpt: Path) -> None:
    """Write the frames ``frame - margin`` to ``frame + margin`` that a recording has, with its layout and static data.

    Raises
    ------
    VfoaError
        If the recording cannot be read, does not have that frame, or the margin is negative.
    """
    if margin < 0:
        raise VfoaError(f"--margin: expected at least 0 frames, found {margin}")
    times = _times(recording)
    if frame not in times:
        raise VfoaError(f"{recording}: found no frame {frame}; expected one of {min(times)} to {max(times)}")
    inside = [each for each in times if abs(each - frame) <= margin]
    first, end = min(inside), max(inside) + 1
    with tempfile.TemporaryDirectory() as scratch:
        cut = ["--timeline", "frame", "--time", str(first), "--time", str(end), "--output-dir", scratch]
        _rrd("split", *cut, "--recording-id", f"{recording.stem}-{frame}-", str(recording))
        (middle,) = Path(scratch).glob(f"*_{first}__{end}.rrd")
        camera = Path(scratch) / "camera.rrd"
        _write_camera(recording, first, times[first], RrdReader(middle).recordings()[0].recording_id, camera)
        with replacing(excerpt) as draft:
            _rrd("merge", "--output", str(draft), str(middle), str(camera))


def _times(recording: Path) -> dict[int, Any]:
    """Time by frame."""
    found: dict[int, Any] = {}
    with reading(recording):
        for chunk in RrdReader(recording).stream().filter(content=entities.IMAGE, has_timeline="frame"):
            batch = chunk.to_record_batch()
            found |= dict(zip(batch.column("frame").to_pylist(), batch.column("time").to_pylist(), strict=True))
    if not found:
        raise VfoaError(f"{recording}: expected a recording of frames, found none")
    return found


def _write_camera(recording: Path, first: int, time: Any, recording_id: str, path: Path) -> None:
    """The camera as of the first frame: it is logged only when it changes, and a split leaves earlier rows out."""
    batches = [c.to_record_batch() for c in RrdReader(recording).stream().filter(content=entities.CAMERA)]
    rows = [batch.slice(row, 1) for batch in batches for row in range(batch.num_rows)]
    row = max((row for row in rows if _frame(row) <= first), key=_frame)
    for name, value in (("frame", first), ("time", time)):
        index = row.schema.get_field_index(name)
        row = row.set_column(index, row.schema.field(index), pa.array([value], row.schema.field(index).type))
    LazyChunkStream.from_iter(Chunk.from_record_batch(row)).write_rrd(
        path, application_id=APPLICATION, recording_id=recording_id
    )


def _frame(row: pa.RecordBatch) -> int:
    return int(row.column("frame")[0].as_py())


def _rrd(*arguments: str) -> None:
    done = subprocess.run([viewer_binary(), "rrd", *arguments], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise VfoaError(f"rerun rrd {arguments[0]}: {done.stderr.strip()}")
