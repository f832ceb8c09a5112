"""Speaking turns on the labelling page: shown from the file, and opened for changes at the first change."""

from __future__ import annotations

import threading
from typing import Any

from harness.annotate import edits
from harness.annotate.clip_stores import open_speech
from harness.annotate.marks import from_labels, stretches
from harness.annotate.store import LabelStore
from harness.clips.manifest import ClipManifest
from harness.labels.labels import SPEAKS, Labels
from harness.labels.timeline import Timeline


class Speech:
    """The speaking turns of one clip, the same for all annotators. Its methods may be called from several threads."""

    def __init__(self, manifest: ClipManifest, timeline: Timeline) -> None:
        self._manifest, self._timeline = manifest, timeline
        self._store: LabelStore | None = None
        self._changing = threading.Lock()

    def state(self) -> dict[str, Any]:
        """The turns of each subject, [first, last] by position, as JSON."""
        with self._changing:
            return self._state()

    def mark(self, request: str, subject: str, first: int, last: int, *, speaks: bool) -> dict[str, Any]:
        """A subject speaks, or is silent, from one position to another; returns the new state.

        Raises
        ------
        VfoaError
            If a name or a position is not the clip's, or another process changes the turns.
        """
        with self._changing:
            store = self._open()
            with store.once(request) as is_new:
                if is_new:
                    store.refresh()
                    store.put(store.revision, subject, edits.mark_range(first, last, SPEAKS if speaks else None))
            return self._state()

    def undo(self, request: str) -> dict[str, Any]:
        """Undo the last change of this page; returns the new state."""
        with self._changing:
            store = self._open()
            with store.once(request) as is_new:
                if is_new:
                    store.refresh()
                    store.undo(store.revision)
            return self._state()

    def close(self) -> None:
        """Close the files."""
        if self._store is not None:
            self._store.close()

    def _open(self) -> LabelStore:
        if self._store is None:
            self._store = open_speech(self._manifest, self._timeline)
        return self._store

    def _state(self) -> dict[str, Any]:
        if self._store is not None:
            tracks = {name: self._store.track(name) for name in self._manifest.subjects}
        else:
            labels = self._manifest.speech(self._timeline) or Labels(())
            tracks = {name: from_labels(labels, name, self._timeline.frames) for name in self._manifest.subjects}
        last = len(self._timeline.frames) - 1
        return {
            "turns": {
                name: [[each.first, each.last] for each in stretches(track, 0, last) if each.mark is not None]
                for name, track in tracks.items()
            }
        }
