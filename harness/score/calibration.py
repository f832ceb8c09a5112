"""Quality of probabilities: their calibration, sets of answers, and how well the directions fit the posterior.

**Calibration**: whether 70 % of the frames with a confidence of 70 % are right. Guo et al. (2017): predictions are
sorted into ten bins by confidence, the probability of the predicted target. The expected calibration error is the mean
distance between a bin's share of right frames and its mean confidence. If probabilities are high, equal bins put most
frames in one bin; adaptive bins (Nguyen and O'Connor 2015) hold the same number of frames each. Brier's score (1950) is
the squared distance between all probabilities and the truth, 0 to 2.

**Sets**: a set of answers is the smallest set of objects (including "nowhere") that together have 90 % of a subject's
probability.

**Directions** are checked by posterior-predictive checks (Rubin 1984): before each frame the posterior gives the
probability of directions that fit worse than the measured ones. If the model is right, these tail probabilities are
uniform; if many are small, the directions do not fit it. Directions without surprises can still fit the wrong
targets. The share of the way to the targets that heads turn shows this: people turn them 0.35 to 0.75 of the way. A
larger implied share means that the head always points near some target while the eyes look elsewhere: the targets do
not explain the head.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from harness.labels.labels import IGNORED, Label, Labels
from harness.run.grid import base_of
from harness.run.records import FrameRecord, PartLog, SubjectRecord
from harness.score.intervals import LEAST_CLIPS, draw, expanded_percentiles
from harness.score.statistics import UNKNOWN, Codes, Interval
from harness.score.verdicts import find_subject, right_answers
from vfoa.posterior.grid import PLAUSIBLE_SHARE
from vfoa.types import DirectionFit, Float

BINS = 10

SET_LEVEL = 0.9
"""The least probability of a set."""

SMALL_TAIL = 0.05
"""A smaller tail probability is a surprise; if the model is right, this share of the frames has one."""
MOST_SURPRISES = 0.15
"""Share of surprising frames above which a note says that the directions do not fit."""
MOST_TIMES_CLAIMED = 1.5
"""Factor between the claimed and the implied error, either way, above which a note says that they do not fit."""
MOST_SHARE = PLAUSIBLE_SHARE
"""Implied share of the head above which a note says that the targets do not explain the head."""
FEWEST_FRAMES = 20
"""Fewer frames give no check."""

_ROUNDING = 1e-9


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


@dataclass(frozen=True, slots=True, kw_only=True)
class SetCoverage:
    """Share of one configuration's sets that hold the truth, and their mean size, over ``n`` scored frames."""

    configuration: str
    n: int
    covered: int
    mean_size: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionCheck:
    """One configuration on one clip: the share of surprising frames, and the median errors in degrees, of ``n`` frames.

    ``claimed_deg`` is the mean gaze error that its source claims, ``implied_deg`` the one that the directions imply;
    None without gaze. ``share`` is the median share of the way to the targets that the head turns; None without head.
    """

    clip: str
    configuration: str
    n: int
    surprises: float
    claimed_deg: float | None
    implied_deg: float | None
    share: float | None = None

    @property
    def fits(self) -> bool:
        """Whether the directions fit, so that no note is needed."""
        if self.n < FEWEST_FRAMES:
            return True
        times = self.implied_deg / self.claimed_deg if self.implied_deg and self.claimed_deg else 1.0
        explained = self.share is None or self.share <= MOST_SHARE
        return explained and self.surprises <= MOST_SURPRISES and 1 / MOST_TIMES_CLAIMED <= times <= MOST_TIMES_CLAIMED

    def misfit(self) -> str:
        """What does not fit, or how far it is from it."""
        parts = [f"{100 * self.surprises:.0f} % of {self.n} frames surprise it (expected {100 * SMALL_TAIL:.0f} %)"]
        if self.claimed_deg is not None and self.implied_deg is not None:
            claimed, implied = (f"{angle:.0f} deg" for angle in (self.claimed_deg, self.implied_deg))
            parts.append(f"the gaze claims an error of {claimed}, the directions imply {implied}")
        if self.share is not None and self.share > MOST_SHARE:
            parts.append(f"heads turn {100 * self.share:.0f} % of the way to targets (people: 35 to 75 %)")
        return "; ".join(parts)


@dataclass(slots=True)
class CalibrationData:
    """The frames of one configuration on one clip, in plain values.

    ``sureness`` of the scored frames by subject, ``sets``: whether each set of answers holds the truth, and its size.
    ``fits`` of the directions are those of all frames of named subjects.
    """

    sureness: dict[str, list[Sureness]] = field(default_factory=dict)
    sets: list[tuple[bool, int]] = field(default_factory=list)
    fits: list[DirectionFit] = field(default_factory=list)


