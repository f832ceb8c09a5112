"""Changes of a clip's targets: a target added, renamed, changed or deleted in all files that name it.

These are the manifest (comments and order are kept; the first change writes every name's key and colour, so that they
stay the same from then on), every annotator's labels, and the drawing. A change is stored in a file of its own before
the first of them is written, and that file is removed after the last. After a kill in between, the change is completed
when the clip is opened next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import tomlkit
from pydantic import Field
from tomlkit.exceptions import TOMLKitError

from harness.annotate.clip_stores import open_drawing, open_stores
from harness.annotate.journal import Entry
from harness.annotate.label_store import Change, LabelStore
from harness.clips.manifest import ClipManifest, load_manifest, make_manifest
from harness.clips.naming import NameRule, keys_and_colours
from harness.files.folders import came_with_program
from harness.files.io import atomic_write, read_bytes
from harness.files.parsing import parse_json, parse_toml
from harness.labels.labels import Timeline
from vfoa.errors import VfoaError, check_known
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


def with_target(path: Path, name: str, rule: NameRule) -> str:
    """Return the text with a target's rule at the end of the manifest's targets; it gets the next free key and colour.

    Raises
    ------
    VfoaError
        If the name is taken or not a word, the rule contradicts another, or the manifest came with the program.
    """
    document, manifest = _open(path)
    if name in manifest.targets:
        raise VfoaError(f"{path}: targets.{name}: exists already; expected a new name")
    if "targets" not in document:
        document["targets"] = tomlkit.table(is_super_table=True)
    targets: Any = document["targets"]
    targets[name] = _table(rule)
    _parse(path, document)  # before its look is found among the others'
    look = keys_and_colours({**manifest.targets, **manifest.subjects, name: rule})[name]
    for key, value in (("key", look.key), ("colour", look.colour)):
        if value is not None:
            targets[name].setdefault(key, value)
    return _text(path, document)


def with_change(path: Path, name: str, *, new_name: str, key: str | None, colour: str) -> str:
    """Return the text that gives a target another name, key or colour; a subject, another key or colour. None: no key.

    Earlier names stay in the manifest (``formerly``): results of runs have them.

    Raises
    ------
    VfoaError
        If there is no such target, the name or the key is taken, or the manifest came with the program.
    """
    document, manifest = _open(path)
    is_subject = name in manifest.subjects
    table: Any = document["subjects"] if is_subject else _targets(path, document, name)
    if key is None:
        table[name].pop("key", None)
    else:
        table[name]["key"] = key
    table[name]["colour"] = colour
    if new_name != name:
        if is_subject:
            raise VfoaError(f"{path}: subjects.{name}: only targets are renamed here")
        if new_name in {*manifest.targets, *manifest.subjects}:
            raise VfoaError(f"{path}: targets.{new_name}: exists already; expected a new name")
        table[name]["formerly"] = [former for former in (*table[name].get("formerly", ()), name) if former != new_name]
        _rename(table, name, new_name)
    return _text(path, document)


def without_target(path: Path, name: str) -> str:
    """Return the text without a target.

    Raises
    ------
    VfoaError
        If there is no such target, or the manifest came with the program.
    """
    document, _ = _open(path)
    del _targets(path, document, name)[name]
    return _text(path, document)


def _open(path: Path) -> tuple[tomlkit.TOMLDocument, ClipManifest]:
    """The manifest, and its text with every key and colour written down."""
    if came_with_program(path):
        raise VfoaError(f"{path} came with vfoa and is read-only; copy it to your own datasets/ to change its targets")
    text = read_bytes(path).decode()
    manifest = make_manifest(parse_toml(text, path), path)
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise VfoaError(f"{path}: not TOML: {error}") from None
    for name, look in keys_and_colours({**manifest.targets, **manifest.subjects}).items():
        tables: Any = document["targets" if name in manifest.targets else "subjects"]
        if look.key is not None and "key" not in tables[name]:
            tables[name]["key"] = look.key
        tables[name].setdefault("colour", look.colour)
    return document, manifest


def _text(path: Path, document: tomlkit.TOMLDocument) -> str:
    _parse(path, document)
    return tomlkit.dumps(document)


def _parse(path: Path, document: tomlkit.TOMLDocument) -> None:
    """Reject a text that is not a manifest, or that does not express the intended change."""
    plain = parse_toml(tomlkit.dumps(document), path)
    parse(ClipManifest, plain, str(path))
    if plain != document.unwrap():
        raise VfoaError(f"{path}: the targets cannot be changed automatically; edit the file by hand")


def _targets(path: Path, document: tomlkit.TOMLDocument, name: str) -> Any:
    targets: Any = document.get("targets", {})
    check_known(name, targets, f"{path}: no target")
    return targets


def _table(rule: NameRule) -> Any:
    table = tomlkit.table()
    table.update(rule.model_dump(mode="json", exclude_defaults=True))
    return table


def _rename(targets: Any, name: str, new_name: str) -> None:
    """Rename a key in place. Tables that are separated by others are several containers."""
    for part in getattr(targets, "_tables", [targets]):
        if name in part:
            item = part.value.item(name)
            item.display_name = None  # keep the header as it was written
            part.value._replace(name, new_name, item)
