"""The labels of one clip while they are edited: checked, never lost, never half-written, never overwritten unseen.

Every change goes to the journal first, then the CSV is rewritten. A change names its revision; one on an older revision
is refused. The journal knows more than the CSV (the undo list, how far labels are carried on). It is used at the start
if the CSV is its result; a CSV that was changed by another program wins.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from harness.annotate.history import Entry, History
from harness.annotate.journal import Journal
from harness.annotate.marks import Mark, Stretch, from_labels
from harness.files import file_digest
from harness.labels.files import read_annotations, write_annotations
from harness.labels.labels import RESERVED, Labels
from harness.labels.rows import check_text
from harness.labels.timeline import Timeline
from vfoa.errors import VfoaError, did_you_mean

LONGEST_PAUSE_S = 30.0
"""A longer time between two changes is a break: the rest does not count as working time."""
MEANINGFUL_S, MEANINGFUL_SHARE = 60.0, 0.05
"""Working time, and share of all labels, after which the remaining time is estimated."""


class StaleRevisionError(Exception):
    """The change was made on an older revision."""


class OutsideClipError(VfoaError):
    """There is no such frame in the clip."""


class LabelStore:
    """One clip's labels by one annotator. Not for several threads at once.

    Parameters
    ----------
    path, journal
        The CSV and the journal; neither needs to exist.
    timeline, subjects, targets
        The clip's frames and the manifest's names. A subject may be a target, too.
    origin
        The labels to read while there is no CSV: those that came with the program. The first change copies them.
    fill_gaps
        Write gaps between labels as ``ignore``. For speaking turns, gaps are silence.

    Raises
    ------
    VfoaError
        If the CSV is wrong, or another process labels the same clip.
    """

    def __init__(
        self,
        path: Path,
        journal: Path,
        *,
        timeline: Timeline,
        subjects: Sequence[str],
        targets: Iterable[str],
        origin: Path | None = None,
        fill_gaps: bool = True,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.path, self._timeline, self._targets, self._clock = path, timeline, list(targets), clock
        self._origin = origin
        self._frames = tuple(timeline.frames)
        self._history = History(subjects, self._frames, fill_gaps=fill_gaps)
        self._journal = Journal(journal, of=path)
        self._request, self._requests = "", {entry["id"] for entry in self._journal.entries if "id" in entry}
        try:
            self._start()
        except BaseException:
            self.close()
            raise
        self._labelled_at_start = self._history.labelled(self._history.parts())
        self._active_s, self._last_s = 0.0, clock()

    @property
    def revision(self) -> int:
        """Number of changes; it continues after a restart."""
        return self._history.revision

    @property
    def subjects(self) -> tuple[str, ...]:
        """The people to label."""
        return self._history.subjects

    def names(self) -> tuple[str, ...]:
        """Every name that can be a target, ``none`` and ``ignore`` last."""
        return (*self._targets, *self.subjects, *RESERVED)

    def track(self, subject: str) -> Sequence[Mark | None]:
        """A subject's marks, one per frame."""
        self._check_subject(subject)
        return self._history.tracks[subject]

    def seen(self, subject: str) -> int:
        """The last position up to which a subject's frames were seen; -1: none."""
        self._check_subject(subject)
        return self._history.seen[subject]

    def state(self) -> dict[str, Any]:
        """Everything that the page shows, as JSON."""
        history, parts = self._history, self._history.parts()
        labelled, total = history.labelled(parts), len(self._frames) * len(self.subjects)
        gained = labelled - self._labelled_at_start
        return {
            "revision": history.revision,
            "tracks": {name: [part.plain() for part in found] for name, found in parts.items()},
            "seen": dict(history.seen),
            "labelled": labelled,
            "total": total,
            "seconds_left": self._active_s * (total - labelled) / gained if self._tells(gained, total) else None,
            "can_undo": bool(history.done),
            "can_redo": bool(history.undone),
        }

    @contextmanager
    def once(self, request: str) -> Iterator[bool]:
        """Whether no change was made under this id; changes of the block are recorded under it. "": always true."""
        self._request = request
        try:
            yield request not in self._requests
        finally:
            self._request = ""

    def put(self, revision: int, subject: str, new: Sequence[Stretch], *, seen: int | None = None) -> None:
        """Set stretches of a subject's marks, which must follow each other without a gap.

        Parameters
        ----------
        revision
            The revision on which the change was made.
        seen
            The position of the last frame that the person has seen for this.

        Raises
        ------
        StaleRevisionError
            If the labels have changed since, in another tab or in the file.
        VfoaError
            If a name or a position is not the clip's.
        """
        self.check_revision(revision)
        self._check_subject(subject)
        for each in new:
            self._check_stretch(subject, each)
        entry: Entry = {"change": self._history.change_to(subject, new).plain()}
        self._commit(entry if seen is None else {**entry, "seen": [subject, seen]})

    def undo(self, revision: int) -> None:
        """Take the last change back."""
        self.check_revision(revision)
        if self._history.done:
            self._commit({"undo": True})

    def redo(self, revision: int) -> None:
        """Apply the last undone change again."""
        self.check_revision(revision)
        if self._history.undone:
            self._commit({"redo": True})

    def see(self, subject: str, at: int) -> None:
        """Note that the person has seen a subject's frames up to a position. It is no revision and disturbs no tab."""
        self._check_subject(subject)
        self.check_position(at)
        self.refresh()
        if at > self._history.seen[subject]:
            self._commit({"seen": [subject, at]})

    def check_revision(self, revision: int) -> None:
        """Reject a change on an older revision (:class:`StaleRevisionError`)."""
        self.refresh()
        if revision != self.revision:
            raise StaleRevisionError

    def refresh(self) -> None:
        """Read the CSV again if another program has changed it; write it again if it was deleted."""
        found = self._file_digest()
        if found is None and self._digest is not None:  # deleted; the labels of the open page are kept
            self._write(anew=True)
        elif found != self._digest:
            self._take_over(self._read())

    def check_position(self, at: int) -> int:
        """Return the position if the clip has it; else raise :class:`OutsideClipError`."""
        if not 0 <= at < len(self._frames):
            raise OutsideClipError(f"position {at} is outside the clip; expected 0 to {len(self._frames) - 1}")
        return at

    def add_target(self, name: str) -> None:
        """Allow another name as target."""
        if name not in self._targets:
            self._targets.append(name)

    def uses(self, target: str) -> int:
        """Number of (frame, subject) pairs with this target, including suggestions and marks carried on."""
        return sum(mark is not None and mark.target == target for name in self.subjects for mark in self.track(name))

    def check_reassignment(self, target: str, to: str) -> None:
        """Reject a new target for all labels of a target if somebody would look at themselves."""
        if to not in self.names() or to == target:
            raise VfoaError(
                f"unknown target {to!r}; {did_you_mean(to, [each for each in self.names() if each != target])}"
            )
        if to in self.subjects and any(mark is not None and mark.target == target for mark in self.track(to)):
            raise VfoaError(f"{to!r} looks at {target!r} and would look at {to!r}; expected another target, or none")

    def rename_target(self, old: str, new: str) -> None:
        """Rename a target in every label and in everything that can be undone."""
        renamed = [new if each == old else each for each in self._targets]
        self._commit({"rename": [old, new]})
        self._targets = [each for each in dict.fromkeys(renamed) if each not in {*self.subjects, *RESERVED}]

    def delete_target(self, name: str) -> None:
        """Remove a name that no label has. Earlier changes cannot be undone any more."""
        self._commit({"forget": name})
        self._targets = [each for each in self._targets if each != name]

    def close(self) -> None:
        """Close the journal."""
        self._journal.close()

    def _check_subject(self, subject: str) -> None:
        if subject not in self.subjects:
            raise VfoaError(f"unknown subject {subject!r}; {did_you_mean(subject, self.subjects)}")

    def _check_stretch(self, subject: str, stretch: Stretch) -> None:
        for at in (stretch.first, stretch.last):
            self.check_position(at)
        mark = stretch.mark
        if stretch.first > stretch.last:
            raise VfoaError(f"position {stretch.first} comes after position {stretch.last}")
        if mark is None:
            return
        if mark.target not in self.names():
            raise VfoaError(f"unknown target {mark.target!r}; {did_you_mean(mark.target, self.names())}")
        if mark.target == subject:
            raise VfoaError(f"{subject!r} looks at {subject!r}; expected another target, or none")
        check_text((mark.note,), "note")

    def _commit(self, entry: Entry) -> None:
        now = self._clock()
        self._active_s += min(max(now - self._last_s, 0.0), LONGEST_PAUSE_S)
        self._last_s = now
        request = {"id": self._request} if self._request else {}
        before = self._history.copy()
        place = self._journal.append({**entry, **request, "time_s": round(now, 3)})
        self._history.apply(entry)
        try:
            self._write()
        except VfoaError:  # a change that is not in the CSV is not shown, and not repeated by a restart
            self._history = before
            self._journal.take_back(place)
            raise
        self._requests.update(request.values())

    def _tells(self, gained: int, total: int) -> bool:
        return self._active_s >= MEANINGFUL_S and gained >= MEANINGFUL_SHARE * total

    def _start(self) -> None:
        stored, entries = self._read(), self._journal.entries
        bases = [number for number, entry in enumerate(entries) if "base" in entry]
        if not bases or not self._fits(entries[bases[-1]], bases[-1] + 1):
            self._take_over(stored)
            return
        for number, entry in enumerate(entries[bases[-1] :], start=bases[-1] + 1):
            before = self._history.labels() if entry is entries[-1] and "base" not in entry else None
            self._apply_stored(entry, number)
        # A kill between the journal and the CSV leaves the CSV one entry behind.
        if stored in (before, self._history.labels()):
            self._written = stored
            self._write()
        else:
            self._take_over(stored)

    def _fits(self, base: Entry, line: int) -> bool:
        with self._as_stored(line):
            return self._history.fits(base)

    def _apply_stored(self, entry: Entry, line: int) -> None:
        with self._as_stored(line):
            self._history.apply(entry)

    @contextmanager
    def _as_stored(self, line: int) -> Iterator[None]:
        """Report any error in a line of the journal in one line."""
        try:
            yield
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            raise VfoaError(
                f"{self._journal.path}:{line}: not a change of labels: {error!r}; move the journal away to continue"
            ) from None

    def _take_over(self, labels: Labels) -> None:
        """Begin anew with the CSV's labels."""
        tracks = {name: from_labels(labels, name, self._frames) for name in self.subjects}
        entry = self._history.base_of(tracks)
        self._journal.append({**entry, "time_s": round(self._clock(), 3)})
        self._history.apply(entry)
        self._written, self._digest = labels, self._file_digest()

    def _read(self) -> Labels:
        path = self.path if self.path.is_file() else self._origin
        if path is None:
            return Labels(())
        return read_annotations(
            path, timeline=self._timeline, subjects=self.subjects, targets=self._targets, allow_gaps=True
        )

    def _write(self, *, anew: bool = False) -> None:
        labels = self._history.labels()
        if anew or labels != self._written:
            try:
                write_annotations(self.path, labels)
            except OSError as error:
                raise VfoaError(
                    f"{self.path}: cannot be written: {error.strerror or error}; the change was not made"
                ) from None
        self._written, self._digest = labels, self._file_digest()

    def _file_digest(self) -> str | None:
        return file_digest(self.path) if self.path.is_file() else None
