"""A file of a clip that is changed step by step: never lost, never half-written, never overwritten unnoticed.

Every change goes to a journal first, one JSON line that is on the disk before the change is answered; then the file is
rewritten. The state is the sum of the journal's entries, which know more than the file (the undo list). A change names
its revision; one on an older revision is refused. The journal is used at the start if the file is its result; a file
that was changed by another program wins.
"""

from __future__ import annotations

import functools
import json
import operator
import os
import stat
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from harness.files.digests import file_digest
from harness.files.io import take_lock
from harness.files.parsing import parse_json
from vfoa.errors import VfoaError

Entry = dict[str, Any]
Content = TypeVar("Content")
Step = TypeVar("Step")


class StaleRevisionError(Exception):
    """The change was made on an older revision."""


class OutsideClipError(VfoaError):
    """There is no such frame in the clip."""


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
            clip = of.name.partition(".")[0].partition("@")[0]
            mode = None if path.exists() else _mode_of([of] if of.exists() else path.parent.glob(f"{clip}*.jsonl"))
            self._file = path.open("a+b", buffering=0)
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
                raise VfoaError(f"{self.path}:{number}: no entry; move the journal away to continue")
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

    def take_back(self, offset: int) -> None:
        """Remove the entry at this offset, and everything after it."""
        self._file.truncate(offset)

    def close(self) -> None:
        """Close the file, which unlocks it."""
        self._file.close()


class Undo(Generic[Step]):
    """Steps that were made and undone, each with its time, seconds since 1970, which orders the steps of two stores."""

    def __init__(self) -> None:
        self._done: list[tuple[Step, float]] = []
        self._undone: list[tuple[Step, float, float]] = []

    def make(self, step: Step, entry: Entry) -> None:
        """Add a new step; nothing can be redone after it."""
        self._done.append((step, float(entry.get("time_s", 0))))
        self._undone.clear()

    def undo(self, entry: Entry) -> Step:
        """Take the last step back and return it (IndexError if there is none)."""
        step, made_s = self._done.pop()
        self._undone.append((step, made_s, float(entry.get("time_s", 0))))
        return step

    def redo(self) -> Step:
        """Make the last undone step again and return it (IndexError if there is none)."""
        step, made_s, _ = self._undone.pop()
        self._done.append((step, made_s))
        return step

    def next(self, kind: Literal["undo", "redo"]) -> Step | None:
        """The step that is undone, or made again, next."""
        steps: Sequence[tuple[Any, ...]] = self._done if kind == "undo" else self._undone
        return steps[-1][0] if steps else None

    def clear(self) -> None:
        """Forget all steps: nothing can be undone or redone."""
        self._done.clear()
        self._undone.clear()

    def plain(self) -> dict[str, Any]:
        """As JSON: whether undo and redo are possible, and when their steps were made and undone."""
        return {
            "can_undo": bool(self._done),
            "can_redo": bool(self._undone),
            "made_s": self._done[-1][1] if self._done else None,
            "undone_s": self._undone[-1][2] if self._undone else None,
        }


