"""A change of targets in all files that name them: the manifest, every annotator's labels, the drawing.

The change is stored in a file of its own before the first of them is written, and that file is removed after the last.
After a kill in between, the change is completed when the clip is opened next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

from pydantic import Field

from harness.annotate.clip_stores import open_drawing, open_stores
from harness.annotate.history import Change
from harness.annotate.store import LabelStore
from harness.clips.manifest import ClipManifest, load_manifest
from harness.files.io import atomic_write, read_bytes
from harness.files.parsing import parse_json
from harness.labels.timeline import Timeline
from vfoa.settings import Settings
from vfoa.validation import parse


class TargetChange(Settings):
    """The text of the manifest before and after, the changes of labels by file name, and the drawing before and after.

    ``drawn`` is None if nothing drawn changes.
    """

    manifest: tuple[str, str]
    labels: dict[str, list[dict[str, Any]]] = Field(default_factory=dict)
    drawn: tuple[list[list[Any]], list[list[Any]]] | None = None

    @property
    def inverse(self) -> TargetChange:
        """The change back."""
        return TargetChange(
            manifest=self.manifest[::-1],
            labels={
                name: [Change.parse(each).inverse.plain() for each in found] for name, found in self.labels.items()
            },
            drawn=None if self.drawn is None else self.drawn[::-1],
        )

    def in_labels(self, stores: Iterable[LabelStore]) -> None:
        """Set the labels, with no step to undo; a second time, nothing more happens."""
        for store in stores:
            store.set_marks(self.labels.get(store.path.name, ()))

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


def finish_change(manifest: ClipManifest, timeline: Timeline) -> ClipManifest:
    """Complete an interrupted change, if there is one, and return the manifest after it.

    Raises
    ------
    VfoaError
        If a file cannot be read or written, or another process labels the clip.
    """
    place = _place(manifest)
    if not place.is_file():
        return manifest
    change = parse(TargetChange, parse_json(read_bytes(place), str(place)), str(place))
    atomic_write(manifest.path, change.manifest[1])
    changed = load_manifest(manifest.path, manifest.name)
    with ExitStack() as stack:
        change.in_labels(stack.enter_context(closing(each)) for each in open_stores(changed, timeline))
    if change.drawn is not None:
        before = [name for name, _, _ in change.drawn[0] if name not in changed.subjects]
        with closing(open_drawing(changed, timeline.frames, also=before)) as drawing:
            drawing.set_tracks(change.drawn[1])
    place.unlink()
    return changed


def _place(manifest: ClipManifest) -> Path:
    place = manifest.annotations.place()
    return place.parent / ".journal" / f"{place.stem}.change.json"
