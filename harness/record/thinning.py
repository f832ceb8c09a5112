"""Thinned recordings: complete only around wrong frames; elsewhere the large data is left out.

Left out: masks, measured depth, disparity, clouds, cones, rays and hits. Images, boxes, directions, curves, marks and
verdicts stay in every frame, so that the clip still plays.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]
import rerun as rr
from rerun.chunk import Chunk, RrdReader

from harness.record import entities
from harness.record.layers import ClipFiles
from harness.record.writing_out import StreamFile
from harness.run.records import FrameRecord
from harness.score.verdicts import Verdict

if TYPE_CHECKING:
    import rerun.blueprint as rrb

_ALL_BELOW = (entities.MASKS, entities.DISPARITY, entities.DEPTH, entities.MEASURED_DEPTH, entities.CONFIDENCE)
_PARTS = {
    entities.RECONSTRUCTION: ("points",),
    entities.ATTENTION_3D: ("cones", "rays", "missed_rays", "hits"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Whole:
    """The frames of a clip that are recorded completely. ``times_ns`` are the times of all frames, in their order."""

    frames: frozenset[int]
    times_ns: Mapping[int, int]

    @classmethod
    def around(cls, wrong: Collection[int], around: int, times_ns: Mapping[int, int]) -> Whole:
        """Select the first frame, which gives the extent of the scene, and ``around`` frames about each wrong one."""
        frames, whole = list(times_ns), {0}
        for place, frame in enumerate(frames):
            if frame in wrong:
                whole.update(range(max(place - around, 0), min(place + around + 1, len(frames))))
        return cls(frames=frozenset(frames[place] for place in whole if place < len(frames)), times_ns=times_ns)

    def ends_ns(self) -> dict[int, int]:
        """The first frame after each stretch of complete ones, with its time."""
        pairs = pairwise(self.times_ns)
        return {
            after: self.times_ns[after] for before, after in pairs if before in self.frames and after not in self.frames
        }


@dataclass(slots=True, kw_only=True)
class Judged:
    """The wrong frames of a configuration so far; ``around``: complete frames about each (None: all are complete)."""

    around: int | None
    wrong: set[int] = field(default_factory=set)
    times_ns: dict[int, int] = field(default_factory=dict)

    def add(self, record: FrameRecord, verdicts: Iterable[Verdict]) -> None:
        """Add a frame."""
        self.times_ns[record.frame] = record.time_ns
        if any(each.outcome == "wrong" for each in verdicts):
            self.wrong.add(record.frame)

    def whole(self) -> Whole | None:
        """The complete frames; None: all."""
        return None if self.around is None else Whole.around(self.wrong, self.around, self.times_ns)

    def state(self) -> dict[str, Any]:
        """The state from which another run can continue."""
        return {"wrong": sorted(self.wrong), "times_ns": [list(each) for each in self.times_ns.items()]}

    def resume(self, state: Mapping[str, Any]) -> None:
        """Continue from such a state."""
        self.wrong, self.times_ns = set(state["wrong"]), dict(state["times_ns"])


def thin(path: Path, files: ClipFiles, layout: rrb.Blueprint | None, whole: Whole) -> None:
    """Rewrite a closed file without the large data in the frames that are not complete.

    Rerun shows the latest value of an entity, so the data left out is cleared after each stretch of complete frames.
    """
    draft = path.with_name(path.name + ".thin")
    stream = rr.RecordingStream(files.application_id, recording_id=files.recording_id)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    file = StreamFile(stream, draft, layout)
    try:
        stream.send_chunks(_thinned(RrdReader(path).stream(), whole.frames, whole.ends_ns()))
    finally:
        file.close()
    draft.replace(path)


def _thinned(chunks: Iterable[Chunk], whole: frozenset[int], ends_ns: Mapping[int, int]) -> Iterator[Chunk]:
    kept = pa.array(sorted(whole), pa.int64())
    cleared: set[str] = set()
    for chunk in chunks:
        if chunk.is_static or not _takes_space(chunk.entity_path):
            yield chunk
            continue
        if ends_ns and chunk.entity_path not in cleared:
            cleared.add(chunk.entity_path)
            yield _clear(chunk.entity_path, ends_ns)
        batch = chunk.to_record_batch()
        rows = batch.filter(pc.is_in(batch.column("frame").cast(pa.int64()), value_set=kept))
        if rows.num_rows:
            yield from Chunk.from_record_batch(rows)


def _clear(path: str, ends_ns: Mapping[int, int]) -> Chunk:
    times = [
        rr.TimeColumn("frame", sequence=list(ends_ns)),
        rr.TimeColumn("time", duration=np.array(list(ends_ns.values()), dtype="timedelta64[ns]")),
    ]
    return Chunk.from_columns(path, indexes=times, columns=rr.Clear.columns(is_recursive=[True] * len(ends_ns)))


def _takes_space(path: str) -> bool:
    if any(path == above or path.startswith(f"{above}/") for above in _ALL_BELOW):
        return True
    return any(path.startswith(f"{above}/") and path.rsplit("/", 1)[1] in parts for above, parts in _PARTS.items())
