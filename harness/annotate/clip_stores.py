"""The labels of a clip by every annotator, and the shapes drawn on it, each with its journal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TypeVar

from harness.annotate.drawing_store import DrawingStore
from harness.annotate.journal import Journal
from harness.annotate.label_store import LabelStore
from harness.clips.manifest import ClipManifest
from harness.files.folders import came_with_program
from harness.files.safe_names import vfoa_command
from harness.labels.files import target_names
from harness.labels.labels import RESERVED, Timeline

Store = TypeVar("Store", LabelStore, DrawingStore)


def open_store(manifest: ClipManifest, annotator: str | None, timeline: Timeline) -> LabelStore:
    """Open an annotator's labels. Those of a clip that came with the program are copied at the first change.

    Labels of targets that were removed from the manifest are kept, so that they can be changed.

    Raises
    ------
    VfoaError
        If the file is wrong, or another process labels it.
    """
    files = manifest.annotations
    present = files.find(annotator)
    return _open(LabelStore, files.place(annotator), present, manifest, timeline, _targets(manifest, present))


def undo_command(manifest: ClipManifest, annotator: str | None) -> str:
    """The command line that takes back the last change of an annotator's labels."""
    return vfoa_command("labels", "undo", manifest.word, *(("--annotator", annotator) if annotator else ()))


def _targets(manifest: ClipManifest, path: Path | None) -> list[str]:
    """The manifest's targets, and those removed from it that a file of labels still has."""
    return [*manifest.targets, *not_in_manifest(manifest, target_names(path) if path else ())]


def not_in_manifest(manifest: ClipManifest, names: Iterable[str]) -> list[str]:
    """The names that are not in the manifest (any more): no target, no subject and not reserved."""
    known = {*manifest.targets, *manifest.subjects, *RESERVED}
    return [name for name in names if name not in known]


def open_drawing(manifest: ClipManifest, timeline: Timeline, also: Sequence[str] = ()) -> DrawingStore:
    """Open the drawing of a clip, which all annotators share; ``also``: targets that the manifest no longer has.

    Raises as :class:`DrawingStore`.
    """
    files = manifest.annotations
    return _open(DrawingStore, files.place_drawn(), files.find_drawn(), manifest, timeline, [*manifest.targets, *also])


def open_stores(manifest: ClipManifest, timeline: Timeline, but: Path | None = None) -> Iterator[LabelStore]:
    """The labels of every annotator who has any, one after the other, without those of this path."""
    files = manifest.annotations
    for annotator in (None, *files.annotators()):
        place = files.place(annotator)
        with_clip = annotator is None and manifest.labels_file and files.find() is not None
        if place != but and (place.is_file() or with_clip):
            yield open_store(manifest, annotator, timeline)


@contextmanager
def with_others(store: LabelStore, manifest: ClipManifest, timeline: Timeline) -> Iterator[list[LabelStore]]:
    """Yield a store and those of the clip's other annotators, until the block ends. Raises as :func:`open_store`.

    Who has no labels yet cannot begin to label meanwhile, and is not doing so: their page has the present targets.
    """
    with ExitStack() as stack:
        others = open_stores(manifest, timeline, but=store.path)
        stores = [store, *(stack.enter_context(closing(label_store)) for label_store in others)]
        known = {_journal(label_store.path) for label_store in stores}
        for journal in _journal(store.path).parent.glob(f"{manifest.name}*.jsonl"):
            labels = journal.parent.parent / f"{journal.stem}.csv"
            if journal not in known and labels.stem.partition("@")[0] == manifest.name:
                stack.enter_context(closing(Journal(journal, of=labels)))
        yield stores


def _journal(path: Path) -> Path:
    return path.parent / ".journal" / f"{path.stem}.jsonl"


def _open(
    kind: type[Store], path: Path, present: Path | None, manifest: ClipManifest, timeline: Timeline, targets: list[str]
) -> Store:
    """Open a file of the clip; a new one begins with the ``present`` file that came with the program or the clip."""
    begins = present != path and (came_with_program(manifest.path) or manifest.labels_file)
    return kind(
        path,
        _journal(path),
        timeline=timeline,
        subjects=manifest.subjects,
        targets=targets,
        origin=present if begins else None,
    )
