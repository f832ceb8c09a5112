"""The journal of a clip's labelling: one JSON line per change, on disk before the change is answered."""

from __future__ import annotations

import fcntl
import functools
import json
import operator
import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from harness.files.parsing import parse_json
from vfoa.errors import VfoaError


class Journal:
    """An append-only file, locked by one process at a time.

    A last line without its end is left by a power cut during a change that was never answered: it is removed.

    Raises
    ------
    VfoaError
        If it cannot be written, another process has locked it, or a line is not JSON.
    """

    def __init__(self, path: Path, *, of: Path) -> None:
        """Open the journal of the file ``of``.

        A new journal gets that file's permissions; without that file those of the clip's other journals.
        """
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            mode = None if path.exists() else _mode_of([of] if of.exists() else path.parent.glob(f"{_clip(of)}*.jsonl"))
            self._file = path.open("a+b", buffering=0)
            if mode is not None:
                os.fchmod(self._file.fileno(), mode)
        except OSError as error:
            raise VfoaError(f"{path}: cannot be written: {error.strerror}") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._file.close()
            raise VfoaError(f"{of} is being labelled by another vfoa annotate; close that one first") from None
        try:
            self.entries = self._read()
        except BaseException:
            self.close()
            raise

    def append(self, entry: dict[str, Any]) -> int:
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

    def take_back(self, place: int) -> None:
        """Remove the entry at this offset, and everything after it."""
        self._file.truncate(place)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _read(self) -> list[dict[str, Any]]:
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
                raise VfoaError(f"{self.path}:{number}: no entry; move the journal away to continue")
            entries.append(entry)
        return entries


def _clip(file: Path) -> str:
    return file.name.partition(".")[0].partition("@")[0]


def _mode_of(files: Iterable[Path]) -> int | None:
    """The permissions that all of these files give; None without any."""
    modes = [stat.S_IMODE(each.stat().st_mode) for each in files]
    return functools.reduce(operator.and_, modes) if modes else None
