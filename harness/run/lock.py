"""One run at a time in a directory."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from vfoa.errors import VfoaError

LOCK = ".lock"


@contextmanager
def locked(folder: Path, tell: Callable[[str], None]) -> Iterator[None]:
    """Keep a folder to this process. The lock of a process that has ended is taken over, and ``tell`` is told so.

    Windows has no such lock: there, only the files of each configuration are kept to one process.

    Raises
    ------
    VfoaError
        If another process holds the lock.
    """
    if sys.platform == "win32":
        yield
        return
    import fcntl

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        holder = os.read(handle, 200).decode(errors="replace").strip()
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise VfoaError(
                f"{folder}: {holder or 'another process'} runs here; expected one run in a directory: wait for it, or "
                "choose another --out"
            ) from None
        if path.exists() and os.fstat(handle).st_ino == path.stat().st_ino:
            break
        os.close(handle)  # whoever held it has just removed it
    try:
        if holder:
            tell(f"{folder}: took over the lock of {holder}, which has ended")
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()} on {platform.node()}".encode(), 0)
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)
