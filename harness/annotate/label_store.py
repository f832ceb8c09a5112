"""The labels of one clip while they are edited: checked, journaled, undoable, and written to the CSV.

The journal knows more than the CSV: what to undo, and how far labels are carried.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.annotate.journal import Entry, JournaledStore, OutsideClipError
from harness.annotate.marks import Mark, Stretch, Track, from_labels, labelled, stretches, to_labels
from harness.labels.files import read_annotations, write_annotations
from harness.labels.labels import RESERVED, Labels, Timeline
from harness.labels.rows import check_text
from vfoa.errors import VfoaError, did_you_mean

LONGEST_PAUSE_S = 30.0
"""A longer time between two changes is a break: the rest does not count as working time."""
MEANINGFUL_S, MEANINGFUL_SHARE = 60.0, 0.05
"""Working time, and share of all labels, after which the remaining time is estimated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A subject's marks between two positions, before and after."""

    subject: str
    before: tuple[Stretch, ...]
    after: tuple[Stretch, ...]

    def plain(self) -> dict[str, Any]:
        """As JSON."""
        before, after = ([stretch.plain() for stretch in part] for part in (self.before, self.after))
        return {"subject": self.subject, "before": before, "after": after}

    @property
    def inverse(self) -> Change:
        """The change back."""
        return Change(subject=self.subject, before=self.after, after=self.before)

    @classmethod
    def parse(cls, plain: dict[str, Any]) -> Change:
        """Parse the output of :meth:`plain`."""
        before, after = (tuple(map(Stretch.parse, plain[name])) for name in ("before", "after"))
        return cls(subject=plain["subject"], before=before, after=after)


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What one undo takes back: changes of labels and, if targets changed, the whole change of targets as JSON."""

    changes: tuple[Change, ...]
    targets: dict[str, Any] | None = None


class LabelStore(JournaledStore[Labels, Step]):
    """One clip's labels by one annotator: tracks by subject, and the position up to which each was seen.

    An entry of the journal is one of

    {"base": {subject: stretches}, "frames": n, "revision": r}    begin anew, from a CSV
    {"change": {subject, before, after}}                          marks between two positions
    {"undo": true}    {"redo": true}
    {"targets": {manifest, labels, drawn}, "file": name}          targets change in all files: a step to undo
    {"set": [changes]}                                            the same, undone or made from another file: not a step
    {"seen": [subject, position]}                                 alone, or beside a change

    Each entry except a lone ``seen`` is a revision.

    Parameters
    ----------
    path, journal
        The CSV and the journal; neither needs to exist.
    timeline, subjects, targets
        The clip's frames and the manifest's names; :attr:`targets` can be replaced. A subject may be a target, too.
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
        self._timeline, self.subjects, self.targets = timeline, tuple(subjects), list(targets)
        self._frames = tuple(timeline.frames)
        self._tracks: dict[str, Track] = {name: [None] * len(self._frames) for name in self.subjects}
        self._seen = dict.fromkeys(self.subjects, -1)
        self._active_s, self._last_s = 0.0, clock()
        super().__init__(path, journal, origin=origin, clock=clock)
        self._labelled_at_start = self._labelled(self._parts())

    def apply(self, entry: Entry) -> None:
        """Change the labels by one entry; ValueError, KeyError and similar if it does not fit this clip."""
        if "base" in entry:
            self._begin(entry)
        if "seen" in entry:
            subject, at = entry["seen"]
            if not isinstance(at, int) or not 0 <= at < len(self._frames):
                raise ValueError(f"position {at!r} is outside the clip's {len(self._frames)} frames")
            self._seen[subject] = max(self._seen[subject], at)
        if "change" in entry:
            self._make(Step(changes=(Change.parse(entry["change"]),)), entry)
        elif "targets" in entry:
            of_file = entry["targets"]["labels"].get(entry["file"], ())
            self._make(Step(changes=tuple(map(Change.parse, of_file)), targets=entry["targets"]), entry)
        elif "set" in entry:
            self._set(map(Change.parse, entry["set"]))
            self.steps.clear()
        elif "undo" in entry:
            self._set(change.inverse for change in self.steps.undo(entry).changes)
        elif "redo" in entry:
            self._set(self.steps.redo().changes)
        elif "base" not in entry:
            return
        self.revision += 1

    def content(self) -> Labels:
        """The labels for the CSV."""
        return to_labels(self._tracks, self._seen, self._frames)

    def base_of(self, content: Labels) -> Entry:
        """The entry that begins anew with the CSV's labels."""
        last = len(self._frames) - 1
        tracks = {name: from_labels(content, name, self._frames) for name in self.subjects}
        plain = {name: [stretch.plain() for stretch in stretches(track, 0, last)] for name, track in tracks.items()}
        return {"base": plain, "frames": len(self._frames), "revision": self.revision}

    def fits(self, base: Entry) -> bool:
        """Whether a base is of a clip with these frames and subjects."""
        tracks = base["base"]
        return base.get("frames") == len(self._frames) and isinstance(tracks, dict) and {*tracks} == {*self.subjects}

    def read(self, path: Path | None) -> Labels:
        """The labels of a CSV with this store's names; none of a file that is not there."""
        if path is None:
            return Labels(())
        return read_annotations(
            path, timeline=self._timeline, subjects=self.subjects, targets=self.targets, allow_gaps=True
        )

    def write(self, path: Path, content: Labels) -> None:
        """Write the CSV."""
        write_annotations(path, content)

    def _begin(self, entry: Entry) -> None:
        self._tracks = {name: [None] * len(self._frames) for name in self.subjects}
        self._seen = dict.fromkeys(self.subjects, -1)
        self.steps.clear()
        self.revision = max(self.revision, entry["revision"])
        for subject, plain in entry["base"].items():
            self._place(subject, [Stretch.parse(stretch) for stretch in plain])

    def _make(self, step: Step, entry: Entry) -> None:
        self._set(step.changes)
        self.steps.make(step, entry)

    def _set(self, changes: Iterable[Change]) -> None:
        for change in changes:
            self._place(change.subject, change.after)

    def _place(self, subject: str, part: Sequence[Stretch]) -> None:
        for stretch in part:
            if not 0 <= stretch.first <= stretch.last < len(self._frames):
                raise ValueError(f"positions {stretch.first} to {stretch.last} of {len(self._frames)} frames")
            self._tracks[subject][stretch.first : stretch.last + 1] = [stretch.mark] * (
                stretch.last - stretch.first + 1
            )

    def _parts(self) -> dict[str, tuple[Stretch, ...]]:
        """Every subject's whole track."""
        return {name: stretches(track, 0, len(self._frames) - 1) for name, track in self._tracks.items()}

    def _labelled(self, parts: Mapping[str, Sequence[Stretch]]) -> int:
        """Number of (frame, subject) pairs of all tracks that a person has labelled, without undecided ones."""
        return sum(labelled(part, self._seen[subject]) for subject, track in parts.items() for part in track)

    def _change_to(self, subject: str, new: Sequence[Stretch]) -> Change:
        """The change that sets these stretches, which follow each other without a gap."""
        before = stretches(self._tracks[subject], new[0].first, new[-1].last)
        return Change(subject=subject, before=before, after=tuple(new))

    def names(self) -> tuple[str, ...]:
        """Every name that can be a target, ``none`` and ``ignore`` last."""
        return (*self.targets, *self.subjects, *RESERVED)

    def track(self, subject: str) -> Sequence[Mark | None]:
        """A subject's marks, one per frame."""
        self._check_subject(subject)
        return self._tracks[subject]

    def seen(self, subject: str) -> int:
        """The last position up to which a subject's frames were seen; -1: none."""
        self._check_subject(subject)
        return self._seen[subject]

    def state(self) -> dict[str, Any]:
        """Everything that the page shows, as JSON."""
        parts = self._parts()
        done, total = self._labelled(parts), len(self._frames) * len(self.subjects)
        gained = done - self._labelled_at_start
        is_known = self._active_s >= MEANINGFUL_S and gained >= MEANINGFUL_SHARE * total
        return {
            "revision": self.revision,
            "tracks": {name: [part.plain() for part in track] for name, track in parts.items()},
            "seen": dict(self._seen),
            "labelled": done,
            "total": total,
            "seconds_left": self._active_s * (total - done) / gained if is_known else None,
            **self.steps.plain(),
        }

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
        for stretch in new:
            self._check_stretch(subject, stretch)
        entry: Entry = {"change": self._change_to(subject, new).plain()}
        self.commit(entry if seen is None else {**entry, "seen": [subject, seen]})

    def see(self, subject: str, at: int) -> None:
        """Note that the person has seen a subject's frames up to a position. The revision does not change."""
        self._check_subject(subject)
        self.check_position(at)
        self.refresh()
        if at > self._seen[subject]:
            self.commit({"seen": [subject, at]})

    def check_position(self, at: int) -> int:
        """Return the position if the clip has it; else raise :class:`OutsideClipError`."""
        if not 0 <= at < len(self._frames):
            raise OutsideClipError(f"position {at} is outside the clip; expected 0 to {len(self._frames) - 1}")
        return at

    def uses(self, target: str) -> int:
        """Number of (frame, subject) pairs with this target, including suggestions and marks carried on."""
        return sum(mark is not None and mark.target == target for name in self.subjects for mark in self.track(name))

    def check_reassignment(self, target: str, to: str) -> None:
        """Reject a new target for all labels of a target if somebody would look at themselves."""
        if to not in self.names() or to == target:
            others = [name for name in self.names() if name != target]
            raise VfoaError(f"unknown target {to!r}; {did_you_mean(to, others)}")
        if to in self.subjects and any(mark is not None and mark.target == target for mark in self.track(to)):
            raise VfoaError(f"{to!r} looks at {target!r} and would look at {to!r}; expected another target, or none")

    def reassigned(self, old: str, new: str) -> list[dict[str, Any]]:
        """The changes, as JSON, that give all labels of a target another one."""
        return [
            self._change_to(subject, [replace(part, mark=replace(part.mark, target=new))]).plain()
            for subject, parts in self._parts().items()
            for part in parts
            if part.mark is not None and part.mark.target == old
        ]

    def change_targets(self, change: dict[str, Any]) -> None:
        """Change targets as a step that can be undone; ``change`` has the labels' changes by file name."""
        self.commit({"targets": change, "file": self.path.name})

    def set_marks(self, changes: Sequence[dict[str, Any]]) -> None:
        """Make the changes that a change of targets causes here. Earlier steps can no longer be undone."""
        parsed = [Change.parse(change) for change in changes]
        if any(self._change_to(change.subject, change.after).before != change.after for change in parsed):
            self.commit({"set": list(changes)})

    def forget_steps(self) -> None:
        """Nothing done before can be undone any more."""
        self.commit({"set": []})

    def commit(self, entry: Entry) -> float:
        """Make a change, and count the time since the last one as work, without breaks."""
        before_s, self._last_s = self._last_s, super().commit(entry)
        self._active_s += min(max(self._last_s - before_s, 0.0), LONGEST_PAUSE_S)
        return self._last_s

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
