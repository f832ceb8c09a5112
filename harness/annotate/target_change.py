"""Changes of a clip's targets: a target added, renamed, changed or deleted in all files that name it.

These are the manifest, every annotator's labels, and the drawing. A change is stored in a file of its own before
the first of them is written, and that file is removed after the last. After a kill in between, the change is completed
when the clip is opened next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

from pydantic import Field

from harness.annotate.clip_stores import open_drawing, open_stores
from harness.annotate.journal import Entry
from harness.annotate.label_store import Change, LabelStore
from harness.clips.manifest import ClipManifest, load_manifest, make_manifest
from harness.files.io import atomic_write, read_bytes
from harness.files.parsing import parse_json, parse_toml
from harness.labels.labels import Timeline
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.validation import parse


class TargetChange(Settings):
    """The text of the manifest before and after, the changes of labels by file name, and the drawing before and after.

    ``drawn`` is None if nothing drawn changes. Labels and drawing may be changed before the change is undone or made
    again: it then applies to what still has the target.
    """

    manifest: tuple[str, str]
    labels: dict[str, list[Change]] = Field(default_factory=dict)
    drawn: tuple[list[list[Any]], list[list[Any]]] | None = None

    @property
    def inverse(self) -> TargetChange:
        """The change back."""
        return TargetChange(
            manifest=self.manifest[::-1],
            labels={
                name: [{**change, "before": change["after"], "after": change["before"]} for change in changes]
                for name, changes in self.labels.items()
            },
            drawn=None if self.drawn is None else self.drawn[::-1],
        )

    @classmethod
    def of_step(cls, step: Entry) -> TargetChange | None:
        """The change that a step of the undo list is, if it is one."""
        return parse(cls, step["targets"], "journal") if "targets" in step else None

    def check_labels(self, manifest: ClipManifest, others: Iterable[LabelStore]) -> None:
        """Refuse (:class:`VfoaError`) to remove a target that labels of other annotators have gained since."""
        gone, _ = self.names(manifest)
        for store in others:
            now = store.applicable(self.labels.get(store.path.name, ()))
            for name in gone:
                changed = (part for change in now for part in change["before"] if part[2] == name)
                if left := store.uses(name) - sum(last - first + 1 for first, last, *_ in changed):
                    raise VfoaError(
                        f"{store.path.name} has labels of {name!r} that were made since ({left} frames); expected none "
                        f"before it is removed: give them another target, or change {name!r} instead of undoing"
                    )

    def on_drawing(self, tracks: Iterable[list[Any]], manifest: ClipManifest) -> list[list[Any]]:
        """The drawing after the change: shapes are renamed, removed or restored with their target; others stay.

        Raises
        ------
        VfoaError
            If a target is removed whose shapes were changed since.
        """
        gone, come = self.names(manifest)
        before, after = self.drawn or ((), ())
        if gone and come:
            return sorted([come[0] if name == gone[0] else name, *more] for name, *more in tracks)
        kept = [track for track in tracks if not (track[0] in gone and track in before)]
        if left := next((name for name, *_ in kept if name in gone), None):
            place = manifest.annotations.place_drawn().name
            raise VfoaError(f"{place} has shapes of {left!r} that were drawn since; remove them before {left!r}")
        known = [track[:2] for track in kept]
        return sorted([*kept, *(track for track in after if track[0] in come and track[:2] not in known)])

    def names(self, manifest: ClipManifest) -> tuple[list[str], list[str]]:
        """The targets that the manifest loses by the change, and those that it gains."""
        before, after = (
            make_manifest(parse_toml(text, manifest.path), manifest.path, manifest.name).targets
            for text in self.manifest
        )
        return [name for name in before if name not in after], [name for name in after if name not in before]

    def in_labels(self, stores: Iterable[LabelStore], manifest: ClipManifest) -> None:
        """Change the labels that still have the target, with no step to undo."""
        gone, _ = self.names(manifest)
        for store in stores:
            store.set_changes(self.labels.get(store.path.name, ()), gone)

    def is_last_of(self, store: LabelStore) -> bool:
        """Whether it is the last step that was made, or undone, in these labels."""
        made, undone = ((last := store.last_step(kind)) and TargetChange.of_step(last[1]) for kind in ("undo", "redo"))
        return bool((made and made.manifest == self.manifest) or (undone and undone.inverse.manifest == self.manifest))

    @contextmanager
    def kept(self, manifest: ClipManifest) -> Iterator[None]:
        """Write the manifest, and keep the change in its file while the block runs, also after an error in it."""
        place = _place(manifest)
        atomic_write(place, self.model_dump_json())
        try:
            atomic_write(manifest.path, self.manifest[1])
        except OSError:
            place.unlink()
            raise
        yield
        place.unlink()


def unfinished(manifest: ClipManifest) -> str | None:
    """Why nothing can be changed while some files have a change of targets and others do not; None if none is open."""
    place = _place(manifest)
    if not place.is_file():
        return None
    return f"{place}: a change of targets did not get into all files; open the clip again, which completes it"


def finish_change(manifest: ClipManifest, timeline: Timeline) -> ClipManifest:
    """Complete an interrupted change, if there is one, and return the manifest after it.

    A manifest that was edited since stays as it is. The manifest is changed first, so that no file has the change if
    the manifest's targets are not those after it: it is then dropped.

    Raises
    ------
    VfoaError
        If a file cannot be read or written, or another process labels the clip.
    """
    place = _place(manifest)
    if not place.is_file():
        return manifest
    change = parse(TargetChange, parse_json(read_bytes(place), str(place)), str(place))
    gone, come = change.names(manifest)
    if read_bytes(manifest.path).decode() == change.manifest[0]:
        atomic_write(manifest.path, change.manifest[1])
    changed = load_manifest(manifest.path, manifest.name)
    if {*gone} & {*changed.targets} or not {*come} <= {*changed.targets}:
        place.unlink()
        return changed
    with ExitStack() as stack:
        stores = (stack.enter_context(closing(label_store)) for label_store in open_stores(changed, timeline))
        change.in_labels((label_store for label_store in stores if not change.is_last_of(label_store)), changed)
    with closing(open_drawing(changed, timeline, also=gone)) as drawing:
        drawing.set_tracks(change.on_drawing(drawing.tracks(), changed))
    place.unlink()
    return changed


def _place(manifest: ClipManifest) -> Path:
    place = manifest.annotations.place()
    return place.parent / ".journal" / f"{place.stem}.change.json"
