"""One file of a clip's recording while it is being written."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import rerun as rr

from harness.record import entities
from harness.record.frame_log import FrameLog
from harness.record.layers import ClipFiles

if TYPE_CHECKING:
    import rerun.blueprint as rrb

_FLUSHED_EVERY = 50
"""Frames. What waits in memory does not grow with the clip, and a kill loses no more than this."""


class LayerFile:
    """A layer, written to ``<path>.partial``, which becomes ``path`` when it is closed as complete.

    After an error or a kill only the partial file is left; Rerun can read its frames. The file is opened by the first
    call of :meth:`open`. With ``watched_at``, the address of a viewer, that viewer is shown each frame as well.
    """

    def __init__(self, path: Path, files: ClipFiles, *, watched_at: str | None = None) -> None:
        self._path, self._watched_at = path, watched_at
        self._partial = path.with_name(path.name + ".partial")
        self.stream = rr.RecordingStream(
            files.application_id,
            recording_id=files.recording_id,
            # the default, 0.2 s, would cut a slow pipeline's recording into a chunk per frame and entity
            batcher_config=rr.ChunkBatcherConfig(flush_tick=datetime.timedelta(seconds=0.05 if watched_at else 60)),
        )
        # the source's frame number and time are the only timelines
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        self._name = files.clip
        self._logs: dict[str, FrameLog] = {}
        self._opened = False
        self._frames = 0

    @property
    def is_open(self) -> bool:
        """Whether the file was begun."""
        return self._opened

    def open(self, layout: rrb.Blueprint | None = None) -> None:
        """Begin the file, with the layout that the viewer opens it in; nothing if it is open."""
        if self._opened:
            return
        self._opened = True
        rr.set_strict_mode(True)  # without it, Rerun drops bad data with a warning
        self._path.parent.mkdir(parents=True, exist_ok=True)
        if self._watched_at is None:
            self.stream.save(self._partial, default_blueprint=layout)
        else:
            self.stream.set_sinks(rr.FileSink(self._partial), rr.GrpcSink(self._watched_at), default_blueprint=layout)
        self.stream.send_recording_name(self._name)
        self.stream.log(entities.WORLD, rr.ViewCoordinates.RDF, static=True)

    def part(self, name: str) -> FrameLog:
        """A part of the file that is logged frame by frame, independently of the other parts."""
        return self._logs.setdefault(name, FrameLog(self.stream))

    def end_frame(self) -> None:
        """Write out what waits, from time to time; at once where a viewer watches."""
        self._frames += 1
        if self._watched_at:
            self._send_numbers()
        if self._frames % _FLUSHED_EVERY == 0:
            self.stream.flush()

    def close(self, *, complete: bool) -> None:
        """End the file; a complete one takes its place."""
        if complete:
            self.open()
        if self._opened:
            self._send_numbers()
            self.stream.flush()
        self.stream.disconnect()
        if complete:
            self._partial.replace(self._path)

    def _send_numbers(self) -> None:
        for log in self._logs.values():
            log.close()
