"""The state of a clip's labels as the sum of journal entries: deterministic, and the same after a restart.

An entry is one of

{"base": {subject: stretches}, "frames": n, "revision": r}    begin anew, from a CSV
{"change": {subject, before, after}}                          marks between two positions
{"undo": true}    {"redo": true}
{"targets": {manifest, labels, drawn}, "file": name}          targets change in all files of the clip: a step to undo
{"set": [changes]}                                            the same, undone or made elsewhere: no step to undo
{"seen": [subject, position]}                                 alone, or beside a change

Each entry except a lone ``seen`` is a revision.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from harness.annotate.journaled import Entry
from harness.annotate.marks import Stretch, Track, from_labels, labelled, stretches, to_labels
from harness.annotate.undo import Undo, time_of
from harness.labels.labels import Labels


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A subject's marks between two positions, before and after."""

    subject: str
    before: tuple[Stretch, ...]
    after: tuple[Stretch, ...]

    def plain(self) -> dict[str, Any]:
        """As JSON."""
        before, after = ([each.plain() for each in part] for part in (self.before, self.after))
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


class History:
    """Tracks by subject, the position up to which each was seen, the undo and redo lists, and the revision number."""

    def __init__(self, subjects: Sequence[str], frames: Sequence[int]) -> None:
        self._frames = tuple(frames)
        self.subjects = tuple(subjects)
        self.revision = 0
        self._clear()

    def _clear(self) -> None:
        self.tracks: dict[str, Track] = {name: [None] * len(self._frames) for name in self.subjects}
        self.seen = dict.fromkeys(self.subjects, -1)
        self.undo = Undo[Step]()

    def copy(self) -> History:
        """Return an independent copy of the state."""
        copied = History(self.subjects, self._frames)
        copied.revision, copied.seen = self.revision, dict(self.seen)
        copied.tracks = {name: list(track) for name, track in self.tracks.items()}
        copied.undo = self.undo.copy()
        return copied

    def apply(self, entry: Entry) -> None:
        """Apply one entry; ValueError, KeyError and similar if it does not fit this clip."""
        if "base" in entry:
            self._begin(entry)
        if "seen" in entry:
            subject, at = entry["seen"]
            self.seen[subject] = max(self.seen[subject], self._position(at))
        if "change" in entry:
            self._make(Step(changes=(Change.parse(entry["change"]),)), time_of(entry))
        elif "targets" in entry:
            of_file = entry["targets"]["labels"].get(entry["file"], ())
            self._make(Step(changes=tuple(map(Change.parse, of_file)), targets=entry["targets"]), time_of(entry))
        elif "set" in entry:
            self._set(map(Change.parse, entry["set"]))
            self.undo.clear()
        elif "undo" in entry:
            self._set(change.inverse for change in self.undo.undo(time_of(entry)).changes)
        elif "redo" in entry:
            self._set(self.undo.redo().changes)
        elif "base" not in entry:
            return
        self.revision += 1

    def change_to(self, subject: str, new: Sequence[Stretch]) -> Change:
        """The change that sets these stretches, which follow each other without a gap."""
        before = stretches(self.tracks[subject], new[0].first, new[-1].last)
        return Change(subject=subject, before=before, after=tuple(new))

    def reassigned(self, old: str, new: str) -> list[Change]:
        """The changes that give all labels of a target another one."""
        return [
            self.change_to(subject, [replace(part, mark=replace(part.mark, target=new))])
            for subject, parts in self.parts().items()
            for part in parts
            if part.mark is not None and part.mark.target == old
        ]

    def base_of(self, content: Labels) -> Entry:
        """The entry that begins anew with the CSV's labels."""
        last = len(self._frames) - 1
        tracks = {name: from_labels(content, name, self._frames) for name in self.subjects}
        plain = {name: [each.plain() for each in stretches(track, 0, last)] for name, track in tracks.items()}
        return {"base": plain, "frames": len(self._frames), "revision": self.revision}

    def fits(self, base: Entry) -> bool:
        """Whether a base is of a clip with these frames and subjects."""
        tracks = base["base"]
        return base.get("frames") == len(self._frames) and isinstance(tracks, dict) and {*tracks} == {*self.subjects}

    def content(self) -> Labels:
        """The labels for the CSV."""
        return to_labels(self.tracks, self.seen, self._frames)

    def parts(self) -> dict[str, tuple[Stretch, ...]]:
        """Every subject's whole track."""
        return {name: stretches(track, 0, len(self._frames) - 1) for name, track in self.tracks.items()}

    def labelled(self, parts: dict[str, tuple[Stretch, ...]]) -> int:
        """Number of (frame, subject) pairs in :meth:`parts` that a person has labelled, without undecided ones."""
        return sum(labelled(part, self.seen[subject]) for subject, found in parts.items() for part in found)

    def _begin(self, entry: Entry) -> None:
        self._clear()
        self.revision = max(self.revision, entry["revision"])
        for subject, plain in entry["base"].items():
            self._place(subject, [Stretch.parse(each) for each in plain])

    def _make(self, step: Step, time_s: float) -> None:
        self._set(step.changes)
        self.undo.make(step, time_s)

    def _set(self, changes: Iterable[Change]) -> None:
        for change in changes:
            self._place(change.subject, change.after)

    def _position(self, at: object) -> int:
        if not isinstance(at, int) or not 0 <= at < len(self._frames):
            raise ValueError(f"position {at!r} is outside the clip's {len(self._frames)} frames")
        return at

    def _place(self, subject: str, part: Sequence[Stretch]) -> None:
        for each in part:
            if not 0 <= each.first <= each.last < len(self._frames):
                raise ValueError(f"positions {each.first} to {each.last} of {len(self._frames)} frames")
            self.tracks[subject][each.first : each.last + 1] = [each.mark] * (each.last - each.first + 1)
