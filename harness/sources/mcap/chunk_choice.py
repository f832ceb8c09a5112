"""Select the chunks of an MCAP file that hold the messages of a window of time."""

from __future__ import annotations

from pathlib import Path

from mcap.records import ChunkIndex

from harness.sources.mcap.recording import summary
from harness.sources.recordings.index import Window


def chunks_in(path: Path, window: Window, once: set[int]) -> list[int] | None:
    """Return the offsets of the chunks to read for a window, by the file's index; None if the file has none.

    Beside those of the window: for each channel of ``once``, the last chunk before the window with one of its messages,
    since a camera may send its calibration once.
    """
    chunks = sorted(
        (each for each in summary(path) if isinstance(each, ChunkIndex)), key=lambda each: each.chunk_start_offset
    )
    if not chunks or not all(each.message_index_offsets for each in chunks):
        return None
    wanted = {
        each.chunk_start_offset for each in chunks if window.overlaps(each.message_start_time, each.message_end_time)
    }
    for channel in once:
        holding = [each for each in chunks if channel in each.message_index_offsets]
        before = [each for each in holding if each.message_start_time < window.start_ns]
        wanted.update(each.chunk_start_offset for each in (before[-1:] or holding[:1]))
    return sorted(wanted)
