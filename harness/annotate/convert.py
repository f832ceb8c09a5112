"""Labels and a run's predictions in the formats of other programs: import and export."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace as replace_fields
from pathlib import Path
from typing import Any

import numpy as np

from harness.annotate.clip_stores import undo_command
from harness.annotate.history import History
from harness.annotate.marks import counts
from harness.clips.manifest import ClipManifest
from harness.files.io import check_new
from harness.files.safe_names import vfoa_command
from harness.labels.drawn_shapes import Drawn
from harness.labels.formats import FORMATS, SUFFIXES, AnnotationFormat, own_format
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import (
    IGNORED,
    NOWHERE,
    RESERVED,
    Label,
    LabelRange,
    Labels,
    Timeline,
    ranges_of,
    timeline_of,
)
from harness.run.directory import RunDirectory
from harness.run.manifest import has_images
from harness.run.records import FrameRecord, SubjectRecord
from harness.run.results import ClipRecords, read_clip_records
from harness.score.verdicts import name_probabilities
from harness.sources import FilmClip, MeasuredClip
from vfoa.errors import VfoaError, check_known, counted


def open_exchange(manifest: ClipManifest, **options: Any) -> Exchange:
    """Open a clip for import or export; the options are those of :class:`Exchange`. Raises as ``open`` does."""
    clip = manifest.open()
    subjects, targets = tuple(manifest.subjects), tuple(manifest.targets)
    films = clip.films if isinstance(clip, FilmClip) else {}
    return Exchange(
        timeline=timeline_of(clip),
        rate_hz=clip.rate_hz,
        subjects=subjects,
        targets=targets,
        former=manifest.names_now({}),
        has_images=not isinstance(clip, MeasuredClip),
        films=films,
        **options,
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

    Labels of subjects that the file does not have are kept, and without ``replace`` those of other frames than the
    file's. The labels are one step, which can be undone, and so is each drawn shape.

    Parameters
    ----------
    replace
        All labels of the file's subjects are replaced. Frames noted as not labelled yet have no label.
    confirm
        Turn suggestions (a run's predictions) into confirmed labels.

    Raises
    ------
    VfoaError
        If the file cannot be read as labels of this clip, or its frames have labels that may not be replaced.
    """
    if exchange.until_next and name != "table":
        raise VfoaError(f"--until-next: is of --format table; found --format {name}")
    place = manifest.annotations.place(annotator)
    check_new(place, replace=True, inputs=[source])
    chosen: AnnotationFormat = FORMATS.load(name)()
    try:
        imported = chosen.read(source, exchange)
    except VfoaError as error:
        if (own := own_format(source)) in (None, name):
            raise
        raise VfoaError(f"{error} (by its name, a file of --format {own})") from None
    if not imported.labels.ranges and not imported.drawn.tracks:
        hint = "" if exchange.offset is not None else " --offset SECONDS says when the clip begins in it."
        why = f"{' '.join(imported.notes)}{hint}" if imported.notes else "it is empty"
        raise VfoaError(f"{source}: no label of a frame of this clip; {why}")
    _check_size(imported, manifest, source)
    new, notes = imported.labels, list(imported.notes)
    if confirm:
        new = Labels(replace_fields(row, label=replace_fields(row.label, is_suggested=False)) for row in new.ranges)
    if suggested := sum(row.label.is_suggested for row in new.ranges):
        notes.append(f"{source}: not scored: {counted(suggested, 'suggested label')}; --confirm confirms them.")
    with closing(History(manifest, annotator, exchange.timeline)) as history:
        steps = len(imported.drawn.tracks) + bool(new.ranges)
        back = f"brings them back{', step by step' if steps > 1 else ''}"
        joined, twice = _joined(history.labels.content(), new, exchange)
        for path, taken in _taken(history, new, imported.drawn).items():
            if not (replace or twice) and path == place:
                notes.append(f"{path}: the {taken} stay: they are of other frames.")
                continue
            if not replace:  # labels may have come with the program
                if path != place:  # drawn shapes are those of all annotators
                    raise VfoaError(f"{path}: has {taken} already; expected --replace")
                present = manifest.annotations.find(annotator) or path
                frame = f"also of frame {exchange.frames[twice[0]]} in {source}"
                raise VfoaError(f"{present}: has {taken} already, {frame}; expected --replace, or another --annotator")
            notes.append(f"{path}: replaced the {taken}; {undo_command(manifest, annotator)} {back}.")
        for shape in imported.drawn.tracks:
            history.drawing.put_shape(shape)
        if new.ranges:
            history.labels.put_labels(new if replace else Labels(joined), new.subjects)
    return replace_fields(imported, labels=new, notes=tuple(notes))


