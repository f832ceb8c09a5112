"""A journal beside a file: what was changed, an entry a line, each on the disk before its change is answered."""

from __future__ import annotations

import functools
import json
import operator
import os
import stat
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from harness.files.io import take_lock
from harness.files.parsing import parse_json
from vfoa.errors import VfoaError

Entry = dict[str, Any]


class Journal:
    """An append-only file, locked by one process at a time.

    Raises
    ------
    VfoaError
        If it cannot be written, or another process has locked it.
    """

    def __init__(self, path: Path, *, of: Path) -> None:
        """Open the journal of the file ``of``.

        A new journal gets that file's permissions; without that file those of the clip's other journals.
        """
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._of_clip = f"{of.name.partition('.')[0].partition('@')[0]}*.jsonl"
            mode = None if path.exists() else _mode_of([of] if of.exists() else path.parent.glob(self._of_clip))
            self._file = path.open("a+b", buffering=0)
            self.changed_ns = os.fstat(self._file.fileno()).st_ctime_ns
            """When the journal was last changed before it was opened here."""
            if mode is not None:
                os.fchmod(self._file.fileno(), mode)
        except OSError as error:
            raise VfoaError(f"{path}: cannot be written: {error.strerror}") from None
        if not take_lock(self._file):
            self._file.close()
            raise VfoaError(f"{of} is being labelled by another vfoa annotate; close that one first")

    def read(self) -> list[Entry]:
        """Every entry; :class:`VfoaError` if a line is not JSON.

        A last line without its end is left by a power cut during a change that was never answered: it is removed.
        """
        self._file.seek(0)
        content = self._file.read()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            self._file.truncate(len(whole))
        entries = []
        for number, line in enumerate(whole.splitlines(), start=1):
            try:
                entry = parse_json(line, f"{self.path}:{number}")
            except VfoaError as error:
                raise VfoaError(f"{error}; move the journal away to continue") from None
            if not isinstance(entry, dict):
                raise VfoaError(f"{self.path}:{number}: not an entry; move the journal away to continue")
            entries.append(entry)
        return entries

    def append(self, entry: Entry) -> int:
        """Append an entry; it is on the disk when this returns. Returns the offset at which it begins.

        Raises
        ------
        VfoaError
            If it cannot be written; the journal is then unchanged.
        """
        line = json.dumps(entry, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"
        end = self._file.seek(0, os.SEEK_END)
        try:
            while line:
                line = line[self._file.write(line) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.truncate(end)
            raise VfoaError(f"{self.path}: cannot be written: {error.strerror}") from None
        return end

    def next_time_s(self) -> float:
        """The time for a new entry: the clock's, seconds since 1970, but later than all entries of the clip's journals.

        The order of steps in two journals is then that in which they were made, also if the clock was set back.
        """
        last_s = max(map(_last_time_s, self.path.parent.glob(self._of_clip)), default=0.0)
        return max(round(time.time(), 3), round(last_s + 0.001, 3))

    def take_back(self, offset: int) -> None:
        """Remove the entry at this offset, and everything after it."""
        self._file.truncate(offset)

    def close(self) -> None:
        """Close the file, which unlocks it."""
        self._file.close()


_TAIL_BYTES = 4096
"""More than almost every entry takes."""


def _last_time_s(journal: Path) -> float:
    """The time of the last entry of a journal that another process may have; 0 if there is none that can be read."""
    with suppress(OSError, VfoaError, LookupError, TypeError, ValueError), journal.open("rb") as file:
        size, read = file.seek(0, os.SEEK_END), 0
        while read < size:
            read = min(size, 2 * read or _TAIL_BYTES)
            file.seek(size - read)
            *lines, _ = file.read(read).split(b"\n")  # the last entry may be half-written
            if len(lines) > 1 or (lines and read == size):
                return float(parse_json(lines[-1], journal)["time_s"])
    return 0.0


def _mode_of(files: Iterable[Path]) -> int | None:
    """The permissions that all of these files give; None without any."""
    modes = [stat.S_IMODE(file.stat().st_mode) for file in files]
    return functools.reduce(operator.and_, modes) if modes else None
