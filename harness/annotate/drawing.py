"""The shapes drawn on a clip while they are edited: checked, journaled, undoable, and written to ``CLIP.drawn.csv``.

The labels have a journal and a file of their own (:mod:`harness.annotate.store`): the drawing belongs to the clip,
whoever labels it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from harness.annotate.drawn_history import DrawnHistory, Keys, plain_tracks
from harness.annotate.journal import Journal
from harness.annotate.journaled import Journaled, OutsideClipError
from harness.labels.drawn import (
    Drawn,
    KeyFrame,
    Kind,
    Place,
    Track,
    check_kind,
    check_place,
    read_drawn,
    write_drawn,
)
from vfoa.errors import VfoaError, did_you_mean
from vfoa.settings import Settings


class Draw(Settings):
    """A person's action on the image, on a revision.

    ``key``: the shape is at ``place`` in the frame at position ``at``. ``outside``: it leaves the image there, or is
    back if it had left. ``delete``: remove the key frame there. ``remove``: remove the whole shape. The others undo and
    redo changes.
    """

    do: Literal["key", "outside", "delete", "remove", "undo", "redo"]
    revision: int = 0
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
        self.path = path
        self._frames, self._subjects, self._targets = tuple(frames), list(subjects), list(targets)
        self._positions = {number: at for at, number in enumerate(self._frames)}
        self.read_only: str | None = None
        opened: Journal | None = None
        try:
            opened = Journal(journal, of=path)
        except VfoaError as error:
            self.read_only = str(error)
        try:
            self._kept = Journaled(path, opened, DrawnHistory(), _File(self), origin=origin)
        except BaseException:
            if opened is not None:
                opened.close()
            raise

    @property
    def revision(self) -> int:
        """Counts the changes; goes on after a restart."""
        return self._history.revision

    @property
    def drawn(self) -> Drawn:
        """The present shapes."""
        return self._history.content()

    @property
    def _history(self) -> DrawnHistory:
        return self._kept.history

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
            **self._history.undo.plain(),
            "read_only": self.read_only,
        }

    def refresh(self) -> None:
        """Read the file again if another program has changed it."""
        self._kept.refresh()

    def make(self, draw: Draw) -> None:
        """Apply a person's action; if it comes again under the same id (its answer was lost), it is not repeated.

        Raises
        ------
        StaleRevisionError
            If something else was drawn since, in another tab or in the file.
        VfoaError
            If a name, a position or a place is wrong, or another process draws on the clip.
        """
        self.check_writable()
        with self._kept.once(draw.id) as is_new:
            if is_new:
                self._make(draw)

    def put(self, drawn: Drawn) -> None:
        """Replace the shapes of the drawing's names; each track is a change that can be undone.

        Raises
        ------
        VfoaError
            If another process draws on the clip.
        """
        self.check_writable()
        new = {(each.name, each.kind): each.keys for each in drawn.tracks}
        gone = [key for key in self._history.tracks if key[0] in drawn.names and key not in new]
        for (name, kind), keys in [*((key, ()) for key in gone), *new.items()]:
            if keys != self._history.tracks.get((name, kind), ()):
                self._kept.commit(self._history.change_to(name, kind, keys))

    def knows(self, request: str) -> bool:
        """Whether something was drawn under this id."""
        return self._kept.knows(request)

    def set_targets(self, names: Iterable[str]) -> None:
        """Set the manifest's targets."""
        self._targets = list(names)

    def tracks(self) -> list[list[Any]]:
        """The drawing as JSON: name, kind and key frames of each track."""
        return plain_tracks(self.drawn)

    def set_tracks(self, tracks: list[list[Any]]) -> None:
        """Replace the drawing after a change of targets; it is no step to undo.

        Raises
        ------
        VfoaError
            If another process draws on the clip.
        """
        if tracks != self.tracks():
            self.check_writable()
            self._kept.commit({"set": tracks})

    def check_writable(self) -> None:
        """Refuse (:class:`VfoaError`) to change what is drawn while another process draws."""
        if self.read_only is not None:
            raise VfoaError(self.read_only)

    def undo_state(self) -> dict[str, Any]:
        """What can be undone and redone, as JSON: nothing of a name that the manifest no longer has."""
        undo, known = self._history.undo, {*self._targets, *self._subjects}
        steps = {"can_undo": undo.next_undo, "can_redo": undo.next_redo}
        return {**undo.plain(), **{key: step is not None and step["name"] in known for key, step in steps.items()}}

    def read(self, path: Path) -> Drawn:
        """A file with this clip's frames and names (:class:`VfoaError`)."""
        return read_drawn(path, frames=self._frames, subjects=self._subjects, targets=self._targets)

    def close(self) -> None:
        """Close the journal."""
        self._kept.close()

    def _make(self, draw: Draw) -> None:
        if draw.do in ("undo", "redo"):
            (self._kept.undo if draw.do == "undo" else self._kept.redo)(draw.revision)
        else:
            self._kept.check_revision(draw.revision)
            self._check(draw)
            before = self._history.tracks.get((draw.name, draw.kind), ())
            after = _CHANGES[draw.do](before, self._frames[draw.at], draw)
            if after != before:
                self._kept.commit(self._history.change_to(draw.name, draw.kind, after))

    def _check(self, draw: Draw) -> None:
        names = [*self._targets, *self._subjects]
        if draw.name not in names:
            raise VfoaError(f"no subject or target {draw.name!r}; {did_you_mean(draw.name, names)}")
        others = [kind for name, kind in self._history.tracks if name == draw.name]
        check_kind(draw.name, draw.kind, self._subjects, others, "drawn")
        if not 0 <= draw.at < len(self._frames):
            raise OutsideClipError(f"position {draw.at} is outside the clip; expected 0 to {len(self._frames) - 1}")
        if draw.do == "key":
            check_place(draw.kind, _rounded(draw.place), "place")


class _File:
    """The file of a store, whose names change."""

    def __init__(self, store: DrawingStore) -> None:
        self._store = store

    def read(self, path: Path | None) -> Drawn:
        """Return the drawing; an empty one if there is no file."""
        return Drawn() if path is None else self._store.read(path)

    def write(self, path: Path, content: Drawn) -> None:
        """Write the file."""
        write_drawn(path, content)


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
