"""The labels of one clip while they are edited: checked, journaled, undoable, and written to the CSV.

The journal knows more than the CSV: what to undo, and how far labels are carried.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from harness.annotate.journal import Entry
from harness.annotate.journaled_store import JournaledStore
from harness.annotate.marks import (
    Mark,
    Stretch,
    SubjectMarks,
    from_labels,
    labelled,
    plain_stretches,
    stretches,
    to_labels,
)
from harness.labels.files import read_annotations, write_annotations
from harness.labels.labels import RESERVED, Labels
from harness.labels.rows import check_text
from vfoa.errors import VfoaError, check_known, did_you_mean

Change = dict[str, Any]


class LabelStore(JournaledStore[Labels]):
    """One clip's labels by one annotator: tracks by subject, and the position up to which each was seen.

    A base is {subject: stretches}, beside the number of "frames". A change is {"subject", "before", "after"}: stretches
    that follow each other without a gap, and those that they replace. A step is one of

    {"change": change}
    {"changes": [change, ...]}
    {"targets": {manifest, labels, drawn}, "file": name}    targets change in all files: "labels" has changes by file

    A list of changes is ``set`` where a change of targets is undone, or made from another file: earlier steps can then
    no longer be undone. ``{"seen": [subject, position]}`` stands beside a change, and is undone with it, or alone: then
    it is no revision.

    ``origin`` has the labels to read while there is no CSV: those that came with the program. The first change copies
    them.
    """

    def apply(self, entry: Entry) -> None:
        """Change the labels by one entry; ValueError, KeyError and similar if it does not fit this clip."""
        if "seen" in entry:
            subject, at = entry["seen"]
            before = self._seen_alone[subject]
            if not isinstance(at, int) or not 0 <= at < len(self.frames):
                raise ValueError(f"position {at!r} is outside the clip's {len(self.frames)} frames")
            if not {*entry} - {"seen", "id", "time_s"}:
                self._seen_alone[subject] = max(before, at)
                return
        super().apply(entry)

    def begin(self, base: Mapping[str, Sequence[Any]]) -> None:
        """Set all tracks; nothing of them was seen."""
        self._tracks: dict[str, SubjectMarks] = {name: [None] * len(self.frames) for name in self.subjects}
        super().forget_steps()
        self._seen_alone = dict.fromkeys(self.subjects, -1)
        for subject, plain in base.items():
            self._place(subject, plain)

    def set(self, changes: Iterable[Change]) -> None:
        """Make changes, after which no earlier step can be undone."""
        for change in changes:
            self._place(change["subject"], change["after"])
        self.forget_steps()

    def make(self, step: Entry, side: Literal["before", "after"]) -> None:
        """Set the labels to those before or after a step."""
        for change in _changes(step):
            self._place(change["subject"], change[side])

    def forget_steps(self) -> None:
        """Forget all steps; what was seen by them stays seen."""
        self._seen_alone = self._seen()
        super().forget_steps()

    def describe(self, step: Entry) -> str:
        """The subjects whose labels a step changes."""
        return f"labels of {', '.join(change['subject'] for change in _changes(step))}"

    def content(self) -> Labels:
        """The labels for the CSV."""
        return to_labels(self._tracks, self._seen(), self.frames)

    def base_of(self, content: Labels) -> Entry:
        """The entry that begins anew with the CSV's labels."""
        last = len(self.frames) - 1
        tracks = {name: from_labels(content, name, self.frames) for name in self.subjects}
        plain = {name: plain_stretches(stretches(track, 0, last)) for name, track in tracks.items()}
        return {"base": plain, "frames": len(self.frames)}

    def fits(self, base: Entry) -> bool:
        """Whether a base is of a clip with these frames and subjects."""
        tracks = base["base"]
        return base.get("frames") == len(self.frames) and isinstance(tracks, dict) and {*tracks} == {*self.subjects}

    def read(self, path: Path | None) -> Labels:
        """The labels of a CSV with this store's names; none of a file that is not there."""
        if path is None:
            return Labels(())
        return read_annotations(
            path, timeline=self.timeline, subjects=self.subjects, targets=self.targets, allow_gaps=True
        )

    def write(self, path: Path, content: Labels) -> None:
        """Write the CSV."""
        write_annotations(path, content)

    def _place(self, subject: str, plain: Iterable[Sequence[Any]]) -> None:
        for stretch in map(Stretch.parse, plain):
            if not 0 <= stretch.first <= stretch.last < len(self.frames):
                raise ValueError(f"positions {stretch.first} to {stretch.last} of {len(self.frames)} frames")
            length = stretch.last - stretch.first + 1
            self._tracks[subject][stretch.first : stretch.last + 1] = [stretch.mark] * length

    def _parts(self) -> dict[str, tuple[Stretch, ...]]:
        """Every subject's whole track."""
        return {name: stretches(track, 0, len(self.frames) - 1) for name, track in self._tracks.items()}

    def _change_to(self, subject: str, new: Sequence[Stretch]) -> Change:
        """The change that sets these stretches, which follow each other without a gap."""
        before = stretches(self._tracks[subject], new[0].first, new[-1].last)
        return {"subject": subject, "before": plain_stretches(before), "after": plain_stretches(new)}

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
        return self._seen()[subject]

    def _seen(self) -> dict[str, int]:
        """:meth:`seen` of every subject: alone, or with a step that is not undone."""
        seen = dict(self._seen_alone)
        for subject, at in (step["seen"] for _, step in self._steps["undo"] if "seen" in step):
            seen[subject] = max(seen[subject], at)
        return seen

    def state(self) -> dict[str, Any]:
        """Everything that the page shows, as JSON; undecided frames do not count as labelled."""
        parts, seen = self._parts(), self._seen()
        return {
            "revision": self.revision,
            "tracks": {name: plain_stretches(track) for name, track in parts.items()},
            "seen": seen,
            "labelled": sum(labelled(part, seen[subject]) for subject, track in parts.items() for part in track),
            "total": len(self.frames) * len(self.subjects),
        }

    def put(self, subject: str, new: Sequence[Stretch], *, seen: int | None = None) -> None:
        """Set stretches of a subject's marks, which must follow each other without a gap.

        Parameters
        ----------
        seen
            The position of the last frame that the person has seen for this.

        Raises
        ------
        StaleRevisionError
            If another program has changed the labels since the last :meth:`JournaledStore.refresh`.
        VfoaError
            If a name or a position is not the clip's, or a file cannot be written.
        """
        self._check_subject(subject)
        for stretch in new:
            self._check_stretch(subject, stretch)
        entry: Entry = {"change": self._change_to(subject, new)}
        self.commit(entry if seen is None else {**entry, "seen": [subject, seen]})

    def put_labels(self, labels: Labels, subjects: Iterable[str]) -> None:
        """Replace all labels of these subjects in one step. Raises as :meth:`put`."""
        last = len(self.frames) - 1
        new = {name: stretches(from_labels(labels, name, self.frames), 0, last) for name in subjects}
        for subject, parts in new.items():
            self._check_subject(subject)
            for stretch in parts:
                self._check_stretch(subject, stretch)
        self.commit({"changes": [self._change_to(subject, parts) for subject, parts in new.items()]})

    def see(self, subject: str, at: int) -> None:
        """Note that the person has seen a subject's frames up to a position. The revision does not change."""
        self.check_position(at)
        if at > self.seen(subject):
            self.commit({"seen": [subject, at]})

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

    def reassigned(self, old: str, new: str) -> list[Change]:
        """The changes, as JSON, that give all labels of a target another one."""
        whole = (0, len(self.frames) - 1)
        return [change for subject in self.subjects for change in self._reassigned(subject, whole, old, new)]

    def applicable(self, changes: Iterable[Change]) -> list[Change]:
        """The part of changes by :meth:`reassigned`, made on an earlier state, that applies to the present one.

        A label changes only if it still has the target that the change replaces.
        """
        return [
            now
            for change in changes
            for (first, last, old, *_), (_, _, new, *_) in zip(change["before"], change["after"], strict=True)
            for now in self._reassigned(change["subject"], (first, last), old, new)
        ]

    def _reassigned(self, subject: str, within: tuple[int, int], old: str, new: str) -> Iterator[Change]:
        for part in stretches(self._tracks[subject], *within):
            if part.mark is not None and part.mark.target == old:
                yield self._change_to(subject, [replace(part, mark=replace(part.mark, target=new))])

    def change_targets(self, change: dict[str, Any]) -> None:
        """Change targets as a step that can be undone; ``change`` has the labels' changes by file name."""
        self.commit({"targets": change, "file": self.path.name})

    def set_changes(self, changes: Iterable[Change], gone: Collection[str] = ()) -> None:
        """Make the changes that a change of targets causes here, as far as they are :meth:`applicable`.

        Earlier steps can then no longer be undone, also without a change here, if they would bring back a target that
        is ``gone``. A second time, nothing more happens.
        """
        now = self.applicable(changes)
        if now or self._steps_have(gone):
            self.commit({"set": now})

    def _steps_have(self, targets: Collection[str]) -> bool:
        changes = (change for steps in self._steps.values() for _, step in steps for change in _changes(step))
        parts = (part for change in changes for part in (*change["before"], *change["after"]))
        return any(len(part) > 2 and part[2] in targets for part in parts)

    def _check_subject(self, subject: str) -> None:
        check_known(subject, self.subjects, "unknown subject")

    def _check_stretch(self, subject: str, stretch: Stretch) -> None:
        for at in (stretch.first, stretch.last):
            self.check_position(at)
        mark = stretch.mark
        if stretch.first > stretch.last:
            raise VfoaError(f"position {stretch.first} comes after position {stretch.last}")
        if mark is None:
            return
        check_known(mark.target, self.names(), "unknown target")
        if mark.target == subject:
            raise VfoaError(f"{subject!r} looks at {subject!r}; expected another target, or none")
        check_text((mark.note,), "note")


def _changes(step: Entry) -> Sequence[Change]:
    """The changes of a step in this store's file."""
    if "change" in step:
        return [step["change"]]
    return step["changes"] if "changes" in step else step["targets"]["labels"].get(step["file"], ())
