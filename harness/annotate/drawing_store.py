"""The shapes drawn on a clip while they are edited: checked, journaled, undoable, and written to ``CLIP.drawn.csv``.

The labels have a journal and a file of their own: the drawing belongs to the clip, whoever labels it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from harness.annotate.journal import Entry
from harness.annotate.journaled_store import JournaledStore, StepBack, TimedStep
from harness.labels.drawn_shapes import (
    Drawn,
    KeyedShape,
    KeyFrame,
    Kind,
    Place,
    check_kind,
    check_place,
    drawn_of,
    read_drawn,
    write_drawn,
)
from vfoa.errors import VfoaError, check_known
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


class DrawingStore(JournaledStore[Drawn]):
    """The shapes drawn on one clip: key frames by name and kind. Not for several threads at once.

    A base is a list of tracks: name, kind and key frames (frame, place, outside). It is ``set`` where targets were
    renamed, deleted or restored. A step is {"draw": {"name", "kind", "before": key frames, "after": key frames}}.

    ``origin`` is read if there is no file yet. If another process draws on the clip, nothing can be drawn.
    """

    may_be_read_only = True

    def begin(self, base: Iterable[Sequence[Any]]) -> None:
        """Set all tracks."""
        self._tracks = {(name, kind): _parsed(keys) for name, kind, keys in base}

    def set(self, value: Iterable[Sequence[Any]]) -> None:
        """Set all tracks."""
        self.begin(value)

    def make(self, step: Entry, side: Literal["before", "after"]) -> None:
        """Set the key frames of a track to those before or after a step."""
        change = step["draw"]
        key, keys = (change["name"], change["kind"]), _parsed(change[side])
        self._tracks.pop(key, None)
        if keys:
            self._tracks[key] = keys

    def describe(self, step: Entry) -> str:
        """The shape that a step changes."""
        return f"{step['draw']['kind']} of {step['draw']['name']}"

    def content(self) -> Drawn:
        """The present shapes, as in the file."""
        return drawn_of(self._tracks)

    def base_of(self, content: Drawn) -> Entry:
        """The entry that begins anew with the content of the file."""
        return {"base": _plain_tracks(content)}

    def read(self, path: Path | None) -> Drawn:
        """A file with this clip's frames and names (:class:`VfoaError`); an empty drawing without a file."""
        if path is None:
            return Drawn()
        return read_drawn(path, frames=self.frames, subjects=self.subjects, targets=self.targets)

    def write(self, path: Path, content: Drawn) -> None:
        """Write the file."""
        write_drawn(path, content)

    def last_step(self, kind: StepBack) -> TimedStep | None:
        """As the base class, but only a step after which, or before which, the shape is as it is now.

        A change of targets is no step: by now its name can be gone, or be that of another target.
        """
        if (last := super().last_step(kind)) is None:
            return None
        change = last[1]["draw"]
        is_known = change["name"] in {*self.targets, *self.subjects}
        now = self._tracks.get((change["name"], change["kind"]), ())
        return last if is_known and now == _parsed(change["after" if kind == "undo" else "before"]) else None

    def state(self) -> dict[str, Any]:
        """Everything that the page shows, as JSON; key frames are [position, place, outside]."""
        positions = {number: at for at, number in enumerate(self.frames)}
        tracks = [
            {
                "name": track.name,
                "kind": track.kind,
                "keys": [[positions[key.frame], key.place, key.outside] for key in track.keys],
            }
            for track in self.content().tracks
        ]
        return {"revision": self.revision, "tracks": tracks, "read_only": self.read_only}

    def draw(self, draw: Draw) -> None:
        """Apply a person's action. Raises as :meth:`JournaledStore.commit`, or if a name or a place is wrong."""
        self._check(draw)
        before = self._tracks.get((draw.name, draw.kind), ())
        self._put(draw.name, draw.kind, _changed(before, self.frames[draw.at], draw))

    def put_shape(self, shape: KeyedShape) -> None:
        """Draw a shape, in place of one of its name and kind; one step. Raises as :meth:`JournaledStore.commit`."""
        others = [kind for name, kind in self._tracks if name == shape.name]
        check_kind(shape.name, shape.kind, self.subjects, others, str(self.path))
        self._put(shape.name, shape.kind, shape.keys)

    def tracks(self) -> list[list[Any]]:
        """The drawing as JSON: name, kind and key frames of each track."""
        return _plain_tracks(self.content())

    def set_tracks(self, tracks: list[list[Any]]) -> None:
        """Replace the drawing after a change of targets; this is no step. Raises as :meth:`JournaledStore.commit`."""
        if tracks != self.tracks():
            self.commit({"set": tracks})

    def _put(self, name: str, kind: Kind, after: Keys) -> None:
        before = self._tracks.get((name, kind), ())
        if after != before:
            self.commit({"draw": {"name": name, "kind": kind, "before": _plain(before), "after": _plain(after)}})

    def _check(self, draw: Draw) -> None:
        names = [*self.targets, *self.subjects]
        check_known(draw.name, names, "no subject or target")
        others = [kind for name, kind in self._tracks if name == draw.name]
        check_kind(draw.name, draw.kind, self.subjects, others, "drawn")
        self.check_position(draw.at)
        if draw.do == "key":
            check_place(draw.kind, _rounded(draw.place), "place")


def _plain_tracks(content: Drawn) -> list[list[Any]]:
    return [[track.name, track.kind, _plain(track.keys)] for track in content.tracks]


def _plain(keys: Keys) -> list[list[Any]]:
    return [[key.frame, list(key.place), key.outside] for key in keys]


def _parsed(plain: Iterable[Sequence[Any]]) -> Keys:
    return tuple(KeyFrame(frame=frame, place=tuple(place), outside=outside) for frame, place, outside in plain)


def _changed(before: Keys, frame: int, draw: Draw) -> Keys:
    """The key frames of a track after an action in a frame."""
    match draw.do:
        case "key":
            key = KeyFrame(frame=frame, place=draw.place)
        case "outside":
            if not before:
                raise VfoaError(f"{draw.name!r} is not drawn; expected a {draw.kind} before it can leave the image")
            track = KeyedShape(name=draw.name, kind=draw.kind, keys=before)
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