def _joined(present: Labels, new: Labels, exchange: Exchange) -> tuple[list[LabelRange], list[int]]:
    """The new labels and the present ones of the same people; and the positions of frames that have both."""
    rows = [row for row in (*present.ranges, *new.ranges) if row.subject in new.subjects]
    labelled = [row for row in rows if not row.label.is_placeholder]
    counts = Counter((row.subject, place) for row in labelled for place in exchange.positions(row))
    return labelled, sorted(place for (_, place), count in counts.items() if count > 1)


def _check_size(imported: Imported, manifest: ClipManifest, source: Path) -> None:
    """Reject shapes of images of another size than the clip's, or not in its pixels, or of a clip without images."""
    if not imported.drawn.tracks:
        return
    clip = manifest.open_images()
    rig = clip.frame(clip.frames[0]).rig
    own = (rig.width_px, rig.height_px)
    if imported.size_px is not None and imported.size_px != own:
        found, expected = (f"{width} x {height}" for width, height in (imported.size_px, own))
        raise VfoaError(
            f"{source}: found shapes on images of {found} pixels; expected {expected}, the clip's rectified left "
            f"images ({vfoa_command('clips', 'export', manifest.word, 'FOLDER')} writes them)"
        )
    boxes = [key.place for track in imported.drawn.tracks for key in track.keys if len(key.place) == 4]
    expected = "expected pixels: of COCO's bbox left, top, width and height"
    if boxes and max(map(max, boxes)) <= 0.5 and min(map(min, boxes)) >= -0.5:
        raise VfoaError(f"{source}: found boxes that are all within one pixel; {expected}")
    beyond = sum(u > (1 + _BEYOND) * own[0] or v > (1 + _BEYOND) * own[1] for _, _, u, v in boxes)
    if beyond > _MOST_BEYOND * len(boxes):
        raise VfoaError(
            f"{source}: {beyond} of {len(boxes)} boxes reach far beyond images of {own[0]} x {own[1]}; {expected}"
        )


_BEYOND, _MOST_BEYOND = 0.1, 0.25
"""The share of the image by which a box reaches far beyond it, and the most such boxes, as a share."""


def _taken(history: History, labels: Labels, drawn: Drawn) -> dict[Path, str]:
    """What an import replaces, in words by file: labels of its subjects, and shapes."""
    store = history.labels
    given = {
        subject: sum(counts(mark, at, store.seen(subject)) for at, mark in enumerate(store.track(subject)))
        for subject in labels.subjects
    }
    subjects = ", ".join(f"{subject} ({counted(count, 'frame')})" for subject, count in given.items() if count)
    present = {(track.name, track.kind) for track in history.drawing.content().tracks}
    shapes = ", ".join(f"{each.kind} of {each.name}" for each in drawn.tracks if (each.name, each.kind) in present)
    found = {store.path: subjects and f"labels of {subjects}", history.drawing.path: shapes}
    return {path: words for path, words in found.items() if words}


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
    labels = manifest.read(manifest.annotations.expect(annotator), exchange.timeline, allow_gaps=True)
    chosen: AnnotationFormat = FORMATS.load(name)()
    return [f"{to}: {note}" for note in chosen.write(to, labels, exchange)]


