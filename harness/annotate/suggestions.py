"""A run's predictions for a clip under one configuration, with their confidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.labels.labels import NOWHERE
from harness.run.clip_records import read_clip_records
from harness.run.records import FrameRecord, SubjectRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """What a run says a subject looks at: a name, and the attention to it in [0, 1] (0 for ``none``).

    ``margin`` is how far that is ahead of the next thing's attention: small where the run was unsure.
    """

    target: str
    attention: float
    margin: float


class Predictions:
    """A run's records of one clip under one configuration, as suggestions to whoever labels it.

    Raises what :func:`~harness.run.clip_records.read_clip_records` raises.
    """

    def __init__(self, run: Path, clip: str, configuration: str | None) -> None:
        found = read_clip_records(run, clip, configuration)
        self.configuration, self.records = found.configuration, found.by_frame

    def predict(self, frame: int, subject: str) -> Prediction | None:
        """What was predicted; None where the run has no such frame or subject, or could compute nothing."""
        record = self.records.get(frame)
        found = next((each for each in record.subjects if each.name == subject), None) if record else None
        return None if record is None or found is None or found.missing else _prediction(record, found)

    def order(self, frames: Sequence[int], subject: str) -> list[int]:
        """Positions of the frames, those in which the run was least sure first; no prediction is least sure of all."""
        margins = [prediction.margin if (prediction := self.predict(n, subject)) else -1.0 for n in frames]
        return sorted(range(len(frames)), key=lambda position: (margins[position], position))


def _prediction(record: FrameRecord, subject: SubjectRecord) -> Prediction:
    totals = sorted((each.total for each in subject.attention), reverse=True)
    first, second = (*totals, 0.0, 0.0)[:2]
    if subject.focus is None:
        return Prediction(target=NOWHERE, attention=0.0, margin=0.0)
    return Prediction(target=record.target(subject.focus).name, attention=first, margin=first - second)
