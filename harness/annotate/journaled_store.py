"""A file of a clip that is changed step by step: never lost, never half-written, never overwritten unnoticed.

Every change goes to a journal first (:mod:`harness.annotate.journal`); then the file is rewritten. The state is the sum
of the journal's entries, which know more than the file (the undo list). A change names its revision; one on an older
revision is refused. The journal is used at the start if the file is its result; a file that was changed by another
program wins.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from harness.annotate.journal import Entry, Journal
from harness.files.digests import file_digest
from harness.labels.labels import Timeline
from vfoa.errors import VfoaError

StepBack = Literal["undo", "redo"]
TimedStep = tuple[float, Entry]
Content = TypeVar("Content")


class StaleRevisionError(Exception):
    """The change was made on an older revision."""


class OutsideClipError(VfoaError):
    """There is no such frame in the clip."""


class JournaledStore(ABC, Generic[Content]):
    """A file, its journal, and the state that is the sum of the journal's entries. Not for several threads at once.

    An entry of the journal is one of

    {"base": ..., "revision": r}     begin anew with the content of the file
    {"set": ...}                     a change that cannot be undone
    {"undo": true}                   take back the last step
    {"redo": true}                   make the last step that was undone again

    or a step, whose form is the store's own. The same entries give the same state, and each of them is a revision.

    Parameters
    ----------
    path, journal
        The file and its journal, neither of which needs to exist. ``origin`` is read without a file.
    timeline, subjects, targets
        The clip's frames and the manifest's names; :attr:`targets` can be replaced. A subject may be a target, too.

    Raises
    ------
    VfoaError
        If file or journal are wrong, or another process changes the file.
    """

    may_be_read_only = False
    """If another process has the journal, :attr:`read_only` says so, and nothing can be changed."""

    def __init__(
        self,
        path: Path,
        journal: Path,
        *,
        timeline: Timeline,
        subjects: Iterable[str],
        targets: Iterable[str],
        origin: Path | None = None,
    ) -> None:
        self.path, self.subjects, self.targets = path, tuple(subjects), list(targets)
        self.timeline, self.frames = timeline, tuple(timeline.frames)
        self.revision = 0
        """Number of changes; it continues after a restart."""
        self.read_only: str | None = None
        self._steps: dict[StepBack, list[TimedStep]] = {"undo": [], "redo": []}
        self._origin = origin
        self._journal: Journal | None = None
        self._request = ""
        try:
            self._journal = Journal(journal, of=path)
        except VfoaError as error:
            if not self.may_be_read_only:
                raise
            self.read_only = str(error)
        try:
            entries = self._journal.read() if self._journal else []
            self.requests = {entry["id"] for entry in entries if "id" in entry}
            """The ids under which changes were made."""
            self.last_request = entries[-1].get("id", "") if entries else ""
            """The id under which the last change was made; empty for one without, and for one of another program."""
            self._start(self._read(), entries)
        except BaseException:
            self.close()
            raise

    @abstractmethod
    def begin(self, base: Any) -> None:
        """Set the state to a base; ValueError, KeyError and similar if it does not fit this clip."""

    @abstractmethod
    def set(self, value: Any) -> None:
        """Make a change that cannot be undone; raises the errors of :meth:`begin`."""

    @abstractmethod
    def make(self, step: Entry, side: Literal["before", "after"]) -> None:
        """Set the state to the one before or after a step; raises the errors of :meth:`begin`."""

    @abstractmethod
    def describe(self, step: Entry) -> str:
        """What a step changes, in a few words."""

    @abstractmethod
    def content(self) -> Content:
        """The content of the file."""

    @abstractmethod
    def base_of(self, content: Content) -> Entry:
        """The entry that begins anew with the content of the file, without the revision."""

    def fits(self, base: Entry) -> bool:
        """Whether a base belongs to this clip. If not, comparing its result with the file shows it, too."""
        return True

    @abstractmethod
    def read(self, path: Path | None) -> Content:
        """The content of a file (:class:`VfoaError` if it is wrong); None: of a file that does not exist."""

    @abstractmethod
    def write(self, path: Path, content: Content) -> None:
        """Write all of it, or nothing."""

    def apply(self, entry: Entry) -> None:
        """Change the state by one entry; raises the errors of :meth:`begin`."""
        time_s = float(entry.get("time_s", 0))
        if "base" in entry:
            self.begin(entry["base"])
            self.forget_steps()
            self.revision = max(self.revision, entry["revision"])
        elif "set" in entry:
            self.set(entry["set"])
        elif "undo" in entry:
            _, step = self._steps["undo"].pop()
            self._steps["redo"].append((time_s, step))
            self.make(step, "before")
        elif "redo" in entry:
            _, step = self._steps["redo"].pop()
            self._steps["undo"].append((float(step.get("time_s", 0)), step))
            self.make(step, "after")
        else:
            self.make(entry, "after")
            self._steps["undo"].append((time_s, entry))
            self._steps["redo"].clear()
        self.revision += 1

    def last_step(self, kind: StepBack) -> TimedStep | None:
        """The step that is undone, or made again, next, after the time at which it was made, or undone; or None.

        Times order the steps of two stores: :meth:`Journal.next_time_s`.
        """
        return self._steps[kind][-1] if self._steps[kind] else None

    def forget_steps(self) -> None:
        """Forget all steps: nothing can be undone or redone."""
        for steps in self._steps.values():
            steps.clear()

    @contextmanager
    def under(self, request: str) -> Iterator[None]:
        """Give changes in the block the id of a request, by which :attr:`requests` knows them. An empty one is none."""
        self._request = request
        try:
            yield
        finally:
            self._request = ""

    def check_position(self, at: int) -> int:
        """Return the position if the clip has it; else raise :class:`OutsideClipError`."""
        if not 0 <= at < len(self.frames):
            raise OutsideClipError(f"position {at} is outside the clip; expected 0 to {len(self.frames) - 1}")
        return at

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

    def step_back(self, kind: StepBack) -> None:
        """Take the last step back, or make the last undone one again; nothing if there is none."""
        self.refresh()
        if self.last_step(kind) is not None:
            self.commit({kind: True})

    def commit(self, entry: Entry) -> None:
        """Apply a change to the present state. A change that fails leaves it as it was.

        Raises
        ------
        StaleRevisionError
            If another program has changed the file.
        VfoaError
            If the journal or the file cannot be written, or another process changes the file.
        """
        self.check_writable()
        revision = self.revision
        self.refresh()
        if revision != self.revision:
            raise StaleRevisionError
        assert self._journal is not None
        request = {"id": self._request} if self._request else {}
        entry = {**entry, **request, "time_s": self._journal.next_time_s()}
        offset = self._journal.append(entry)
        try:
            with self._reported(""):
                self.apply(entry)
            self._write()
        except VfoaError:  # a change that is not in the file is not shown, and not repeated by a restart
            self._journal.take_back(offset)
            self._replay(self._journal.read())
            raise
        self.requests.update(request.values())
        self.last_request = self._request

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close()

    def _start(self, stored: Content, entries: list[Entry]) -> None:
        base = _last_base(entries)
        with self._reported(f"{base + 1}:"):
            fits = bool(entries) and "base" in entries[base] and self.fits(entries[base])
        if not fits:
            self._take_over(stored)
            return
        before = self._replay(entries)
        # A kill between the journal and the file leaves the file one entry behind, and older than the journal.
        if stored == self.content() or (stored == before and not self._was_put_back()):
            self._written = stored
            self._write()
        else:
            self._take_over(stored)

    def _was_put_back(self) -> bool:
        """Whether the file was changed after the journal: somebody has restored an earlier version of it."""
        if self._journal is None or not self.path.is_file():
            return False
        return self.path.stat().st_ctime_ns > self._journal.changed_ns

    def _replay(self, entries: list[Entry]) -> Content | None:
        """Set the state from the last base on; return the content before the last change, if there is one."""
        self.revision, before, base = 0, None, _last_base(entries)
        for number, entry in enumerate(entries[base:], start=base + 1):
            if number == len(entries) > base + 1:
                before = self.content()
            with self._reported(f"{number}:"):
                self.apply(entry)
        return before

    @contextmanager
    def _reported(self, line: str) -> Iterator[None]:
        """Report any error in an entry of the journal in one line."""
        try:
            yield
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            place = self._journal.path if self._journal else self.path
            hint = "move the journal away to continue"
            raise VfoaError(f"{place}:{line} found no valid change of this clip ({error!r}); {hint}") from None

    def _take_over(self, content: Content) -> None:
        """Begin anew with the content of the file."""
        entry = {**self.base_of(content), "revision": self.revision}
        if self._journal is not None:
            self._journal.append({**entry, "time_s": self._journal.next_time_s()})
        self.apply(entry)
        self.last_request = ""
        self._written, self._digest = self.content(), self._file_digest()  # the same labels, in fewer rows

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