class JournaledStore(ABC, Generic[Content, Step]):
    """A file, its journal, and the state that is the sum of the journal's entries. Not for several threads at once.

    An entry ``{"base": ..., "revision": r}`` begins anew with the content of the file; ``{"undo": true}`` and
    ``{"redo": true}`` take the last step back and make it again. The same entries give the same state.

    Parameters
    ----------
    path, journal
        The file and its journal, neither of which needs to exist. ``origin`` is read without a file.
    may_be_read_only
        If another process has the journal, :attr:`read_only` says so, and nothing can be changed.

    Raises
    ------
    VfoaError
        If file or journal are wrong, or another process changes the file.
    """

    def __init__(
        self,
        path: Path,
        journal: Path,
        *,
        origin: Path | None = None,
        may_be_read_only: bool = False,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.path = path
        self.revision = 0
        """Number of changes; it continues after a restart."""
        self.steps = Undo[Step]()
        self.read_only: str | None = None
        self._origin, self._clock = origin, clock
        self._journal: Journal | None = None
        self._request = ""
        try:
            self._journal = Journal(journal, of=path)
        except VfoaError as error:
            if not may_be_read_only:
                raise
            self.read_only = str(error)
        try:
            entries = self._journal.read() if self._journal else []
            self._requests = {entry["id"] for entry in entries if "id" in entry}
            self._start(self._read(), entries)
        except BaseException:
            self.close()
            raise

    @abstractmethod
    def apply(self, entry: Entry) -> None:
        """Change the state by one entry; ValueError, KeyError and similar if it does not fit this clip."""

    @abstractmethod
    def content(self) -> Content:
        """The content of the file."""

    @abstractmethod
    def base_of(self, content: Content) -> Entry:
        """The entry that begins anew with the content of the file."""

    def fits(self, base: Entry) -> bool:
        """Whether a base belongs to this clip. If not, comparing its result with the file shows it, too."""
        return True

    @abstractmethod
    def read(self, path: Path | None) -> Content:
        """The content of a file (:class:`VfoaError` if it is wrong); None: of a file that does not exist."""

    @abstractmethod
    def write(self, path: Path, content: Content) -> None:
        """Write all of it, or nothing."""

    @contextmanager
    def once(self, request: str) -> Iterator[bool]:
        """Yield whether no change has this request's id yet; changes in the block get it. An empty id is always new."""
        self._request = request
        try:
            yield request not in self._requests
        finally:
            self._request = ""

    def knows(self, request: str) -> bool:
        """Whether a change was made under this id."""
        return request in self._requests

    def check_revision(self, revision: int) -> None:
        """Reject a change on an older revision (:class:`StaleRevisionError`)."""
        self.refresh()
        if revision != self.revision:
            raise StaleRevisionError

    def check_writable(self) -> None:
        """Refuse to change the file while another process does."""
        if self.read_only is not None:
            raise VfoaError(self.read_only)

    def refresh(self) -> None:
        """Read the file again if another program has changed it; write it again if it was deleted."""
        digest = self._file_digest()
        if digest is None and self._digest is not None:  # deleted; the state of the open page is kept
            self._write(anew=True)
        elif digest != self._digest:
            self._take_over(self._read())

    def step_back(self, kind: Literal["undo", "redo"], revision: int) -> None:
        """Take the last change back, or make the last undone one again; nothing if there is none."""
        self.check_revision(revision)
        if self.steps.next(kind) is not None:
            self.commit({kind: True})

    def commit(self, entry: Entry) -> float:
        """Make a change, and return its time, seconds since 1970. A change that fails is not made.

        Raises
        ------
        VfoaError
            If the journal or the file cannot be written, or another process changes the file.
        """
        self.check_writable()
        assert self._journal is not None
        now_s, request = self._clock(), {"id": self._request} if self._request else {}
        entry = {**entry, **request, "time_s": round(now_s, 3)}
        offset = self._journal.append(entry)
        self.apply(entry)
        try:
            self._write()
        except VfoaError:  # a change that is not in the file is not shown, and not repeated by a restart
            self._journal.take_back(offset)
            self._replay(self._journal.read())
            raise
        self._requests.update(request.values())
        return now_s

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close()

    def _start(self, stored: Content, entries: list[Entry]) -> None:
        base = _last_base(entries)
        with self._reported(base + 1):
            fits = bool(entries) and "base" in entries[base] and self.fits(entries[base])
        if not fits:
            self._take_over(stored)
            return
        before = self._replay(entries)
        # A kill between the journal and the file leaves the file one entry behind.
        if stored in (before, self.content()):
            self._written = stored
            self._write()
        else:
            self._take_over(stored)

    def _replay(self, entries: list[Entry]) -> Content | None:
        """Set the state from the last base on; return the content before the last change, if there is one."""
        self.revision, before, base = 0, None, _last_base(entries)
        for number, entry in enumerate(entries[base:], start=base + 1):
            if number == len(entries) > base + 1:
                before = self.content()
            with self._reported(number):
                self.apply(entry)
        return before

    @contextmanager
    def _reported(self, line: int) -> Iterator[None]:
        """Report any error in a line of the journal in one line."""
        try:
            yield
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            place = self._journal.path if self._journal else self.path
            hint = "move the journal away to continue"
            raise VfoaError(f"{place}:{line}: not a change of this clip: {error!r}; {hint}") from None

    def _take_over(self, content: Content) -> None:
        """Begin anew with the content of the file."""
        entry = {**self.base_of(content), "time_s": round(self._clock(), 3)}
        if self._journal is not None:
            self._journal.append(entry)
        self.apply(entry)
        self._written, self._digest = content, self._file_digest()

    def _read(self) -> Content:
        return self.read(self.path if self.path.is_file() else self._origin)

    def _write(self, *, anew: bool = False) -> None:
        content = self.content()
        if anew or content != self._written:
            try:
                self.write(self.path, content)
            except OSError as error:
                reason = f"{error.strerror or error}; the change was not made"
                raise VfoaError(f"{self.path}: cannot be written: {reason}") from None
        self._written, self._digest = content, self._file_digest()

    def _file_digest(self) -> str | None:
        return file_digest(self.path) if self.path.is_file() else None


def _last_base(entries: list[Entry]) -> int:
    """The number of the last entry that begins anew; 0 without one."""
    return max((number for number, entry in enumerate(entries) if "base" in entry), default=0)


def _mode_of(files: Iterable[Path]) -> int | None:
    """The permissions that all of these files give; None without any."""
    modes = [stat.S_IMODE(file.stat().st_mode) for file in files]
    return functools.reduce(operator.and_, modes) if modes else None
