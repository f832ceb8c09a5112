"""Whether probabilities can be believed: whether 70 % of the frames that are 70 % sure are right.

Guo et al. (2017): predictions are sorted into ten bins by confidence, the probability of what was predicted. The
expected calibration error is the mean distance between a bin's share of right frames and its mean confidence. Brier's
score (1950) is the squared distance between all probabilities and the truth, 0 to 2.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from harness.annotations.files import IGNORED, NOWHERE, Label, Labels
from harness.runs.results import FrameRecord, SubjectRecord
from harness.scores.verdicts import find_subject, true_targets
from vfoa.types import Float

BINS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Reliability:
    """How far one configuration's probabilities can be believed, over ``n`` scored frames with a prediction.

    ``confidence``, ``accuracy`` (means) and ``counts`` are by bin (B,); the means of an empty bin are NaN.
    """

    configuration: str
    n: int
    brier: float
    confidence: Float
    accuracy: Float
    counts: Float

    @property
    def calibration_error(self) -> float:
        """The expected calibration error, in [0, 1]."""
        return float(np.nansum(np.abs(self.accuracy - self.confidence) * self.counts) / self.n)

    @property
    def mean_confidence(self) -> float:
        """The share of right frames that the probabilities promise."""
        return float(np.nansum(self.confidence * self.counts) / self.n)

    @property
    def share_right(self) -> float:
        """The share of right frames."""
        return float(np.nansum(self.accuracy * self.counts) / self.n)


class BeliefLog:
    """Keeps the probabilities of the scored frames while records pass by, of the configurations that give any."""

    def __init__(self, configurations: Collection[str], labels_by_clip: Mapping[str, Labels]) -> None:
        self._labels = labels_by_clip
        self._found: dict[str, list[tuple[float, bool, float]]] = {name: [] for name in configurations}

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Hand the records on."""
        for record in records:
            labels = self._labels.get(record.clip)
            if record.configuration in self._found and labels is not None:
                for _, subject, label in labels.labelled([record.frame]):
                    found = find_subject(record, subject)
                    if label.target != IGNORED and found is not None and found.missing is None:
                        self._found[record.configuration].append(_sureness(record, found, label))
            yield record

    def reliabilities(self) -> list[Reliability]:
        """One for each configuration of which a frame was scored, in the order of the configurations."""
        return [reliability(name, np.array(found)) for name, found in self._found.items() if found]


def reliability(configuration: str, frames: Float) -> Reliability:
    """Count out frames (n, 3): the confidence, whether it was right, and Brier's score of each."""
    confidence, right, brier = frames.T
    bins = np.minimum((confidence * BINS).astype(np.intp), BINS - 1)
    counts = np.bincount(bins, minlength=BINS).astype(np.float64)
    with np.errstate(invalid="ignore"):
        mean, share = (np.bincount(bins, weights=values, minlength=BINS) / counts for values in (confidence, right))
    return Reliability(
        configuration=configuration,
        n=len(frames),
        brier=float(brier.mean()),
        confidence=mean,
        accuracy=share,
        counts=counts,
    )


def _sureness(record: FrameRecord, subject: SubjectRecord, label: Label) -> tuple[float, bool, float]:
    """Confidence, whether it is right, and Brier's score of a subject's probabilities; nowhere has their rest up to 1.

    The truth of a target that the frame does not have has no probability.
    """
    probabilities: dict[int | None, float] = {value.instance_id: value.total for value in subject.attention}
    probabilities[None] = max(0.0, 1 - sum(probabilities.values()))
    true: set[int | None] = {None} if label.target == NOWHERE else {t.instance_id for t in true_targets(record, label)}
    on_truth = sum(probabilities.get(key, 0.0) for key in true)
    elsewhere = sum(p**2 for key, p in probabilities.items() if key not in true)
    return min(probabilities[subject.focus], 1.0), subject.focus in true, (1 - on_truth) ** 2 + elsewhere
