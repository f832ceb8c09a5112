"""A run's predictions as labels, in the formats of other programs, which can show and correct them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.files.io import check_new
from harness.labels.formats import FORMATS, SUFFIXES, AnnotationFormat
from harness.labels.formats.exchange import Exchange
from harness.labels.labels import IGNORED, NOWHERE, RESERVED, Label, LabelRange, Labels, ranges_of
from harness.labels.timeline import Timeline
from harness.run.directory import RunDirectory
from harness.run.records import FrameRecord, SubjectRecord
from harness.run.results import ClipRecords, read_clip_records
from vfoa.errors import VfoaError, did_you_mean


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """A written file, and notes on what it does not hold."""

    path: Path
    notes: tuple[str, ...]


def is_run(path: Path) -> bool:
    """Whether a path is a run's directory."""
    return RunDirectory(path).manifest.is_file()


def export_predictions(
    run: Path,
    name: str,
    *,
    clip: str | None = None,
    configuration: str | None = None,
    to: Path | None = None,
    fps: float | None = None,
    offset: float = 0.0,
    replace: bool = False,
) -> Iterator[Exported]:
    """Write a run's predictions in the format called ``name``, one file for each clip.

    Parameters
    ----------
    clip, configuration
        The clip and configuration to export; a configuration must be chosen if there are several.
    to
        The file, if one clip is written; by default ``RUN/labels/CLIP__CONFIGURATION.SUFFIX``.
    fps, offset
        As in :class:`Exchange`.
    replace
        Overwrite existing files.

    Raises
    ------
    VfoaError
        If the run has no such clip or configuration, the format needs data that the run lacks, or a file exists.
    """
    manifest = RunDirectory(run).read_manifest()
    clips = {each["name"]: each for each in manifest["clips"]}
    if clip is not None and clip not in clips:
        raise VfoaError(f"{run}: no clip {clip!r}; {did_you_mean(clip, clips)}")
    chosen = [clip] if clip is not None else list(clips)
    if to is not None and len(chosen) > 1:
        raise VfoaError(f"{run}: has the clips {', '.join(chosen)}; expected --clip CLIP with a file of your own")
    written: AnnotationFormat = FORMATS.load(name)()
    for each in chosen:
        records = read_clip_records(run, each, configuration)
        names = clips[each]["names"]
        subjects, targets = tuple(names["subjects"]), tuple(names["targets"])
        found = predicted_labels(records, {*subjects, *targets})
        if not found.labels.ranges:
            raise VfoaError(f"{run}: {each}: nothing was predicted; {' '.join(found.notes) or 'no person was found'}")
        place = to or run / "labels" / f"{each}__{records.configuration}{SUFFIXES.get(name, '')}"
        check_new(place, replace=replace, inputs=RunDirectory(run).inputs)
        exchange = Exchange(
            timeline=Timeline(frames=clips[each]["frames"], times_ns=clips[each]["times_ns"]),
            rate_hz=clips[each]["rate_hz"],
            subjects=found.labels.subjects,
            targets=targets,
            fps=fps,
            offset=offset,
        )
        yield Exported(path=place, notes=(*found.notes, *written.write(place, found.labels, exchange)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Predictions:
    """A run's labels of one clip, all suggestions; ``notes`` list what they do not hold."""

    labels: Labels
    notes: tuple[str, ...]


def predicted_labels(found: ClipRecords, names: Collection[str]) -> Predictions:
    """Make one label per frame and person with a prediction; frames without a prediction have none.

    Parameters
    ----------
    found
        The results of one clip and configuration. With probabilities, the note of a range holds their mean over its
        frames. No focus is the answer ``none`` of a method that can say so; of another, nothing was hit, which is no
        prediction.
    names
        The manifest's names of subjects and targets. A predicted object without one is ``ignore``; the note names
        the object.
    """
    labelled: dict[str, dict[int, tuple[Label, float]]] = {}
    counts = Counter[str]()
    for frame, record in sorted(found.by_frame.items()):
        for person in record.subjects:
            name = person.name or f"person#{person.track_id}"
            of_person = labelled.setdefault(name, {})
            missing = person.missing or (None if found.says_nowhere or person.focus is not None else "nothing hit")
            if missing is not None:
                counts[f"frames of {name} have no prediction ({missing}) and no label"] += 1
            elif frame not in of_person:  # if two tracks share a name, the first counts, as in the score
                of_person[frame] = _label(record, person, name, names)
                counts["labels are 'ignore': the manifest has no name for what was predicted"] += (
                    of_person[frame][0].target == IGNORED
                )
    frames = sorted(found.by_frame)
    rows = [
        _with_probability(row, labels, frames) if found.has_probabilities else row
        for name, labels in labelled.items()
        for row in ranges_of(name, ((frame, labels[frame][0] if frame in labels else None) for frame in frames))
    ]
    return Predictions(
        labels=Labels(rows), notes=tuple(f"{count} {words}." for words, count in sorted(counts.items()) if count)
    )


def _label(record: FrameRecord, person: SubjectRecord, name: str, names: Collection[str]) -> tuple[Label, float]:
    """The label, and the probability of the prediction."""
    totals = {each.instance_id: each.total for each in person.attention}
    if person.focus is None:
        return Label(target=NOWHERE, is_suggested=True), max(0.0, 1 - sum(totals.values()))
    target = record.target(person.focus).name
    probability = min(totals.get(person.focus, 0.0), 1.0)
    if target == name or target not in {*names, *RESERVED}:
        return Label(target=IGNORED, note=f"predicted {target}", is_suggested=True), probability
    return Label(target=target, is_suggested=True), probability


def _with_probability(row: LabelRange, labels: Mapping[int, tuple[Label, float]], frames: Sequence[int]) -> LabelRange:
    inside: Iterable[int] = (frame for frame in frames if row.first_frame <= frame <= row.last_frame)
    mean = float(np.mean([labels[frame][1] for frame in inside]))
    note = "; ".join(filter(None, (row.label.note, f"probability {mean:.2f}")))
    return replace(row, label=replace(row.label, note=note))
