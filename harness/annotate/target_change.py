"""A target is renamed or deleted in all files that name it: the manifest, every annotator's labels, the drawing.

The change is stored in a file of its own before the first of them is written, and that file is removed after the last.
After a kill in between, the change is completed when the clip is opened next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

from harness.annotate import targets
from harness.annotate.clip_stores import open_drawing, open_stores
from harness.annotate.store import LabelStore
from harness.bounded_parsing import parse_json
from harness.clips.manifest import ClipManifest, load_manifest
from harness.files import atomic_write, read_bytes
from harness.labels.timeline import Timeline
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.validation import parse


class TargetChange(Settings):
    """A target gets another name, key and colour, or is deleted (``new_name`` None).

    ``labels_to`` is what its labels become; None: no label has it.
    """

    name: str
    new_name: str | None = None
    labels_to: str | None = None
    key: str | None = None
    colour: str = ""

    def in_manifest(self, path: Path) -> None:
        """Change the manifest. Raises as the functions of :mod:`harness.annotate.targets`."""
        if self.new_name is None:
            targets.delete_target(path, self.name)
        else:
            targets.change_target(path, self.name, new_name=self.new_name, key=self.key, colour=self.colour)

    def in_labels(self, stores: Iterable[LabelStore]) -> None:
        """Change labels and all that can be undone; a second time, nothing more happens."""
        for store in stores if self.labels_to != self.name else ():
            if self.labels_to is None:
                store.delete_target(self.name)
            else:
                store.rename_target(self.name, self.labels_to)

    def check_deletion(self, stores: Sequence[LabelStore]) -> None:
        """Refuse to delete a target of labels without another one that they all can have (:class:`VfoaError`)."""
        uses = sum(store.uses(self.name) for store in stores)
        if uses and self.labels_to is None:
            raise VfoaError(f"{self.name!r} is the target of {uses} labels; expected another target for them")
        if self.labels_to is not None:
            for store in stores:
                store.check_reassignment(self.name, self.labels_to)

    @contextmanager
    def kept(self, manifest: ClipManifest) -> Iterator[None]:
        """Keep the change in its file while the block runs, and after an error if the manifest has changed."""
        place, before = _place(manifest), read_bytes(manifest.path)
        atomic_write(place, self.model_dump_json())
        try:
            yield
        except (VfoaError, OSError):
            if read_bytes(manifest.path) == before:
                place.unlink()
            raise
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
    if change.name in {**manifest.targets, **manifest.subjects} and change.name != change.new_name:
        change.in_manifest(manifest.path)
        manifest = load_manifest(manifest.path, manifest.name)
    with ExitStack() as stack:
        change.in_labels(stack.enter_context(closing(each)) for each in open_stores(manifest, timeline))
    with closing(open_drawing(manifest, timeline.frames, also=(change.name,))) as drawing:
        drawing.set_names(manifest.targets, (change.name, change.new_name))
    place.unlink()
    return manifest


def _place(manifest: ClipManifest) -> Path:
    place = manifest.annotations.place()
    return place.parent / ".journal" / f"{place.stem}.change.json"
