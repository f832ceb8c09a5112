"""One file of a clip's recording while it is written."""

from __future__ import annotations

import _thread
import datetime
import errno
import os
import select
import shutil
import threading
import time
import warnings
from collections.abc import Iterable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import rerun as rr
import rerun_bindings
from rerun.chunk import Chunk, RrdReader

from harness.record import entities
from harness.record.frame_log import FrameLog
from harness.record.layers import ClipFiles, RecordingIds

if TYPE_CHECKING:
    import rerun.blueprint as rrb


SENT_EVERY = 600
"""Most frames between flushes, which write all waiting rows: larger chunks take less room in the file."""
WAITING_BYTES = 4 * 2**20
"""Most memory of the rows that wait, roughly: more are written earlier."""
FLUSHED_ROWS = 1000
"""Least rows between flushes when a file is written from others: Rerun takes chunks faster than the file does."""
LEAST_FREE_BYTES = 32 * 2**20
"""A recording stops when the disk has less free space than this: the rest is for the results."""
_PATIENCE_S = 30.0
_AT_ONCE_BYTES = 2**16


class LayerFile:
    """A layer, written to ``<path>.partial``, which becomes ``path`` when it is closed as complete.

    After an error or a kill only the partial file is left; Rerun can read its frames. The file is opened by the first
    call of :meth:`open`.

    The partial file has no footer. For the footer, which lists all chunks, Rerun would keep an entry of each chunk in
    memory as long as the file is open. The complete file is assembled from the partial one and has a footer.
    """

    def __init__(self, path: Path, files: ClipFiles) -> None:
        self._path = path
        self._partial, self._whole = (path.with_name(f"{path.name}.{kind}") for kind in ("partial", "whole.partial"))
        self._files = files
        self._layout: rrb.Blueprint | None = None
        # Rerun keeps a stream that nobody has any more, with its two threads, until it is told to clean up: a run of
        # many clips would have thousands
        rerun_bindings.flush_and_cleanup_orphaned_recordings()
        self.stream = rr.RecordingStream(
            files.ids.application,
            recording_id=files.ids.recording,
            # the default, 0.2 s, would cut a slow pipeline's recording into a chunk per frame and entity
            batcher_config=rr.ChunkBatcherConfig(flush_tick=datetime.timedelta(seconds=60)),
        )
        # the source's frame number and time are the only timelines
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        self._logs: dict[str, FrameLog] = {}
        self._file: _StreamFile | None = None
        self._unsent = 0

    @property
    def is_open(self) -> bool:
        """Whether the file has been begun."""
        return self._file is not None

    def open(self, layout: rrb.Blueprint | None = None) -> None:
        """Begin the file, with the layout in which the viewer opens it; nothing if it is open."""
        if self._file:
            return
        rr.set_strict_mode(True)  # without it, Rerun drops bad data with only a warning
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._check_room()
        self._layout = layout
        self._file = _StreamFile(self.stream, self._partial, layout, footer=False)
        self.stream.send_recording_name(self._files.clip)
        self.stream.log(entities.WORLD, rr.ViewCoordinates.RDF, static=True)

    def lay_out(self, layout: rrb.Blueprint) -> None:
        """Give the complete file another layout: more is known of its content than when it was opened."""
        self._layout = layout

    def part(self, name: str) -> FrameLog:
        """A part of the file that is logged frame by frame, independently of the other parts."""
        if name not in self._logs:
            self._logs[name] = FrameLog(self.stream)
        return self._logs[name]

    def end_frame(self) -> None:
        """Send and flush rows from time to time.

        Raises
        ------
        OSError
            If the disk is full, or cannot be written.
        """
        assert self._file
        self._check_room()
        self._file.check()
        self._unsent += 1
        if self._unsent >= SENT_EVERY or sum(log.waiting_bytes for log in self._logs.values()) > WAITING_BYTES:
            self._send_rows()
            self._file.flush()

    def close(self, *, complete: bool) -> None:
        """Close the file; a complete one is moved to its place.

        Raises the errors of :meth:`end_frame` if it is to be complete.
        """
        if complete:
            self.open()
        if self._file is None:
            self.stream.disconnect()
            return
        with nullcontext() if complete else suppress(OSError):  # another error is already being reported
            try:
                self._send_rows()
            finally:
                self._file.close()
        if complete:
            self._assemble()

    def _check_room(self) -> None:
        free = shutil.disk_usage(self._path.parent).free
        if free < LEAST_FREE_BYTES:
            reason = f"{os.strerror(errno.ENOSPC)}: {free // 2**20} MB are free"
            raise OSError(errno.ENOSPC, reason, str(self._partial))

    def _assemble(self) -> None:
        """Write the chunks of the partial file into the complete file, and remove the partial one."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rr.error_utils.RerunWarning)  # a file without a footer
            chunks = RrdReader(self._partial).stream()
        write_whole(self._whole, self._files.ids, self._layout, chunks)
        self._whole.replace(self._path)
        self._partial.unlink()

    def _send_rows(self) -> None:
        self._unsent = 0
        for log in self._logs.values():
            log.send()


def write_whole(path: Path, ids: RecordingIds, layout: rrb.Blueprint | None, chunks: Iterable[Chunk]) -> None:
    """Write a recording from chunks, with the layout in which the viewer opens it.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    stream = rr.RecordingStream(ids.application, recording_id=ids.recording, send_properties=False)
    whole = _StreamFile(stream, path, layout, footer=True)
    try:
        unwritten = 0
        for chunk in chunks:
            stream.send_chunks(chunk)
            unwritten += chunk.num_rows
            if unwritten >= FLUSHED_ROWS:
                whole.flush()
                unwritten = 0
    finally:
        whole.close()