class CalibrationLog(PartLog[CalibrationData]):
    """Collects probabilities from passing records. The seeds of a configuration are taken together.

    ``configurations`` are those whose attention is a probability.
    """

    def __init__(self, configurations: Collection[str], labels_by_clip: Mapping[str, Labels]) -> None:
        super().__init__(CalibrationData)
        self._names = dict.fromkeys(map(base_of, configurations))
        self._labels = labels_by_clip

    def take(self, record: FrameRecord) -> None:
        """Add a record."""
        data, labels = self.part(record.clip, record.configuration), self._labels.get(record.clip)
        data.fits += [person.fit for person in record.subjects if person.fit is not None and person.name is not None]
        has_probabilities = base_of(record.configuration) in self._names
        for _, name, label in labels.labelled([record.frame]) if labels is not None else ():
            subject = find_subject(record, name)
            if subject is None or label.target == IGNORED:
                continue
            if has_probabilities and subject.missing is None:
                data.sureness.setdefault(name, []).append(_sureness(record, subject, label))
            if (held := prediction_set(subject)) is not None:
                data.sets.append((not set(held).isdisjoint(right_answers(record, label)), len(held)))

    def part(self, clip: str, configuration: str) -> CalibrationData:
        """The data of all seeds of a configuration on a clip so far."""
        return super().part(clip, base_of(configuration))

    def reliabilities(self) -> list[Reliability]:
        """One over all clips for each configuration with a scored frame, in the order of the configurations."""
        reliabilities = []
        for name in self._names:
            clips = [data.sureness for (_, of), data in self.parts.items() if of == name and data.sureness]
            frames = [list(chain.from_iterable(by_subject.values())) for by_subject in clips]
            if frames:
                codes = np.repeat(np.arange(len(frames)), [len(of_clip) for of_clip in frames])
                reliabilities.append(reliability(name, np.concatenate(frames), codes))
        return reliabilities

    def by_subject(self) -> list[Reliability]:
        """One for each subject of each clip, then by configuration."""
        keys = sorted({(clip, subject) for (clip, _), data in self.parts.items() for subject in data.sureness})
        return [
            reliability(name, np.array(data.sureness[subject]), clip=clip, subject=subject)
            for clip, subject in keys
            for name in self._names
            if (data := self.parts.get((clip, name))) and subject in data.sureness
        ]

    def coverages(self) -> list[SetCoverage]:
        """One coverage for each configuration that gives probabilities."""
        by_name: dict[str, list[tuple[bool, int]]] = {}
        for (_, name), data in self.parts.items():
            if data.sets:
                by_name.setdefault(name, []).extend(data.sets)
        sums = {name: np.sum(sets, axis=0).tolist() for name, sets in by_name.items()}
        return [
            SetCoverage(configuration=name, n=len(by_name[name]), covered=covered, mean_size=size / len(by_name[name]))
            for name, (covered, size) in sums.items()
        ]

    def direction_checks(self) -> list[DirectionCheck]:
        """One check for each clip and configuration with a posterior, over the named subjects."""
        return [
            DirectionCheck(
                clip=clip,
                configuration=configuration,
                n=len(data.fits),
                surprises=float(np.mean([fit.tail < SMALL_TAIL for fit in data.fits])),
                claimed_deg=_median_deg([fit.claimed_error_rad for fit in data.fits]),
                implied_deg=_median_deg([fit.implied_error_rad for fit in data.fits]),
                share=_median([fit.implied_share for fit in data.fits]),
            )
            for (clip, configuration), data in self.parts.items()
            if data.fits
        ]


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


NO_PROBABILITIES = (0.0, 1.0)
"""Probability of the truth, and Brier's score, where a method gives no probabilities: it has none anywhere."""


def probabilities(subject: SubjectRecord) -> dict[int | None, float]:
    """The probability of each target by instance id. None stands for nowhere, which has the rest up to 1."""
    chances: dict[int | None, float] = {value.instance_id: value.total for value in subject.attention}
    chances[None] = max(0.0, 1 - sum(chances.values()))
    return chances


def worth_of(record: FrameRecord, subject: SubjectRecord | None, label: Label) -> tuple[float, float]:
    """Probability of the true answer, and Brier's score (0 to 2, Brier 1950), of a subject's probabilities.

    A true target that the frame does not have has probability 0.
    """
    if subject is None or subject.missing is not None:
        return NO_PROBABILITIES
    chances, true = probabilities(subject), right_answers(record, label)
    on_truth = sum(chances.get(key, 0.0) for key in true)
    return on_truth, (1 - on_truth) ** 2 + sum(p**2 for key, p in chances.items() if key not in true)


def _sureness(record: FrameRecord, subject: SubjectRecord, label: Label) -> Sureness:
    confidence = min(probabilities(subject)[subject.focus], 1.0)
    return confidence, subject.focus in right_answers(record, label), worth_of(record, subject, label)[1]


def prediction_set(subject: SubjectRecord) -> tuple[int | None, ...] | None:
    """Instance ids of the smallest set, the likeliest first; None stands for nowhere. None: no probabilities.

    Of equally likely objects those with the lower id come first, and nowhere last.
    """
    if subject.fit is None or not subject.attention:
        return None
    chances = probabilities(subject)
    ranked = sorted(chances, key=lambda key: (-chances[key], key is None, key or 0))
    reached = np.cumsum([chances[key] for key in ranked])
    return tuple(ranked[: 1 + int(np.argmax(reached >= SET_LEVEL * reached[-1] - _ROUNDING))])


def misfit_notes(checks: Iterable[DirectionCheck]) -> list[str]:
    """A note for each configuration whose directions do not fit on some of its clips."""
    notes, by_name = [], dict[str, list[DirectionCheck]]()
    for check in checks:
        by_name.setdefault(check.configuration, []).append(check)
    for name, of_name in by_name.items():
        if unfit := [check for check in of_name if not check.fits]:
            clips = f"{len(unfit)} of {len(of_name)} clips ({', '.join(check.clip for check in unfit)})"
            where = f"{clips}, on the first" if len(unfit) > 1 else unfit[0].clip
            notes.append(f"{name}: directions do not fit the posterior on {where}: {unfit[0].misfit()}.")
    return notes


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None


def _median_deg(angles_rad: Iterable[float | None]) -> float | None:
    middle = _median(angles_rad)
    return None if middle is None else float(np.degrees(middle))
