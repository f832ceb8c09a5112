"""Writing out what a Rerun stream holds back, within bounded time: Rerun waits without end for a file that is full."""

from __future__ import annotations

import errno
import threading
from pathlib import Path

import rerun as rr

_PATIENCE_S = 30.0
GO_ON = "finished frames are kept, and the same command continues"


def write_out(stream: rr.RecordingStream, path: Path) -> None:
    """Write all that waits to the stream's file, which is at ``path``.

    Raises
    ------
    OSError
        If the file takes no more. The stream must not be closed then.
    """
    try:
        stream.flush(timeout_sec=_PATIENCE_S)
    except RuntimeError as error:
        _abandon(stream)
        raise OSError(errno.EIO, f"cannot be written ({error}); {GO_ON}", str(path)) from None


def _abandon(stream: rr.RecordingStream) -> None:
    """Never close a stream: to close it, or to collect it at the program's end, is to write it out without a limit."""
    rr.unregister_shutdown()
    threading.Thread(target=_hold, args=(stream,), daemon=True).start()  # its frame outlives the interpreter


def _hold(stream: rr.RecordingStream) -> None:
    threading.Event().wait()
