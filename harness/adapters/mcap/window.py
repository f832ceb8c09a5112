"""A part of a recording by time: which log times, and which chunks of a file hold them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from mcap.records import ChunkIndex

from harness.adapters.mcap.recording import log_span_ns, summary
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Log times from ``start_ns`` to before ``end_ns`` (None: to the end)."""

    start_ns: int
    end_ns: int | None

    def __contains__(self, log_time_ns: int) -> bool:
        return self.start_ns <= log_time_ns and (self.end_ns is None or log_time_ns < self.end_ns)

    def overlaps(self, first_ns: int, last_ns: int) -> bool:
        """Whether a message between these two log times may lie in the window."""
        return last_ns >= self.start_ns and (self.end_ns is None or first_ns < self.end_ns)


def find_window(files: Iterable[Path], start_s: float | None, end_s: float | None, where: str) -> Window | None:
    """The window between two times in seconds after the recording's first message; None where neither is given.

    Reads summaries, or where there is none the heads of the records, no message.

    Raises
    ------
    VfoaError
        If the recording ends before the window begins, or has no message.
    """
    if start_s is None and end_s is None:
        return None
    spans = [span for path in files if (span := log_span_ns(path)) is not None]
    if not spans:
        raise VfoaError(f"{where}: no messages")
    first, last = min(each[0] for each in spans), max(each[1] for each in spans)
    start = first + round((start_s or 0) * 1e9)
    if start > last:
        raise VfoaError(f"{where}: source.start_s: found {start_s:g}; the recording lasts {(last - first) / 1e9:.3f} s")
    return Window(start_ns=start, end_ns=None if end_s is None else first + round(end_s * 1e9))


def chunks_in(path: Path, window: Window, calibrations: set[int]) -> list[int] | None:
    """Offsets of the chunks to read for a window, by the file's index; None where the file has none.

    Besides those of the window: for each channel of ``calibrations`` the last chunk before it that holds one, since
    a camera may send its calibration once.
    """
    chunks = sorted(
        (each for each in summary(path) if isinstance(each, ChunkIndex)), key=lambda each: each.chunk_start_offset
    )
    if not chunks or not all(each.message_index_offsets for each in chunks):
        return None
    wanted = {
        each.chunk_start_offset for each in chunks if window.overlaps(each.message_start_time, each.message_end_time)
    }
    for channel in calibrations:
        holding = [each for each in chunks if channel in each.message_index_offsets]
        before = [each for each in holding if each.message_start_time < window.start_ns]
        wanted.update(each.chunk_start_offset for each in (before[-1:] or holding[:1]))
    return sorted(wanted)
