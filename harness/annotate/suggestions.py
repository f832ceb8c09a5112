"""What a run predicted for the clip under one configuration, and how sure it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.annotations.labels import NOWHERE
from harness.runs.directory import RunDirectory
from harness.runs.results import FrameRecord, SubjectRecord, read_results
from vfoa.errors import VfoaError, did_you_mean


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """What a run says a subject looks at: a name, and the attention to it in [0, 1] (0 for ``none``).

    ``margin`` is how far that is ahead of the next thing's attention: small where the run was unsure.
    """

    target: str
    attention: float
    margin: float


class Predictions:
    """A run's records of one clip under one configuration, by frame number.

    Raises
    ------
    VfoaError
        If the run has no such clip or configuration, or several and none was chosen.
    """

    def __init__(self, run: Path, clip: str, configuration: str | None) -> None:
        records = [each for each in read_results(RunDirectory(run).results) if each.clip == clip]
        if not records:
            raise VfoaError(f"{run}: the run has no frames of clip {clip!r}")
        names = list(dict.fromkeys(each.configuration for each in records))
        self.configuration = _choose(names, configuration, run)
        self.records = {each.frame: each for each in records if each.configuration == self.configuration}

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


def _choose(names: Sequence[str], wanted: str | None, run: Path) -> str:
    if wanted is None and len(names) == 1:
        return names[0]
    if wanted is None:
        raise VfoaError(f"{run}: has several configurations; choose one with --config: {', '.join(names)}")
    if wanted not in names:
        raise VfoaError(f"{run}: no configuration {wanted!r}; {did_you_mean(wanted, names)}")
    return wanted
