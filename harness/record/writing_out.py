"""The file of a Rerun stream, written here: Rerun waits without end for a file that takes no more bytes.

Rerun writes into a pipe, and a thread moves the bytes from the pipe to the file. A quota, a size limit or a full disk
is then an ordinary error, and what Rerun still sends is dropped.
"""

from __future__ import annotations

import errno
import os
import select
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import rerun as rr

if TYPE_CHECKING:
    import rerun.blueprint as rrb

GO_ON = "finished frames are kept, and the same command continues"
_PATIENCE_S = 30.0
_AT_ONCE_BYTES = 2**20


class StreamFile:
    """The file ``path``, into which a stream writes from now on; with ``watched_at``, also to the viewer there.

    Raises
    ------
    OSError
        If the file cannot be opened.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        path: Path,
        layout: rrb.Blueprint | None = None,
        *,
        watched_at: str | None = None,
    ) -> None:
        self._stream, self._path = stream, path
        self._error: OSError | None = None
        self._ended = False
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o666)
        self._pipe, end = os.pipe()
        os.set_blocking(self._pipe, False)
        self._moving = threading.Lock()
        self._thread = threading.Thread(target=self._follow, name=f"writes {path.name}", daemon=True)
        self._thread.start()
        try:
            if watched_at is None:
                stream.save(f"/dev/fd/{end}", default_blueprint=layout)
            else:
                sinks = rr.FileSink(f"/dev/fd/{end}"), rr.GrpcSink(watched_at)
                stream.set_sinks(*sinks, default_blueprint=layout)
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
            raise OSError(error.errno, f"{error.strerror}; {GO_ON}", str(self._path))

    def flush(self) -> None:
        """Write out all that was logged. Raises the errors of :meth:`check`."""
        try:
            self._stream.flush(timeout_sec=_PATIENCE_S)
        except RuntimeError as error:
            raise OSError(errno.EIO, f"cannot be written ({error}); {GO_ON}", str(self._path)) from None
        waiting = self._waiting()
        while not self._ended:
            with self._moving:
                if not waiting.poll(0):
                    break
            time.sleep(0.001)
        self.check()

    def close(self) -> None:
        """End the stream and close the file, also after an error. Raises the errors of :meth:`check`."""
        if not self._ended:
            self._stream.disconnect()
            self._thread.join()
            os.close(self._pipe)
            os.close(self._file)
        self.check()

    def _follow(self) -> None:
        waiting = self._waiting()
        while not self._ended:
            waiting.poll()
            self._move()

    def _waiting(self) -> select.poll:
        waiting = select.poll()
        waiting.register(self._pipe, select.POLLIN)
        return waiting

    def _move(self) -> None:
        """Move what is in the pipe to the file, in the thread alone: an interrupt of the main one would lose bytes."""
        with self._moving:
            while not self._ended:
                try:
                    content = os.read(self._pipe, _AT_ONCE_BYTES)
                except BlockingIOError:
                    return
                self._ended = not content
                self._write(content)

    def _write(self, content: bytes) -> None:
        try:
            while content and self._error is None:
                content = content[os.write(self._file, content) :]
        except OSError as error:
            self._error = error