def export_predictions(
    run: Path,
    name: str,
    *,
    clip: str | None = None,
    configuration: str | None = None,
    to: Path | None = None,
    replace: bool = False,
    **options: Any,
) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """Write a run's predictions in the format called ``name``; yield each clip's file, and notes on what is lost.

    Parameters
    ----------
    clip, configuration
        The clip and configuration to export; a configuration must be chosen if there are several.
    to
        The file, if one clip is written; by default ``RUN/labels/CLIP__CONFIGURATION.SUFFIX``.
    replace
        Overwrite existing files.
    options
        Those of :class:`Exchange`.

    Raises
    ------
    VfoaError
        If the run has no such clip or configuration, the format needs data that the run lacks, or a file exists.
    """
    manifest = RunDirectory(run).read_manifest()
    clips = {of_run.name: of_run for of_run in manifest.clips}
    if clip is not None:
        check_known(clip, clips, f"{run}: no clip")
    chosen = [clip] if clip is not None else list(clips)
    if to is not None and len(chosen) > 1:
        raise VfoaError(f"{run}: has the clips {', '.join(chosen)}; expected --clip CLIP with a file of your own")
    written: AnnotationFormat = FORMATS.load(name)()
    for clip_name in chosen:
        records, of_run = read_clip_records(run, clip_name, configuration), clips[clip_name]
        predicted = predicted_labels(records, {*of_run.subjects, *of_run.targets})
        if not predicted.labels.ranges:
            reason = " ".join(predicted.notes) or "no person was found"
            raise VfoaError(f"{run}: {clip_name}: nothing was predicted; {reason}")
        place = to or run / "labels" / f"{clip_name}__{records.configuration}{SUFFIXES.get(name, '')}"
        check_new(place, replace=replace, inputs=RunDirectory(run).inputs)
        times_ns = of_run.times_ns or ()
        exchange = Exchange(
            timeline=Timeline(frames=of_run.frames, times_ns=times_ns, is_whole=False),  # a run may have a limit
            rate_hz=of_run.rate_hz,
            subjects=of_run.subjects if of_run.names else predicted.labels.subjects,
            targets=of_run.targets,
            has_images=has_images(manifest.configurations.values()),
            films=of_run.films,
            **options,
        )
        notes = (*predicted.notes, *written.write(place, predicted.labels, exchange))
        yield place, notes if len(chosen) == 1 else tuple(f"{clip_name}: {note}" for note in notes)


def predicted_labels(records: ClipRecords, names: Collection[str]) -> Imported:
    """Make one suggested label per frame and person with a prediction; frames without a prediction have none.

    Parameters
    ----------
    records
        The results of one clip and configuration. With probabilities, the note of a range has their mean over its
        frames. For a method that can answer ``none``, a frame without a focus is that answer; for others, it has no
        prediction.
    names
        The manifest's names of subjects and targets. A predicted object without one is ``ignore``; the note names
        the object.
    """
    labelled: dict[str, dict[int, tuple[Label, float]]] = {}
    counts = Counter[tuple[str, str]]()
    for frame, record in sorted(records.by_frame.items()):
        for person in record.subjects:
            name = person.name or f"person#{person.track_id}"
            of_person = labelled.setdefault(name, {})
            missing = person.missing or (None if records.says_nowhere or person.focus is not None else "nothing hit")
            if missing is not None:
                counts["frame", f"of {name} without a prediction ({missing}): no label"] += 1
            elif frame not in of_person:  # if two tracks share a name, the first counts, as in the score
                of_person[frame] = _label(record, person, name, names)
                counts["label", "set to 'ignore': the manifest has no name for what was predicted"] += (
                    of_person[frame][0].target == IGNORED
                )
    frames = sorted(records.by_frame)
    rows = [
        _with_probability(row, labels, frames) if records.has_probabilities else row
        for name, labels in labelled.items()
        for row in ranges_of(name, ((frame, labels[frame][0] if frame in labels else None) for frame in frames))
    ]
    return Imported(
        labels=Labels(rows),
        notes=tuple(f"{counted(n, noun)} {more}." for (noun, more), n in sorted(counts.items()) if n),
    )


def _label(record: FrameRecord, person: SubjectRecord, name: str, names: Collection[str]) -> tuple[Label, float]:
    """The label, and the probability of the prediction."""
    target = NOWHERE if person.focus is None else record.target(person.focus).name
    probability = min(name_probabilities(record, person).get(target, 0.0), 1.0)
    if target == name or target not in {*names, *RESERVED}:
        return Label(target=IGNORED, note=f"predicted {target}", is_suggested=True), probability
    return Label(target=target, is_suggested=True), probability


def _with_probability(row: LabelRange, labels: Mapping[int, tuple[Label, float]], frames: Sequence[int]) -> LabelRange:
    inside: Iterable[int] = (frame for frame in frames if row.first_frame <= frame <= row.last_frame)
    mean = float(np.mean([labels[frame][1] for frame in inside]))
    note = "; ".join(filter(None, (row.label.note, f"probability {mean:.2f}")))
    return replace_fields(row, label=replace_fields(row.label, note=note))
