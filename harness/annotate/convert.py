"""Import and export of a clip's annotation files in formats of other programs."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import replace as replace_fields
from pathlib import Path
from typing import Literal

from harness.annotate.clip_stores import open_drawing, open_store, read_for_store
from harness.annotate.marks import from_labels, stretches
from harness.clips.manifest import ClipManifest
from harness.files.io import check_new
from harness.labels.drawn import Drawn, write_drawn
from harness.labels.files import write_annotations
from harness.labels.formats import FORMATS, AnnotationFormat
from harness.labels.formats.cvat import read_cvat_drawn, write_cvat_drawn
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import Labels
from harness.labels.timeline import timeline_of
from vfoa.errors import VfoaError


def open_exchange(
    manifest: ClipManifest,
    *,
    fps: float | None = None,
    offset: float = 0.0,
    renamed: Mapping[str, str] | None = None,
    gaps: Literal["ignore", "none"] = "ignore",
    observation: str | None = None,
) -> Exchange:
    """Open a clip for import or export; the parameters are those of :class:`Exchange`. Raises as ``open`` does."""
    clip = manifest.open()
    return Exchange(
        timeline=timeline_of(clip),
        rate_hz=clip.rate_hz,
        subjects=tuple(manifest.subjects),
        targets=tuple(manifest.targets),
        fps=fps,
        offset=offset,
        renamed=renamed or {},
        gaps=gaps,
        observation=observation,
    )


def import_labels(
    source: Path,
    name: str,
    exchange: Exchange,
    manifest: ClipManifest,
    annotator: str | None = None,
    *,
    replace: bool,
    confirm: bool = False,
) -> Imported:
    """Read another program's file in the format called ``name`` into an annotator's labels of the clip.

    Labels of subjects that the file does not have are kept. The journal of the labelling page holds what is replaced.

    Parameters
    ----------
    replace
        Labels of the file's subjects may be replaced. Frames noted as not labelled yet have no label.
    confirm
        Turn suggestions (a run's predictions) into confirmed labels.

    Raises
    ------
    VfoaError
        If the file cannot be read as labels of this clip, or labels exist and may not be replaced.
    """
    place = manifest.annotations.place(annotator)
    check_new(place, replace=True, inputs=[source])
    chosen: AnnotationFormat = FORMATS.load(name)()
    imported = chosen.read(source, exchange)
    if not imported.labels.ranges:
        raise VfoaError(f"{source}: no label of a frame of this clip; {' '.join(imported.notes) or 'it is empty'}")
    suggested = sum(row.label.is_suggested for row in imported.labels.ranges)
    notes = list(imported.notes)
    if suggested and confirm:
        imported = replace_fields(imported, labels=_confirmed(imported.labels))
    elif suggested:
        notes.append(f"{source}: {suggested} labels are suggestions, which are not scored; --confirm confirms them.")
    timeline = exchange.timeline
    present, new, frames = read_for_store(manifest, place, timeline), imported.labels, exchange.frames
    given = {subject: sum(present.is_given(frame, subject) for frame in frames) for subject in present.subjects}
    taken = {subject: count for subject, count in given.items() if count and subject in new.subjects}
    told = ", ".join(f"{subject} ({count} frames)" for subject, count in taken.items())
    if taken and not replace:
        raise VfoaError(f"{place}: has labels of {told} already; expected --replace, or another --annotator")
    if not any(given.values()):
        write_annotations(place, new)
        return replace_fields(imported, notes=tuple(notes))
    with closing(open_store(manifest, annotator, timeline)) as store:
        for subject in new.subjects:
            track = from_labels(new, subject, frames)
            store.put(store.revision, subject, stretches(track, 0, len(track) - 1))
    if taken:
        notes.append(f"{place}: replaced the labels of {told}; undo in vfoa annotate brings them back.")
    return replace_fields(imported, notes=tuple(notes))


def import_drawn(
    source: Path, name: str, exchange: Exchange, manifest: ClipManifest, *, replace: bool
) -> tuple[Path, Drawn, tuple[str, ...]]:
    """Import drawn shapes of another program; return the file, its content, and notes on what was left out.

    Shapes of names that the file does not have are kept. The journal holds what is replaced.

    Raises
    ------
    VfoaError
        If the format has no boxes, the file cannot be read as this clip's, or existing shapes may not be replaced.
    """
    _check_draws(name)
    place = manifest.annotations.place_drawn()
    check_new(place, replace=True, inputs=[source])
    imported = read_cvat_drawn(source, exchange)
    if not place.is_file():
        write_drawn(place, imported.drawn)
        return place, imported.drawn, imported.notes
    with closing(open_drawing(manifest, exchange.frames)) as store:
        taken = ", ".join(each for each in imported.drawn.names if each in store.drawn.names)
        if taken and not replace:
            raise VfoaError(f"{place}: has shapes of {taken} already; expected --replace")
        store.put(imported.drawn)
    said = (f"{place}: replaced the shapes of {taken}; undo in vfoa annotate brings them back.",) if taken else ()
    return place, imported.drawn, (*imported.notes, *said)


def export_drawn(manifest: ClipManifest, name: str, exchange: Exchange, to: Path, *, replace: bool) -> list[str]:
    """Write what is drawn on a clip, in the format called ``name``. Returns and raises as :func:`export_labels`."""
    _check_draws(name)
    check_new(to, replace=replace, inputs=manifest.files)
    drawn = manifest.drawn(exchange.frames)
    if drawn is None or not drawn.tracks:
        raise VfoaError(f"{manifest.name}: nothing is drawn; expected {manifest.annotations.place_drawn()}")
    return [f"{to}: {each}" for each in write_cvat_drawn(to, drawn, exchange)]


def _check_draws(name: str) -> None:
    if name != "cvat":
        raise VfoaError(f"--drawn: found --format {name}; expected --format cvat, the only one of drawn boxes")


def export_labels(
    manifest: ClipManifest, annotator: str | None, name: str, exchange: Exchange, to: Path, *, replace: bool
) -> list[str]:
    """Write a clip's labels in the format called ``name``; return notes on what it cannot hold.

    Raises
    ------
    VfoaError
        If the clip has no such labels, the format needs unknown data, or ``to`` exists and may not be replaced.
    """
    check_new(to, replace=replace, inputs=manifest.files)
    path = manifest.annotations.find() if annotator is None else manifest.annotations.expect(annotator)
    if path is None:
        raise VfoaError(f"{manifest.name}: no annotations; expected {manifest.annotations.place()}")
    labels = manifest.read(path, exchange.timeline, allow_gaps=True)
    chosen: AnnotationFormat = FORMATS.load(name)()
    return [f"{to}: {each}" for each in chosen.write(to, labels, exchange)]


def _confirmed(labels: Labels) -> Labels:
    return Labels(replace_fields(row, label=replace_fields(row.label, is_suggested=False)) for row in labels.ranges)
