"""The shapes drawn on a clip while they are edited: journaled, undoable, and written to ``CLIP.drawn.csv`` at once.

Every change goes to the journal first, as one of

{"base": tracks, "revision": r}                               begin anew, from the file
{"draw": {"name", "kind", "before": keys, "after": keys}}     key frames of a track, [frame, place, outside] each
{"undo": true}    {"redo": true}

A change names its revision; one on an older revision is refused. A file that was changed by another program wins. The
labels have a journal and a file of their own (:mod:`harness.annotate.store`): drawn shapes belong to the clip, whoever
labels it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from harness.annotate.journal import Journal
from harness.annotate.store import OutsideClipError, StaleRevisionError
from harness.files import file_digest
from harness.labels.drawn import (
    Drawn,
    KeyFrame,
    Kind,
    Place,
    Track,
    check_kind,
    check_place,
    drawn_of,
    read_drawn,
    write_drawn,
)
from vfoa.errors import VfoaError, did_you_mean
from vfoa.settings import Settings

Keys = tuple[KeyFrame, ...]
Entry = dict[str, Any]


class Draw(Settings):
    """A person's action on the image, on a revision.

    ``key``: the shape is at ``place`` in the frame at position ``at``. ``outside``: it leaves the image there, or is
    back if it had left. ``delete``: no key frame there. ``remove``: it is not drawn at all. The others take changes
    back.
    """

    do: Literal["key", "outside", "delete", "remove", "undo", "redo"]
    revision: int
    id: str = ""
    name: str = ""
    kind: Kind = "box"
    at: int = 0
    place: tuple[float, ...] = ()


class DrawingStore:
    """The shapes drawn on one clip. Not for several threads at once.

    Parameters
    ----------
    path, journal
        The file and its journal; neither needs to exist. ``origin`` is read if there is no file yet.
    frames, subjects, targets
        The clip's frame numbers and the manifest's names.

    Raises
    ------
    VfoaError
        If the file is wrong. If another process draws on the clip, :attr:`read_only` says so, and nothing can be drawn.
    """

    def __init__(
        self,
        path: Path,
        journal: Path,
        *,
        frames: Sequence[int],
        subjects: Iterable[str],
        targets: Iterable[str],
        origin: Path | None = None,
    ) -> None:
        self.path, self._origin = path, origin
        self._frames, self._subjects, self._targets = tuple(frames), list(subjects), list(targets)
        self._positions = {number: at for at, number in enumerate(self._frames)}
        self._tracks: dict[tuple[str, Kind], Keys] = {}
        self._done: list[Entry] = []
        self._undone: list[Entry] = []
        self._ids: set[str] = set()
        self.revision = 0
        stored = self._read()
        self.read_only: str | None = None
        self._journal: Journal | None = None
        try:
            self._journal = Journal(journal, of=path)
        except VfoaError as error:
            self.read_only = str(error)
            self._begin(stored)
            return
        self._start(stored, self._journal.entries)

    @property
    def drawn(self) -> Drawn:
        """The present shapes."""
        return drawn_of(self._tracks)

    def state(self) -> dict[str, Any]:
        """Everything that the page shows, as JSON; key frames are [position, place, outside]."""
        return {
            "revision": self.revision,
            "tracks": [
                {
                    "name": each.name,
                    "kind": each.kind,
                    "keys": [[self._positions[key.frame], key.place, key.outside] for key in each.keys],
                }
                for each in self.drawn.tracks
            ],
            "can_undo": bool(self._done),
            "can_redo": bool(self._undone),
            "read_only": self.read_only,
        }

    def refresh(self) -> None:
        """Read the file again if another program has changed it."""
        if self._file_digest() != self._digest:
            self._take_over(self._read())

    def make(self, draw: Draw) -> None:
        """Apply a person's action; if it comes again under the same id (its answer was lost), it is not repeated.

        Raises
        ------
        StaleRevisionError
            If something else was drawn since, in another tab or in the file.
        VfoaError
            If a name, a position or a place is wrong, or another process draws on the clip.
        """
        if self.read_only is not None:
            raise VfoaError(self.read_only)
        self.refresh()
        if draw.id and draw.id in self._ids:
            return
        if draw.revision != self.revision:
            raise StaleRevisionError
        if draw.do in ("undo", "redo"):
            if self._done if draw.do == "undo" else self._undone:
                self._commit({draw.do: True}, draw.id)
            return
        self._check(draw)
        before = self._tracks.get((draw.name, draw.kind), ())
        after = _CHANGES[draw.do](before, self._frames[draw.at], draw)
        if after != before:
            self._commit({"draw": _change(draw.name, draw.kind, before, after)}, draw.id)

    def set_names(self, targets: Iterable[str], renamed: tuple[str, str | None] | None = None) -> None:
        """Set the manifest's targets. Shapes of a renamed one are kept; those of a deleted one (None) are removed."""
        self._targets = list(targets)
        if renamed is None or all(name != renamed[0] for name, _ in self._tracks):
            return
        self.check_change(renamed[0])
        old, new = renamed
        kept = {key: keys for key, keys in self._tracks.items() if key[0] != old}
        moved = {(new, kind): keys for (name, kind), keys in self._tracks.items() if name == old and new is not None}
        write_drawn(self.path, drawn_of({**moved, **kept}))
        self.refresh()

    def check_change(self, name: str) -> None:
        """Refuse another name for what is drawn while another process draws (:class:`VfoaError`)."""
        if self.read_only is not None and any(name == each for each, _ in self._tracks):
            raise VfoaError(self.read_only)

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close()

    def _check(self, draw: Draw) -> None:
        names = [*self._targets, *self._subjects]
        if draw.name not in names:
            raise VfoaError(f"no subject or target {draw.name!r}; {did_you_mean(draw.name, names)}")
        others = [kind for name, kind in self._tracks if name == draw.name]
        check_kind(draw.name, draw.kind, self._subjects, others, "drawn")
        if not 0 <= draw.at < len(self._frames):
            raise OutsideClipError(f"position {draw.at} is outside the clip; expected 0 to {len(self._frames) - 1}")
        if draw.do == "key":
            check_place(draw.kind, _rounded(draw.place), "place")

    def _commit(self, entry: Entry, request: str) -> None:
        if self._journal is not None:
            self._journal.append({**entry, "id": request} if request else entry)
        self._apply(entry)
        self._ids |= {request} - {""}
        self._write()

    def _apply(self, entry: Entry) -> None:
        if "base" in entry:
            self._tracks = {(name, kind): _parsed(keys) for name, kind, keys in entry["base"]}
            self._done, self._undone = [], []
            self.revision = max(self.revision, entry["revision"])
        elif "draw" in entry:
            self._place(entry, "after")
            self._done.append(entry)
            self._undone.clear()
        elif "undo" in entry:
            self._undone.append(last := self._done.pop())
            self._place(last, "before")
        else:
            self._done.append(last := self._undone.pop())
            self._place(last, "after")
        self.revision += 1

    def _place(self, entry: Entry, which: str) -> None:
        change = entry["draw"]
        key, keys = (change["name"], change["kind"]), _parsed(change[which])
        self._tracks.pop(key, None)
        if keys:
            self._tracks[key] = keys

    def _start(self, stored: Drawn, entries: list[Entry]) -> None:
        """Use the journal if the file is its result, or one entry behind, as after a kill."""
        bases = [number for number, entry in enumerate(entries) if "base" in entry]
        if not bases:
            self._take_over(stored)
            return
        before = None
        for number, entry in enumerate(entries[bases[-1] :], start=bases[-1] + 1):
            before = None if "base" in entry else self.drawn
            try:
                self._apply(entry)
            except (LookupError, TypeError, ValueError, AttributeError) as error:
                assert self._journal is not None
                raise VfoaError(
                    f"{self._journal.path}:{number}: not a drawing action: {error!r}; move the journal away to continue"
                ) from None
            self._ids |= {entry.get("id", "")} - {""}
        if stored == self.drawn:
            self._digest = self._file_digest()
        elif stored == before:
            self._write()
        else:
            self._take_over(stored)

    def _take_over(self, stored: Drawn) -> None:
        entry = self._begin(stored)
        if self._journal is not None:
            self._journal.append(entry)

    def _begin(self, stored: Drawn) -> Entry:
        base = [[each.name, each.kind, _plain(each.keys)] for each in stored.tracks]
        entry = {"base": base, "revision": self.revision}
        self._apply(entry)
        self._digest = self._file_digest()
        return entry

    def _read(self) -> Drawn:
        source = self.path if self.path.is_file() else self._origin
        if source is None:
            return Drawn()
        return read_drawn(source, frames=self._frames, subjects=self._subjects, targets=self._targets)

    def _write(self) -> None:
        write_drawn(self.path, self.drawn)
        self._digest = self._file_digest()

    def _file_digest(self) -> str | None:
        return file_digest(self.path) if self.path.is_file() else None


