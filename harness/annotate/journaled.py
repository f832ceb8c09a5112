"""A file of a clip that is changed step by step: never lost, never half-written, never overwritten unnoticed.

Every change goes to the journal first, then the file is rewritten. A change names its revision; one on an older
revision is refused. The journal knows more than the file (the undo list). It is used at the start if the file is its
result; a file that was changed by another program wins.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, Protocol, Self, TypeVar

from harness.annotate.journal import Journal
from harness.annotate.undo import Undo
from harness.files.digests import file_digest
from vfoa.errors import VfoaError

Entry = dict[str, Any]
Content = TypeVar("Content")
Machine = TypeVar("Machine", bound="History[Any]")


class StaleRevisionError(Exception):
    """The change was made on an older revision."""


class OutsideClipError(VfoaError):
    """There is no such frame in the clip."""


class History(Protocol[Content]):
    """A state as the sum of journal entries: deterministic, and the same after a restart."""

    revision: int
    undo: Undo[Any]

    def apply(self, entry: Entry) -> None:
        """Apply one entry; ValueError, KeyError and similar if it does not fit this clip."""
        ...

    def content(self) -> Content:
        """The contents of the file."""
        ...

    def base_of(self, content: Content) -> Entry:
        """The entry that begins anew with what the file holds."""
        ...

    def fits(self, base: Entry) -> bool:
        """Whether a base is of this clip."""
        ...

    def copy(self) -> Self:
        """Return an independent copy of the state."""
        ...


class File(Protocol[Content]):
    """The reader and writer of the contents."""

    def read(self, path: Path | None) -> Content:
        """The contents; ``path`` None: those of a file that does not exist."""
        ...

    def write(self, path: Path, content: Content) -> None:
        """Write all of it, or nothing."""
        ...


class Journaled(Generic[Machine]):
    """A history, its journal and its file.

    Parameters
    ----------
    path, journal
        The file, which need not exist, and its journal; None: nothing can be changed.
    history, file
        The state, and its reader and writer.
    origin
        The file to read if ``path`` does not exist.
    """

    def __init__(
        self,
        path: Path,
        journal: Journal | None,
        history: Machine,
        file: File[Any],
        *,
        origin: Path | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.path, self.history = path, history
        self._journal, self._file, self._origin, self._clock = journal, file, origin, clock
        entries = journal.entries if journal else []
        self.last_s: float | None = None
        """The time of the last change made here, in seconds since 1970."""
        self._request, self._requests = "", {entry["id"] for entry in entries if "id" in entry}
        self._start(self._read(), entries)

    @contextmanager
    def once(self, request: str) -> Iterator[bool]:
        """Whether no change was made under this id; changes of the block are recorded under it. "": always true."""
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
        if revision != self.history.revision:
            raise StaleRevisionError

    def refresh(self) -> None:
        """Read the file again if another program has changed it; write it again if it was deleted."""
        found = self._file_digest()
        if found is None and self._digest is not None:  # deleted; the state of the open page is kept
            self._write(anew=True)
        elif found != self._digest:
            self._take_over(self._read())

    def undo(self, revision: int) -> None:
        """Take the last change back."""
        self.check_revision(revision)
        if self.history.undo:
            self.commit({"undo": True})

    def redo(self, revision: int) -> None:
        """Apply the last undone change again."""
        self.check_revision(revision)
        if self.history.undo.can_redo:
            self.commit({"redo": True})

    def commit(self, entry: Entry) -> None:
        """Make a change. A change that fails is not made.

        Raises
        ------
        VfoaError
            If the journal or the file cannot be written.
        """
        assert self._journal is not None, "what may not be changed is refused before"
        now_s = self._clock()
        request = {"id": self._request} if self._request else {}
        entry = {**entry, **request, "time_s": round(now_s, 3)}
        before = self.history.copy()
        place = self._journal.append(entry)
        self.history.apply(entry)
        try:
            self._write()
        except VfoaError:  # a change that is not in the file is not shown, and not repeated by a restart
            self.history = before
            self._journal.take_back(place)
            raise
        self._requests.update(request.values())
        self.last_s = now_s

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close()

    def _start(self, stored: Any, entries: list[Entry]) -> None:
        bases = [number for number, entry in enumerate(entries) if "base" in entry]
        if not bases or not self._fits(entries[bases[-1]], bases[-1] + 1):
            self._take_over(stored)
            return
        for number, entry in enumerate(entries[bases[-1] :], start=bases[-1] + 1):
            is_last_change = entry is entries[-1] and "base" not in entry
            before = self.history.content() if is_last_change else None
            with self._as_stored(number):
                self.history.apply(entry)
        # A kill between the journal and the file leaves the file one entry behind.
        if stored in (before, self.history.content()):
            self._written = stored
            self._write()
        else:
            self._take_over(stored)

    def _fits(self, base: Entry, line: int) -> bool:
        with self._as_stored(line):
            return self.history.fits(base)

    @contextmanager
    def _as_stored(self, line: int) -> Iterator[None]:
        """Report any error in a line of the journal in one line."""
        try:
            yield
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            place = self._journal.path if self._journal else self.path
            raise VfoaError(
                f"{place}:{line}: not a change of this clip: {error!r}; move the journal away to continue"
            ) from None

    def _take_over(self, content: Any) -> None:
        """Begin anew with the content of the file."""
        entry = {**self.history.base_of(content), "time_s": round(self._clock(), 3)}
        if self._journal is not None:
            self._journal.append(entry)
        self.history.apply(entry)
        self._written, self._digest = content, self._file_digest()

    def _read(self) -> Any:
        return self._file.read(self.path if self.path.is_file() else self._origin)

    def _write(self, *, anew: bool = False) -> None:
        content = self.history.content()
        if anew or content != self._written:
            try:
                self._file.write(self.path, content)
            except OSError as error:
                raise VfoaError(
                    f"{self.path}: cannot be written: {error.strerror or error}; the change was not made"
                ) from None
        self._written, self._digest = content, self._file_digest()

    def _file_digest(self) -> str | None:
        return file_digest(self.path) if self.path.is_file() else None
