"""The state of a clip's drawing as the sum of journal entries: deterministic, and the same after a restart.

An entry is one of

{"base": tracks, "revision": r}                               begin anew, from the file
{"draw": {"name", "kind", "before": keys, "after": keys}}     key frames of a track, [frame, place, outside] each
{"set": tracks}                                               targets were renamed, deleted or restored
{"undo": true}    {"redo": true}
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from harness.annotate.journaled import Entry
from harness.annotate.undo import Undo, time_of
from harness.labels.drawn import Drawn, KeyFrame, Kind, drawn_of

Keys = tuple[KeyFrame, ...]


class DrawnHistory:
    """Key frames by name and kind, what can be undone and redone, and the number of the revision."""

    def __init__(self) -> None:
        self.revision = 0
        self.tracks: dict[tuple[str, Kind], Keys] = {}
        self.undo = Undo[dict[str, Any]]()

    def apply(self, entry: Entry) -> None:
        """Apply one entry; ValueError, KeyError and similar if it does not fit this clip."""
        if "base" in entry:
            self.tracks = {(name, kind): _parsed(keys) for name, kind, keys in entry["base"]}
            self.undo.clear()
            self.revision = max(self.revision, entry["revision"])
        elif "draw" in entry:
            self._place(entry["draw"], "after")
            self.undo.make(entry["draw"], time_of(entry))
        elif "set" in entry:
            self.tracks = {(name, kind): _parsed(keys) for name, kind, keys in entry["set"]}
        elif "undo" in entry:
            self._place(self.undo.undo(time_of(entry)), "before")
        else:
            self._place(self.undo.redo(), "after")
        self.revision += 1

    def content(self) -> Drawn:
        """The contents of the file."""
        return drawn_of(self.tracks)

    def change_to(self, name: str, kind: Kind, keys: Keys) -> Entry:
        """The entry that gives a track these key frames."""
        before = self.tracks.get((name, kind), ())
        return {"draw": {"name": name, "kind": kind, "before": _plain(before), "after": _plain(keys)}}

    def base_of(self, content: Drawn) -> Entry:
        """The entry that begins anew with the content of the file."""
        return {"base": plain_tracks(content), "revision": self.revision}

    def fits(self, base: Entry) -> bool:
        """Return True: a base of another clip shows when its result is compared with the file."""
        return True

    def copy(self) -> DrawnHistory:
        """Return an independent copy of the state."""
        copied = DrawnHistory()
        copied.revision, copied.tracks, copied.undo = self.revision, dict(self.tracks), self.undo.copy()
        return copied

    def _place(self, change: dict[str, Any], which: str) -> None:
        key, keys = (change["name"], change["kind"]), _parsed(change[which])
        self.tracks.pop(key, None)
        if keys:
            self.tracks[key] = keys


def plain_tracks(content: Drawn) -> list[list[Any]]:
    """A drawing as JSON: name, kind and key frames of each track."""
    return [[each.name, each.kind, _plain(each.keys)] for each in content.tracks]


def _plain(keys: Keys) -> list[list[Any]]:
    return [[each.frame, list(each.place), each.outside] for each in keys]


def _parsed(plain: Iterable[Sequence[Any]]) -> Keys:
    return tuple(KeyFrame(frame=frame, place=tuple(place), outside=outside) for frame, place, outside in plain)