def _save(stream: rr.RecordingStream, path: str, layout: rrb.Blueprint | None, *, footer: bool) -> None:
    """Let a stream write into a file from now on.

    Rerun makes a stream of the layout, too, whose memory holds the stream itself: it is let go by disconnecting it.
    """
    if layout is None:
        stream.save(path, write_footer=footer)
        return
    logged = _LoggedLayout(layout)
    stream.save(path, default_blueprint=logged, write_footer=footer)  # type: ignore[arg-type]
    logged.stream.disconnect()


class _LoggedLayout:
    """A layout that tells into which stream Rerun has logged it."""

    stream: rr.RecordingStream

    def __init__(self, layout: rrb.Blueprint) -> None:
        self._layout = layout

    def to_blueprint(self) -> _LoggedLayout:
        """As of a Blueprint."""
        return self

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self.stream = stream
        self._layout._log_to_stream(stream)


class _StreamFile:
    """The file ``path``, into which a stream writes from now on.

    Rerun waits without end for a file that takes no more bytes. Therefore it writes into a pipe, and a thread moves
    the bytes from the pipe to the file. A quota, a size limit or a full disk is then an ordinary error, and what Rerun
    still sends is dropped.

    Raises
    ------
    OSError
        If the file cannot be opened.
    """

    def __init__(self, stream: rr.RecordingStream, path: Path, layout: rrb.Blueprint | None, *, footer: bool) -> None:
        self._stream, self._path = stream, path
        self._error: OSError | None = None
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        self._pipe, end = os.pipe()
        os.set_blocking(self._pipe, False)
        self._moving = threading.Lock()
        self._begun, self._ended = threading.Event(), threading.Event()
        try:
            # threading.Thread.start would wait without end for a thread that has no memory to begin
            _thread.start_new_thread(self._follow, ())
            if not self._begun.wait(_PATIENCE_S):
                raise RuntimeError("no memory for a thread that writes")
            _save(stream, f"/dev/fd/{end}", layout, footer=footer)
        except RuntimeError as error:
            raise OSError(errno.EIO, f"cannot be opened ({error})", str(path)) from None
        finally:
            os.close(end)  # Rerun has opened it for itself

    def check(self) -> None:
        """Raise the error of the first write that failed.

        Raises
        ------
        OSError
            With the path of the file.
        """
        if (error := self._error) is not None:
            raise OSError(error.errno, error.strerror, str(self._path))

    def flush(self) -> None:
        """Write out all that was logged. Raises the errors of :meth:`check`."""
        try:
            self._stream.flush(timeout_sec=_PATIENCE_S)
        except RuntimeError as error:
            raise OSError(errno.EIO, f"cannot be written ({error})", str(self._path)) from None
        waiting = self._waiting()
        while not self._ended.is_set():
            with self._moving:
                if not waiting.poll(0):
                    break
            time.sleep(0.001)
        self.check()

    def close(self) -> None:
        """End the stream and close the file, also after an error. Raises the errors of :meth:`check`."""
        if not self._ended.is_set():
            self._stream.disconnect()
            self._ended.wait()
            os.close(self._pipe)
            os.close(self._file)
        self.check()

    def _follow(self) -> None:
        waiting = self._waiting()
        self._begun.set()
        while not self._ended.is_set():
            waiting.poll()
            self._move()

    def _waiting(self) -> select.poll:
        waiting = select.poll()
        waiting.register(self._pipe, select.POLLIN)
        return waiting

    def _move(self) -> None:
        """Move what is in the pipe to the file, in the thread alone: an interrupt of the main one would lose bytes."""
        with self._moving:
            while not self._ended.is_set():
                try:
                    content = os.read(self._pipe, _AT_ONCE_BYTES)
                except BlockingIOError:
                    return
                if content:
                    self._write(content)
                else:
                    self._ended.set()

    def _write(self, content: bytes) -> None:
        try:
            while content and self._error is None:
                content = content[os.write(self._file, content) :]
        except OSError as error:
            self._error = error
