"""The labels of one clip while they are edited: checked, journaled, undoable, and written to the CSV.

The journal knows more than the CSV: what to undo, and how far labels are carried.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from harness.annotate.history import Change, History, Step
from harness.annotate.journal import Journal
from harness.annotate.journaled import Entry, Journaled, OutsideClipError
from harness.annotate.marks import Mark, Stretch
from harness.annotate.undo import Undo
from harness.labels.files import read_annotations, write_annotations
from harness.labels.labels import RESERVED, Labels
from harness.labels.rows import check_text
from harness.labels.timeline import Timeline
from vfoa.errors import VfoaError, did_you_mean

LONGEST_PAUSE_S = 30.0
"""A longer time between two changes is a break: the rest does not count as working time."""
MEANINGFUL_S, MEANINGFUL_SHARE = 60.0, 0.05
"""Working time, and share of all labels, after which the remaining time is estimated."""


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
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.path, self._timeline = path, timeline
        self._subjects, self._targets = tuple(subjects), list(targets)
        self._frames = tuple(timeline.frames)
        history = History(subjects, self._frames)
        opened = Journal(journal, of=path)
        try:
            self._kept = Journaled(path, opened, history, _File(self), origin=origin, clock=clock)
        except BaseException:
            opened.close()
            raise
        self._labelled_at_start = history.labelled(history.parts())
        self._active_s, self._last_s = 0.0, clock()

    @property
    def _history(self) -> History:
        return self._kept.history

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
            **history.undo.plain(),
        }

    def once(self, request: str) -> AbstractContextManager[bool]:
        """Whether no change was made under this id; changes of the block are recorded under it. "": always true."""
        return self._kept.once(request)

    def knows(self, request: str) -> bool:
        """Whether a change was made under this id."""
        return self._kept.knows(request)

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
        self._kept.undo(revision)
        self._count_work()

    def redo(self, revision: int) -> None:
        """Apply the last undone change again."""
        self._kept.redo(revision)
        self._count_work()

    def see(self, subject: str, at: int) -> None:
        """Note that the person has seen a subject's frames up to a position. It is no revision and disturbs no tab."""
        self._check_subject(subject)
        self.check_position(at)
        self.refresh()
        if at > self._history.seen[subject]:
            self._commit({"seen": [subject, at]})

    def check_revision(self, revision: int) -> None:
        """Reject a change on an older revision (:class:`StaleRevisionError`)."""
        self._kept.check_revision(revision)

    def refresh(self) -> None:
        """Read the CSV again if another program has changed it; write it again if it was deleted."""
        self._kept.refresh()

    def check_position(self, at: int) -> int:
        """Return the position if the clip has it; else raise :class:`OutsideClipError`."""
        if not 0 <= at < len(self._frames):
            raise OutsideClipError(f"position {at} is outside the clip; expected 0 to {len(self._frames) - 1}")
        return at

    def set_targets(self, names: Iterable[str]) -> None:
        """Set the manifest's targets."""
        self._targets = list(names)

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

    def reassigned(self, old: str, new: str) -> list[dict[str, Any]]:
        """The changes, as JSON, that give all labels of a target another one."""
        return [change.plain() for change in self._history.reassigned(old, new)]

    def change_targets(self, change: dict[str, Any]) -> None:
        """Change targets as a step that can be undone; ``change`` has the labels' changes by file name."""
        self._commit({"targets": change, "file": self.path.name})

    def set_marks(self, changes: Sequence[dict[str, Any]]) -> None:
        """Make changes that belong to a change of targets made elsewhere. Earlier steps can no longer be undone."""
        parsed = [Change.parse(each) for each in changes]
        if any(self._history.change_to(each.subject, each.after).before != each.after for each in parsed):
            self._commit({"set": list(changes)})

    def forget_steps(self) -> None:
        """Nothing done before can be undone any more."""
        self._commit({"set": []})

    @property
    def undo_list(self) -> Undo[Step]:
        """What can be undone and redone."""
        return self._history.undo

    def close(self) -> None:
        """Close the journal."""
        self._kept.close()

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
        self._kept.commit(entry)
        self._count_work()

    def _count_work(self) -> None:
        now_s = self._kept.last_s
        if now_s is not None:
            self._active_s += min(max(now_s - self._last_s, 0.0), LONGEST_PAUSE_S)
            self._last_s = now_s

    def read(self, path: Path) -> Labels:
        """A CSV with this store's names (:class:`VfoaError`)."""
        return read_annotations(
            path, timeline=self._timeline, subjects=self._subjects, targets=self._targets, allow_gaps=True
        )

    def _tells(self, gained: int, total: int) -> bool:
        return self._active_s >= MEANINGFUL_S and gained >= MEANINGFUL_SHARE * total


class _File:
    """The CSV of a store, whose names grow."""

    def __init__(self, store: LabelStore) -> None:
        self._store = store

    def read(self, path: Path | None) -> Labels:
        """The labels; none of a file that is not there."""
        return Labels(()) if path is None else self._store.read(path)

    def write(self, path: Path, content: Labels) -> None:
        """Write the CSV."""
        write_annotations(path, content)
