"""Labels, targets and drawing of a clip with their common undo list, for the labelling page and the command line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from harness.annotate.clip_stores import not_in_manifest, open_drawing, open_store, with_others
from harness.annotate.drawing_store import DrawingStore
from harness.annotate.journal import Entry
from harness.annotate.journaled_store import StepBack
from harness.annotate.label_store import LabelStore
from harness.annotate.target_change import TargetChange, finish_change, unfinished
from harness.clips import manifest_text
from harness.clips.manifest import ClipManifest, load_manifest
from harness.clips.naming import NameRule
from harness.files.io import read_bytes
from harness.labels.labels import Timeline
from vfoa.errors import VfoaError


class History:
    """An annotator's labels, the targets and the drawing of a clip. Not for several threads at once.

    :attr:`manifest` is another object after each change of targets. A change of targets that was interrupted is
    completed first.

    Raises
    ------
    VfoaError
        If a file is wrong, or another process changes the labels.
    """

    def __init__(self, manifest: ClipManifest, annotator: str | None, timeline: Timeline) -> None:
        self._timeline = timeline
        self.manifest = finish_change(manifest, timeline)
        self.drawing: DrawingStore = open_drawing(self.manifest, timeline)
        try:
            self.labels: LabelStore = open_store(self.manifest, annotator, timeline)
        except BaseException:
            self.drawing.close()
            raise

    @property
    def left_over(self) -> list[str]:
        """Targets of labels that are not in the manifest (any more)."""
        return not_in_manifest(self.manifest, self.labels.names())

    def refresh(self) -> None:
        """Read labels and drawing again if another program has changed them."""
        self.labels.refresh()
        self.drawing.refresh()

    def next_step(self, kind: StepBack) -> tuple[LabelStore | DrawingStore, Entry] | None:
        """Labels (with targets) or drawing, whichever has the next step to undo or redo, and the step; or None."""
        stores = (self.labels, self.drawing)
        last_made_s = max((made[0] for store in stores if (made := store.last_step("undo"))), default=0.0)
        found = [(last, store) for store in stores if (last := store.last_step(kind)) and last[0] >= last_made_s]
        if not found:
            return None
        (_, step), store = max(found, key=lambda timed: timed[0][0])
        return store, step

    def step_back(self, kind: StepBack) -> str | None:
        """Take back the last change of labels, targets or drawing, whichever is newest, or make it again.

        A change that was undone before a newer one was made cannot be made again.

        Returns
        -------
        str or None
            The file and what was changed in it; None if there is nothing to undo or redo.

        Raises
        ------
        VfoaError
            If a file cannot be written, or it is a change of targets that no longer fits the present labels.
        """
        self.refresh()
        if (found := self.next_step(kind)) is None:
            return None
        store, step = found
        change = TargetChange.of_step(step)
        if change and kind == "undo":
            change = change.inverse
        self._with_targets(change, lambda: store.step_back(kind))
        return f"{self.manifest.path}: targets" if change else f"{store.path}: {store.describe(step)}"

    def add_target(self, name: str, rule: NameRule) -> None:
        """Write a new target into the manifest, and allow its name."""
        self._change(manifest_text.with_target(self.manifest.path, name, rule))

    def change_target(self, name: str, *, new_name: str, key: str | None, colour: str) -> None:
        """Give a target another name, also in the labels of all annotators, or another key or colour."""
        self.refresh()
        to = manifest_text.with_change(self.manifest.path, name, new_name=new_name, key=key, colour=colour)
        if new_name == name:
            self._change(to)
            return
        with with_others(self.labels, self.manifest, self._timeline) as stores:
            labels = {store.path.name: store.reassigned(name, new_name) for store in stores}
        tracks = self.drawing.tracks()
        self._change(to, labels, [[new_name if track[0] == name else track[0], *track[1:]] for track in tracks])

    def delete_target(self, name: str, to: str | None) -> None:
        """Delete a target from the manifest; labels of all annotators that have it become ``to``."""
        self.refresh()
        with with_others(self.labels, self.manifest, self._timeline) as stores:
            if to is not None:
                for store in stores:
                    store.check_reassignment(name, to)
                labels = {store.path.name: store.reassigned(name, to) for store in stores}
            elif uses := sum(store.uses(name) for store in stores):
                raise VfoaError(f"{name!r} is the target of {uses} labels; expected another target for them")
            else:
                labels = {}
        drawn = [track for track in self.drawing.tracks() if track[0] != name]
        self._change(manifest_text.without_target(self.manifest.path, name), labels, drawn)

    def close(self) -> None:
        """Close the files."""
        self.labels.close()
        self.drawing.close()

    def _change(self, text: str, labels: dict[str, list[Any]] | None = None, drawn: list[Any] | None = None) -> None:
        """Change the manifest to this text, with these changes of labels by file name, and to this drawing."""
        before = self.drawing.tracks()
        change = TargetChange(
            manifest=(read_bytes(self.manifest.path).decode(), text),
            labels={name: changes for name, changes in (labels or {}).items() if changes},
            drawn=None if drawn is None or drawn == before else (before, drawn),
        )
        self._with_targets(change, lambda: self.labels.change_targets(change.model_dump(mode="json")))

    def _with_targets(self, change: TargetChange | None, make: Callable[[], None]) -> None:
        """Make a change of this annotator's labels and, if it changes targets, the same in all other files."""
        if not change:
            make()
            return
        self.labels.check_writable()
        if read_bytes(self.manifest.path).decode() != change.manifest[0]:
            self.labels.commit({"set": []})  # no earlier step can be undone
            raise VfoaError(
                f"{self.manifest.path} was edited since its targets were changed here: changes until then can no "
                "longer be undone"
            )
        with with_others(self.labels, self.manifest, self._timeline) as stores:
            change.check_labels(self.manifest, stores[1:])
            drawn = change.on_drawing(self.drawing.tracks(), self.manifest)
            if drawn != self.drawing.tracks():
                self.drawing.check_writable()
            try:
                with change.kept(self.manifest):
                    change.in_labels(stores[1:], self.manifest)
                    make()
                    self.drawing.set_tracks(drawn)
            finally:
                if (reason := unfinished(self.manifest)) is not None:
                    self.labels.read_only = self.drawing.read_only = reason
        self._read_manifest()

    def _read_manifest(self) -> None:
        self.manifest = load_manifest(self.manifest.path, self.manifest.name)
        left = [name for name in self.left_over if self.labels.uses(name)]
        self.labels.targets = [*self.manifest.targets, *left]
        self.drawing.targets = [*self.manifest.targets]