def _key(before: Keys, frame: int, draw: Draw) -> Keys:
    return _with(before, KeyFrame(frame=frame, place=draw.place))


def _outside(before: Keys, frame: int, draw: Draw) -> Keys:
    if not before:
        raise VfoaError(f"{draw.name!r} is not drawn; expected a {draw.kind} before it can leave the image")
    track = Track(name=draw.name, kind=draw.kind, keys=before)
    return _with(before, KeyFrame(frame=frame, place=track.place_at(frame), outside=track.at(frame) is not None))


def _delete(before: Keys, frame: int, draw: Draw) -> Keys:
    return tuple(each for each in before if each.frame != frame)


def _remove(before: Keys, frame: int, draw: Draw) -> Keys:
    return ()


_CHANGES: dict[str, Callable[[Keys, int, Draw], Keys]] = {
    "key": _key,
    "outside": _outside,
    "delete": _delete,
    "remove": _remove,
}


def _with(before: Keys, key: KeyFrame) -> Keys:
    """The key frames with another one, which replaces one in the same frame."""
    rounded = replace(key, place=_rounded(key.place))
    return tuple(sorted([*(each for each in before if each.frame != key.frame), rounded], key=lambda each: each.frame))


def _rounded(place: Place) -> Place:
    """Round to a hundredth of a pixel."""
    return tuple(round(each, 2) for each in place)


def _change(name: str, kind: Kind, before: Keys, after: Keys) -> Entry:
    return {"name": name, "kind": kind, "before": _plain(before), "after": _plain(after)}


def _plain(keys: Keys) -> list[list[Any]]:
    return [[each.frame, list(each.place), each.outside] for each in keys]


def _parsed(plain: Iterable[Sequence[Any]]) -> Keys:
    return tuple(KeyFrame(frame=frame, place=tuple(place), outside=outside) for frame, place, outside in plain)
