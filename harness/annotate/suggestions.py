"""A run's predictions for a clip under one configuration, with their confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.clips.manifest import ClipManifest
from harness.labels.labels import NOWHERE
from harness.run.clip_records import read_clip_records
from harness.run.records import FrameRecord, SubjectRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """A run's prediction for a subject: a name, and the attention to it in [0, 1] (0 for ``none``).

    ``margin`` is the difference to the next target's attention: small if the run was uncertain.
    """

    target: str
    attention: float
    margin: float


class Predictions:
    """A run's records of one clip under one configuration, as suggestions for labelling.

    Raises the errors of :func:`~harness.run.clip_records.read_clip_records`.
    """

    def __init__(self, run: Path, clip: ClipManifest, configuration: str | None) -> None:
        found = read_clip_records(run, clip, configuration)
        self.configuration, self.records = found.configuration, found.by_frame

    def predict(self, frame: int, subject: str) -> Prediction | None:
        """The prediction; None if the run has no such frame or subject, or could compute nothing."""
        record = self.records.get(frame)
        found = next((each for each in record.subjects if each.name == subject), None) if record else None
        return None if record is None or found is None or found.missing else _prediction(record, found)

    def order(self, frames: Sequence[int], subject: str) -> list[int]:
        """Positions of the frames, the most uncertain first; frames without a prediction come before all others."""
        margins = [prediction.margin if (prediction := self.predict(n, subject)) else -1.0 for n in frames]
        return sorted(range(len(frames)), key=lambda position: (margins[position], position))


def _prediction(record: FrameRecord, subject: SubjectRecord) -> Prediction:
    totals = sorted((each.total for each in subject.attention), reverse=True)
    first, second = (*totals, 0.0, 0.0)[:2]
    if subject.focus is None:
        return Prediction(target=NOWHERE, attention=0.0, margin=0.0)
    return Prediction(target=record.target(subject.focus).name, attention=first, margin=first - second)
