"""The shapes drawn on a clip while they are edited: checked, journaled, undoable, and written to ``CLIP.drawn.csv``.

The labels have a journal and a file of their own: the drawing belongs to the clip, whoever labels it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from harness.annotate.journal import Entry, JournaledStore, OutsideClipError
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


class Draw(Settings):
    """A person's action on the image.

    ``key``: the shape is at ``place`` in the frame at position ``at``. ``outside``: it leaves the image there, or is
    back if it had left. ``delete``: remove the key frame there. ``remove``: remove the whole shape.
    """

    do: Literal["key", "outside", "delete", "remove"] = "key"
    name: str = ""
    kind: Kind = "box"
    at: int = 0
    place: tuple[float, ...] = ()


def _plain_tracks(content: Drawn) -> list[list[Any]]:
    """A drawing as JSON: name, kind and key frames of each track."""
    return [[track.name, track.kind, _plain(track.keys)] for track in content.tracks]


def _plain(keys: Keys) -> list[list[Any]]:
    return [[key.frame, list(key.place), key.outside] for key in keys]


def _parsed(plain: Iterable[Sequence[Any]]) -> Keys:
    return tuple(KeyFrame(frame=frame, place=tuple(place), outside=outside) for frame, place, outside in plain)


class DrawingStore(JournaledStore[Drawn, dict[str, Any]]):
    """The shapes drawn on one clip: key frames by name and kind. Not for several threads at once.

    An entry of the journal is one of

    {"base": tracks, "revision": r}                               begin anew, from the file
    {"draw": {"name", "kind", "before": keys, "after": keys}}     key frames of a track, [frame, place, outside] each
    {"set": tracks}                                               targets were renamed, deleted or restored
    {"undo": true}    {"redo": true}

    Parameters
    ----------
    path, journal
        The file and its journal; neither needs to exist. ``origin`` is read if there is no file yet.
    frames, subjects, targets
        The clip's frame numbers and the manifest's names; :attr:`targets` can be replaced.

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
        self._frames, self._subjects, self.targets = tuple(frames), list(subjects), list(targets)
        self._positions = {number: at for at, number in enumerate(self._frames)}
        self._tracks: dict[tuple[str, Kind], Keys] = {}
        super().__init__(path, journal, origin=origin, may_be_read_only=True)

    def apply(self, entry: Entry) -> None:
        """Change the drawing by one entry; ValueError, KeyError and similar if it does not fit this clip."""
        if "base" in entry:
            self._set(entry["base"])
            self.steps.clear()
            self.revision = max(self.revision, entry["revision"])
        elif "draw" in entry:
            self._place(entry["draw"], "after")
            self.steps.make(entry["draw"], entry)
        elif "set" in entry:
            self._set(entry["set"])
        elif "undo" in entry:
            self._place(self.steps.undo(entry), "before")
        else:
            self._place(self.steps.redo(), "after")
        self.revision += 1

    def content(self) -> Drawn:
        """The present shapes, as in the file."""
        return drawn_of(self._tracks)

    def base_of(self, content: Drawn) -> Entry:
        """The entry that begins anew with the content of the file."""
        return {"base": _plain_tracks(content), "revision": self.revision}

    def read(self, path: Path | None) -> Drawn:
        """A file with this clip's frames and names (:class:`VfoaError`); an empty drawing without a file."""
        if path is None:
            return Drawn()
        return read_drawn(path, frames=self._frames, subjects=self._subjects, targets=self.targets)

    def write(self, path: Path, content: Drawn) -> None:
        """Write the file."""
        write_drawn(path, content)

    def _set(self, tracks: Iterable[Sequence[Any]]) -> None:
        self._tracks = {(name, kind): _parsed(keys) for name, kind, keys in tracks}

    def _place(self, change: dict[str, Any], which: str) -> None:
        key, keys = (change["name"], change["kind"]), _parsed(change[which])
        self._tracks.pop(key, None)
        if keys:
            self._tracks[key] = keys

    def state(self) -> dict[str, Any]:
        """Everything that the page shows, as JSON; key frames are [position, place, outside]."""
        return {
            "revision": self.revision,
            "tracks": [
                {
                    "name": track.name,
                    "kind": track.kind,
                    "keys": [[self._positions[key.frame], key.place, key.outside] for key in track.keys],
                }
                for track in self.content().tracks
            ],
            **self.steps.plain(),
            "read_only": self.read_only,
        }

    def make(self, revision: int, draw: Draw) -> None:
        """Apply a person's action.

        Raises
        ------
        StaleRevisionError
            If something else was drawn since the revision, in another tab or in the file.
        VfoaError
            If a name, a position or a place is wrong, or another process draws on the clip.
        """
        self.check_revision(revision)
        self._check(draw)
        before = self._tracks.get((draw.name, draw.kind), ())
        after = _changed(before, self._frames[draw.at], draw)
        if after != before:
            change = {"name": draw.name, "kind": draw.kind, "before": _plain(before), "after": _plain(after)}
            self.commit({"draw": change})

    def tracks(self) -> list[list[Any]]:
        """The drawing as JSON: name, kind and key frames of each track."""
        return _plain_tracks(self.content())

    def set_tracks(self, tracks: list[list[Any]]) -> None:
        """Replace the drawing after a change of targets; this cannot be undone as a step.

        Raises
        ------
        VfoaError
            If another process draws on the clip.
        """
        if tracks != self.tracks():
            self.commit({"set": tracks})

    def undo_state(self) -> dict[str, Any]:
        """Whether undo and redo are possible, as JSON; steps of a name that the manifest no longer has do not count."""
        known = {*self.targets, *self._subjects}
        steps = {"can_undo": self.steps.next("undo"), "can_redo": self.steps.next("redo")}
        return self.steps.plain() | {key: step is not None and step["name"] in known for key, step in steps.items()}

    def _check(self, draw: Draw) -> None:
        names = [*self.targets, *self._subjects]
        if draw.name not in names:
            raise VfoaError(f"no subject or target {draw.name!r}; {did_you_mean(draw.name, names)}")
        others = [kind for name, kind in self._tracks if name == draw.name]
        check_kind(draw.name, draw.kind, self._subjects, others, "drawn")
        if not 0 <= draw.at < len(self._frames):
            raise OutsideClipError(f"position {draw.at} is outside the clip; expected 0 to {len(self._frames) - 1}")
        if draw.do == "key":
            check_place(draw.kind, _rounded(draw.place), "place")


def _changed(before: Keys, frame: int, draw: Draw) -> Keys:
    """The key frames of a track after an action in a frame."""
    match draw.do:
        case "key":
            key = KeyFrame(frame=frame, place=draw.place)
        case "outside":
            if not before:
                raise VfoaError(f"{draw.name!r} is not drawn; expected a {draw.kind} before it can leave the image")
            track = Track(name=draw.name, kind=draw.kind, keys=before)
            key = KeyFrame(frame=frame, place=track.place_at(frame), outside=track.at(frame) is not None)
        case "delete":
            return tuple(other for other in before if other.frame != frame)
        case "remove":
            return ()
    others = (other for other in before if other.frame != frame)
    return tuple(sorted([*others, replace(key, place=_rounded(key.place))], key=lambda other: other.frame))


def _rounded(place: Place) -> Place:
    """Round to a hundredth of a pixel."""
    return tuple(round(coordinate, 2) for coordinate in place)
