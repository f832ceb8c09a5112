"""What one configuration has written of one clip: a line of results a frame, which survive a kill.

Each frame's lines are handed to the operating system when the frame is done, its timings before its result. What a
killed run leaves is taken over up to the last whole line, with the timings of those frames. The frames before are
then computed once more (what a stage carries from frame to frame is not in the lines) and compared, not written.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from vfoa.errors import VfoaError

LOCK_SECONDS = 10.0
"""How long a file's last writer may take to die before it counts as another run at work."""


class Part:
    """Two open files: results, and timings beside them. ``kept`` frames were written by a run that was broken off."""

    def __init__(self, results: BinaryIO, timings: BinaryIO, kept: int) -> None:
        self._results, self._timings = results, timings
        self._kept, self._frames = kept, 0

    @property
    def goes_on(self) -> bool:
        """Whether the next frame is a new one."""
        return self._frames >= self._kept

    def write(self, line: str, timings: Mapping[str, float], prefix: str) -> None:
        """Write the next frame: its line of results, its ms by stage, each on a line that starts with ``prefix``.

        Raises
        ------
        VfoaError
            If the frame was written by a run that was broken off, and differently.
        """
        if self.goes_on:
            rows = "".join(f"{prefix},{stage},{ms:.3f}\n" for stage, ms in timings.items())
            for file, text in ((self._timings, rows), (self._results, line)):
                file.write(text.encode())
                file.flush()
        elif self._results.readline() != line.encode():
            raise VfoaError(
                f"{self._results.name}, line {self._frames + 1}: expected what this program computes for the frame, "
                "found another result; remove the file to begin anew"
            )
        self._frames += 1


@contextmanager
def open_part(results: Path, timings: Path) -> Iterator[Part]:
    """Open a part to go on with it, or begin it.

    Raises
    ------
    VfoaError
        If another process is writing it.
    """
    results.parent.mkdir(parents=True, exist_ok=True)
    with open(results, "a+b") as kept_results, open(timings, "a+b") as kept_timings:
        _lock(kept_results, results)
        frames = _cut_results(kept_results)
        _cut_timings(kept_timings, frames)
        yield Part(kept_results, kept_timings, frames)


def _cut_results(file: BinaryIO) -> int:
    """Drop a last line that was not finished, go to the start, and return how many lines there are."""
    file.seek(0)
    lines = end = 0
    for line in file:
        if not line.endswith(b"\n"):
            break
        lines, end = lines + 1, end + len(line)
    file.truncate(end)
    file.seek(0)
    return lines


def _cut_timings(file: BinaryIO, frames: int) -> None:
    """Drop the timings of all but the first frames; each frame's stand together, its number in the third column."""
    file.seek(0)
    end, seen, last = 0, 0, b""
    for line in file:
        number = line.split(b",")[2] if line.count(b",") > 2 else b""
        seen, last = seen + (number != last), number
        if seen > frames:
            break
        end += len(line)
    file.truncate(end)
    file.seek(end)


def _lock(file: BinaryIO, path: Path) -> None:
    """Keep the file to this process until it is closed or the process ends."""
    if sys.platform == "win32":
        return None
    import fcntl

    deadline = time.monotonic() + LOCK_SECONDS
    while True:
        try:
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > deadline:
                raise VfoaError(f"{path}: another process is writing it; expected one run in a directory") from None
            time.sleep(0.1)
