"""Work for executors, in a module that imports next to nothing: each worker process of a test imports it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

from vfoa.errors import VfoaError

Progress = Callable[[str], None]


def square(number: int, progress: Progress) -> tuple[int, int]:
    """The square, and the threads that OpenCV uses here."""
    import cv2

    progress(str(number))
    return number**2, cv2.getNumThreads()


def fail(number: int, progress: Progress) -> int:
    raise ZeroDivisionError(f"job {number}")


def refuse(number: int, progress: Progress) -> tuple[int, int]:
    raise VfoaError("s3://bucket: cannot be read")


def pid(number: int, progress: Progress) -> int:
    return os.getpid()


def wait_for(marker: Path, progress: Progress) -> str:
    deadline = time.monotonic() + 60
    while not marker.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    return marker.name if marker.exists() else "waited in vain"


def die_once(marker: Path, progress: Progress) -> str:
    """Takes its worker along, unless another worker did so before."""
    progress(marker.name)
    if not marker.exists():
        marker.write_text(str(os.getpid()))
        os.kill(os.getpid(), signal.SIGKILL)
    return f"{marker.name} done"


def die(marker: Path, progress: Progress) -> str:
    if marker.name == "deadly":
        os.kill(os.getpid(), signal.SIGKILL)
    return marker.name


def sleep(marker: Path, progress: Progress) -> None:
    if marker.name != "short":
        marker.write_text(str(os.getpid()))
        time.sleep(600)


def linger(folder: Path, progress: Progress) -> None:
    (folder / str(os.getpid())).touch()
    time.sleep(600)


def endless(marker: Path, progress: Progress) -> str:
    """Goes on until it is stopped, and says so; a job called "short" is done at once."""
    if marker.name == "short":
        return "done"
    marker.write_text("begun")
    try:
        while True:
            progress(marker.name)
            time.sleep(0.01)
    finally:
        marker.write_text("stopped")
