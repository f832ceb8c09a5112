"""A run's predictions as labels, so that other programs can show and correct them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.labels.labels import IGNORED, NOWHERE, RESERVED, Label, LabelRange, Labels, ranges_of
from harness.run.clip_records import ClipRecords
from harness.run.records import FrameRecord, SubjectRecord


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
