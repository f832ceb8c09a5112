"""Calibration of probabilities: whether 70 % of the frames with a confidence of 70 % are right.

Guo et al. (2017): predictions are sorted into ten bins by confidence, the probability of the predicted target. The
expected calibration error is the mean distance between a bin's share of right frames and its mean confidence. If
probabilities are high, equal bins put most frames in one bin; adaptive bins (Nguyen and O'Connor 2015) hold the same
number of frames each. Brier's score (1950) is the squared distance between all probabilities and the truth, 0 to 2.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sized
from dataclasses import dataclass

import numpy as np

from harness.labels.labels import IGNORED, NOWHERE, Label, Labels
from harness.run.grid import base_of
from harness.run.records import FrameRecord, SubjectRecord
from harness.score.intervals import LEAST_CLIPS, draw, expanded_percentiles
from harness.score.statistics import UNKNOWN, Codes, Interval
from harness.score.verdicts import find_subject, true_targets
from vfoa.types import Float

BINS = 10

Sureness = tuple[float, bool, float]
"""Confidence, whether it was right, and Brier's score of one frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reliability:
    """The calibration of one configuration's probabilities over ``n`` scored frames with a prediction.

    ``clip`` and ``subject`` are None for all together. ``confidence``, ``accuracy`` (means) and ``counts`` are by equal
    bin (B,); the means of an empty bin are NaN. ``interval`` is that of the calibration error, clips resampled; unknown
    with few clips. ``adaptive_error`` is the calibration error of adaptive bins.
    """

    configuration: str
    clip: str | None
    subject: str | None
    n: int
    brier: float
    adaptive_error: float
    interval: Interval
    confidence: Float
    accuracy: Float
    counts: Float

    @property
    def calibration_error(self) -> float:
        """The expected calibration error, in [0, 1]."""
        return float(np.nansum(np.abs(self.accuracy - self.confidence) * self.counts) / self.n)

    @property
    def mean_confidence(self) -> float:
        """Mean confidence: the share of right frames that the probabilities predict."""
        return float(np.nansum(self.confidence * self.counts) / self.n)

    @property
    def share_right(self) -> float:
        """The share of right frames."""
        return float(np.nansum(self.accuracy * self.counts) / self.n)


class BeliefLog:
    """Collects the probabilities of the scored frames from passing records, for configurations that give any.

    The seeds of a configuration are taken together.
    """

    def __init__(self, configurations: Collection[str], labels_by_clip: Mapping[str, Labels]) -> None:
        self._labels = labels_by_clip
        self._found: dict[str, dict[tuple[str, str], list[Sureness]]] = {base_of(name): {} for name in configurations}

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Yield the records unchanged."""
        for record in records:
            labels, of_configuration = self._labels.get(record.clip), self._found.get(base_of(record.configuration))
            if of_configuration is not None and labels is not None:
                for _, subject, label in labels.labelled([record.frame]):
                    found = find_subject(record, subject)
                    if label.target != IGNORED and found is not None and found.missing is None:
                        of_subject = of_configuration.setdefault((record.clip, subject), [])
                        of_subject.append(_sureness(record, found, label))
            yield record

    def part(self, clip: str, configuration: str) -> dict[str, list[Sureness]]:
        """The values of a configuration on a clip so far, by subject, for another log."""
        found = self._found.get(base_of(configuration), {})
        return {subject: each for (of, subject), each in found.items() if of == clip}

    def add(self, clip: str, configuration: str, found: Mapping[str, list[Sureness]]) -> None:
        """Add a part of another log."""
        for subject, each in found.items():
            self._found[base_of(configuration)].setdefault((clip, subject), []).extend(each)

    def reliabilities(self) -> list[Reliability]:
        """One over all clips for each configuration with a scored frame, in the order of the configurations."""
        return [
            reliability(
                name,
                np.concatenate([np.array(each) for each in by_subject.values()]),
                np.concatenate([np.full(len(each), code) for code, each in _coded(by_subject)]),
            )
            for name, by_subject in self._found.items()
            if by_subject
        ]

    def by_subject(self) -> list[Reliability]:
        """One for each subject of each clip, then by configuration."""
        keys = sorted({key for by_subject in self._found.values() for key in by_subject})
        return [
            reliability(name, np.array(by_subject[key]), clip=key[0], subject=key[1])
            for key in keys
            for name, by_subject in self._found.items()
            if key in by_subject
        ]


def _coded(by_subject: Mapping[tuple[str, str], Sized]) -> Iterator[tuple[int, Sized]]:
    """Yield the number of each list's clip, and the list."""
    codes: dict[str, int] = {}
    for (clip, _), each in by_subject.items():
        yield codes.setdefault(clip, len(codes)), each


