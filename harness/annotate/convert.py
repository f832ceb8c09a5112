"""Import and export of a clip's annotation files in formats of other programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace as replace_fields
from pathlib import Path
from typing import Literal

from harness.annotate.bodies import RunBodies, TrueBodies
from harness.clips.manifest import ClipManifest
from harness.files import check_new, check_new_folder
from harness.labels.bodies import Bodies
from harness.labels.drawn import Drawn, write_drawn
from harness.labels.files import write_annotations
from harness.labels.formats import FORMATS, AnnotationFormat
from harness.labels.formats.cvat_drawn import read_cvat_drawn, write_cvat_drawn
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import Labels
from harness.labels.timeline import timeline_of
from harness.run.clip_records import read_clip_records
from vfoa.errors import VfoaError


def open_exchange(
    manifest: ClipManifest,
    *,
    fps: float | None = None,
    offset: float = 0.0,
    renamed: Mapping[str, str] | None = None,
    gaps: Literal["ignore", "none"] = "ignore",
    run: Path | None = None,
    configuration: str | None = None,
    unnamed: str | None = None,
    attribute: str = "target",
    observation: str | None = None,
) -> Exchange:
    """Open a clip for import or export; the parameters are those of :class:`Exchange`.

    Parameters
    ----------
    run, configuration
        The run (and its configuration) that gives the positions of heads and targets; by default the clip's ground
        truth gives them.

    Raises
    ------
    VfoaError
        If the clip cannot be opened, or the run has no results of it.
    """
    clip = manifest.open()
    rules = {**manifest.subjects, **manifest.targets}
    bodies: Bodies = TrueBodies(clip=clip, rules=rules)
    if run is not None:
        bodies = RunBodies(records=read_clip_records(run, manifest.name, configuration).by_frame)
    return Exchange(
        clip=clip,
        subjects=tuple(manifest.subjects),
        targets=tuple(manifest.targets),
        fps=fps,
        offset=offset,
        renamed=renamed or {},
        gaps=gaps,
        bodies=bodies,
        unnamed=unnamed,
        attribute=attribute,
        observation=observation,
    )


def import_labels(
    source: Path, name: str, exchange: Exchange, place: Path, *, replace: bool, confirm: bool = False
) -> Imported:
    """Read another program's file in the format called ``name`` and write it as ``place``.

    ``confirm`` turns suggestions (a run's predictions) into confirmed labels.

    Raises
    ------
    VfoaError
        If the file cannot be read as labels of this clip, or ``place`` exists and may not be replaced.
    """
    check_new(place, replace=replace, hint=", or another --annotator")
    chosen: AnnotationFormat = FORMATS.load(name)()
    imported = chosen.read(source, exchange)
    if not imported.labels.ranges:
        raise VfoaError(f"{source}: no label of a frame of this clip; {' '.join(imported.notes) or 'it is empty'}")
    suggested = sum(row.label.is_suggested for row in imported.labels.ranges)
    if suggested and confirm:
        imported = replace_fields(imported, labels=_confirmed(imported.labels))
    elif suggested:
        note = f"{source}: {suggested} labels are suggestions, which are not scored; --confirm confirms them."
        imported = replace_fields(imported, notes=(*imported.notes, note))
    write_annotations(place, imported.labels)
    return imported


def import_drawn(
    source: Path, name: str, exchange: Exchange, manifest: ClipManifest, *, replace: bool
) -> tuple[Path, Drawn, tuple[str, ...]]:
    """Import drawn shapes of another program; return the file, its content, and notes on what was left out.

    Raises
    ------
    VfoaError
        If the format has no boxes, the file cannot be read as this clip's, or an existing file may not be replaced.
    """
    _check_draws(name)
    place = manifest.annotations.place_drawn()
    check_new(place, replace=replace)
    imported = read_cvat_drawn(source, exchange)
    write_drawn(place, imported.drawn)
    return place, imported.drawn, imported.notes


def export_drawn(manifest: ClipManifest, name: str, exchange: Exchange, to: Path, *, replace: bool) -> list[str]:
    """Write what is drawn on a clip, in the format called ``name``. Returns and raises as :func:`export_labels`."""
    _check_draws(name)
    check_new(to, replace=replace)
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
    (check_new_folder if to.is_dir() else check_new)(to, replace=replace)  # some formats write a folder
    path = manifest.annotations.find() if annotator is None else manifest.annotations.expect(annotator)
    if path is None:
        raise VfoaError(f"{manifest.name}: no annotations; expected {manifest.annotations.place()}")
    labels = manifest.read(path, timeline_of(exchange.clip), allow_gaps=True)
    chosen: AnnotationFormat = FORMATS.load(name)()
    return [f"{to}: {each}" for each in chosen.write(to, labels, exchange)]


def _confirmed(labels: Labels) -> Labels:
    return Labels(replace_fields(row, label=replace_fields(row.label, is_suggested=False)) for row in labels.ranges)
