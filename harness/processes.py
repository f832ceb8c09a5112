"""The process of this program: its system, Ctrl-C, and children, which import nothing from the working directory."""

from __future__ import annotations

import atexit
import os

TYPE_CHECKING = False  # as in typing, which takes ten times as long to import as this module
if TYPE_CHECKING:
    from multiprocessing.context import SpawnContext
    from types import FrameType

NOT_ON_WINDOWS = (
    "found Windows; expected Linux or macOS: install it in WSL (wsl --install); the library, import vfoa, needs no WSL"
)
"""Runs lock files, and end their processes by signals, as only a POSIX system does."""

_AGAIN_S = 0.02


def interrupt(number: int, frame: FrameType | None) -> None:
    """Handle a signal: raise KeyboardInterrupt, at once or as soon as that does no harm.

    Python drops an exception that is raised in ``__del__``, in a callback of an import's locks, or while a weak
    collection forgets an object, and libraries that are being imported turn it into an ImportError of their own. A
    process that is being started must get its data: SIGINT is blocked then, but only in this thread, and another one
    may have taken the signal.
    """
    import signal

    if signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()) or _drops_exceptions(frame):
        signal.signal(signal.SIGALRM, interrupt)
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)
    else:
        raise KeyboardInterrupt


@atexit.register
def _stop_waiting() -> None:
    """Drop a signal that still waits at the end: without Python's handlers, its alarm would kill the process.

    This module is the first that the command imports, so that this is the last of its functions to be called at exit.
    """
    import signal

    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0)


def _drops_exceptions(frame: FrameType | None) -> bool:
    """Whether an import, a ``__del__`` or a callback of a weak reference of :mod:`weakref` is being executed."""
    while frame is not None:
        if frame.f_code.co_name == "__del__" or frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        if frame.f_globals.get("__name__") in ("weakref", "_weakrefset"):
            return True
        frame = frame.f_back
    return False


def keep_working_directory_out() -> None:
    """Keep the working directory out of the import path of child processes, unless the user set ``PYTHONSAFEPATH``.

    Otherwise a file named like a module of the standard library, such as ``signal.py``, would be imported in its place.
    """
    os.environ.setdefault("PYTHONSAFEPATH", "1")


def spawning() -> SpawnContext:
    """The context that starts processes: spawned, and without the working directory in their path."""
    import multiprocessing

    keep_working_directory_out()
    return multiprocessing.get_context("spawn")