def reliability(
    configuration: str,
    frames: Float,
    clips: Codes | None = None,
    *,
    clip: str | None = None,
    subject: str | None = None,
) -> Reliability:
    """Compute the calibration of frames (n, 3): the confidence, whether it was right, and Brier's score of each.

    ``clips`` (n,) are the codes of the frames' clips; None: all of one clip.
    """
    confidence, right, brier = frames.T
    bins = np.minimum((confidence * BINS).astype(np.intp), BINS - 1)
    counts = np.bincount(bins, minlength=BINS).astype(np.float64)
    with np.errstate(invalid="ignore"):
        mean, share = (np.bincount(bins, weights=values, minlength=BINS) / counts for values in (confidence, right))
    return Reliability(
        configuration=configuration,
        clip=clip,
        subject=subject,
        n=len(frames),
        brier=float(brier.mean()),
        adaptive_error=adaptive_error(confidence, right),
        interval=_interval(confidence - right, bins, np.zeros(len(frames), dtype=np.intp) if clips is None else clips),
        confidence=mean,
        accuracy=share,
        counts=counts,
    )


def adaptive_error(confidence: Float, right: Float) -> float:
    """The expected calibration error of :data:`BINS` bins of equal numbers of frames; equal confidences share one."""
    order = np.argsort(confidence, kind="stable")
    edges = confidence[order][np.linspace(0, len(order), BINS + 1).astype(int)[1:-1].clip(max=len(order) - 1)]
    bins = np.searchsorted(np.unique(edges), confidence, side="right")
    return float(np.abs(np.bincount(bins, confidence - right)).sum() / len(confidence))


def _interval(gaps: Float, bins: Codes, clips: Codes) -> Interval:
    """The interval of the calibration error, from the gaps (n,) between confidence and outcome."""
    n = int(clips.max()) + 1
    if n < LEAST_CLIPS:
        return UNKNOWN
    sums = np.bincount(clips * BINS + bins, gaps, minlength=n * BINS).reshape(n, BINS)
    drawn = draw(np.zeros(n, dtype=np.intp), by_clip=False).astype(np.float64)
    errors = np.abs(drawn @ sums).sum(axis=1) / (drawn @ np.bincount(clips, minlength=n))
    low, high = expanded_percentiles(errors, n, n - 1)
    return Interval(low=low, high=high, unit="clip")


def _sureness(record: FrameRecord, subject: SubjectRecord, label: Label) -> tuple[float, bool, float]:
    """Confidence, whether it is right, and Brier's score of a subject's probabilities."""
    probabilities = _probabilities(subject)
    _, brier = worth_of(record, subject, label)
    return min(probabilities[subject.focus], 1.0), subject.focus in _true(record, label), brier


NO_PROBABILITIES = (0.0, 1.0)
"""Probability of the truth, and Brier's score, where a method gives no probabilities: it has none anywhere."""


def worth_of(record: FrameRecord, subject: SubjectRecord | None, label: Label) -> tuple[float, float]:
    """Probability of the true answer, and Brier's score (0 to 2, Brier 1950), of a subject's probabilities.

    Nowhere has their rest up to 1. A true target that the frame does not have has probability 0.
    """
    if subject is None or subject.missing is not None:
        return NO_PROBABILITIES
    probabilities, true = _probabilities(subject), _true(record, label)
    on_truth = sum(probabilities.get(key, 0.0) for key in true)
    return on_truth, (1 - on_truth) ** 2 + sum(p**2 for key, p in probabilities.items() if key not in true)


def _probabilities(subject: SubjectRecord) -> dict[int | None, float]:
    found: dict[int | None, float] = {value.instance_id: value.total for value in subject.attention}
    found[None] = max(0.0, 1 - sum(found.values()))
    return found


def _true(record: FrameRecord, label: Label) -> set[int | None]:
    return {None} if label.target == NOWHERE else {target.instance_id for target in true_targets(record, label)}
