"""Quality of probabilities: their calibration, sets of answers, and how well the directions fit the posterior.

**Calibration**: whether 70 % of the frames with a confidence of 70 % are right. Guo et al. (2017): predictions are
sorted into ten bins by confidence, the probability of the predicted target. The expected calibration error is the mean
distance between a bin's share of right frames and its mean confidence. If probabilities are high, equal bins put most
frames in one bin; adaptive bins (Nguyen and O'Connor 2015) hold the same number of frames each.

**Sets** and Brier's score are those of :mod:`harness.score.verdicts`.

**Directions** are checked by posterior-predictive checks (Rubin 1984): before each frame the posterior gives the
probability of directions that fit worse than the measured ones. If the model is right, these tail probabilities are
uniform; if many are small, the directions do not fit it. Directions without surprises can still fit the wrong
targets. The share of the way to the targets that heads turn shows this: people turn them 0.35 to 0.75 of the way. A
larger implied share means that the head always points near some target while the eyes look elsewhere: the targets do
not explain the head.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from harness.files.groups import grouped
from harness.run.directory import Pair
from harness.run.grid import base_of
from harness.score.intervals import LEAST_CLIPS, draw, expanded_percentiles
from harness.score.judged_subjects import JudgedSubject
from harness.score.statistics import NO_INTERVAL, Interval
from harness.score.verdict_columns import PairVerdicts
from vfoa.posterior.grid import PLAUSIBLE_SHARE
from vfoa.scoring import BINS, bins
from vfoa.types import Codes, Float

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
_DEGREES = 180 / np.pi
_HALVINGS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Reliability:
    """The calibration of one configuration's probabilities over ``n`` scored frames with a prediction.

    ``confidence``, ``accuracy`` (means) and ``counts`` are by equal bin (B,); the means of an empty bin are NaN.
    ``interval`` is that of the calibration error, clips resampled; unknown with few clips. ``adaptive_error`` is the
    calibration error of adaptive bins.
    """

    configuration: str
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


def _with_values(subjects: Iterable[JudgedSubject], column: str) -> dict[str, list[JudgedSubject]]:
    """By configuration, all seeds together: the subjects that have a value in a column."""
    known = (each for each in subjects if not np.isnan(getattr(each, column)).all())
    return grouped((base_of(of_subject.configuration), of_subject) for of_subject in known)


def reliabilities(subjects: Iterable[JudgedSubject]) -> list[Reliability]:
    """One for each configuration with probabilities, in the order of the subjects."""
    found = []
    for name, group in _with_values(subjects, "confidence").items():
        columns = ([each.confidence, each.correct, each.brier] for each in group)
        frames = np.concatenate([np.stack(of_subject, axis=1) for of_subject in columns])
        numbers = {clip: number for number, clip in enumerate(sorted({of_subject.clip for of_subject in group}))}
        codes = np.repeat(
            [numbers[of_subject.clip] for of_subject in group], [len(of_subject.frames) for of_subject in group]
        )
        known = ~np.isnan(frames[:, 0])
        found.append(reliability(name, frames[known], codes[known]))
    return found


def calibration_errors(subjects: Iterable[JudgedSubject]) -> dict[str, float]:
    """Return the expected calibration error of each configuration whose attention values are probabilities."""
    return {found.configuration: found.calibration_error for found in reliabilities(subjects)}


def reliabilities_by_subject(subjects: Iterable[JudgedSubject]) -> list[tuple[str, str, Reliability]]:
    """Clip, subject and calibration: one for each configuration with probabilities, sorted by clip and subject."""
    groups = grouped(((of_subject.clip, of_subject.subject), of_subject) for of_subject in subjects)
    return [(*place, row) for place, group in sorted(groups.items()) for row in reliabilities(group)]


def coverages(subjects: Iterable[JudgedSubject]) -> list[SetCoverage]:
    """One coverage for each configuration that gives probabilities."""
    found = []
    for name, group in _with_values(subjects, "set_size").items():
        sizes = np.concatenate([of_subject.set_size for of_subject in group])
        covered, n = sum(int(of_subject.is_covered.sum()) for of_subject in group), int((~np.isnan(sizes)).sum())
        found.append(SetCoverage(configuration=name, n=n, covered=covered, mean_size=float(np.nanmean(sizes))))
    return found


def direction_checks(judged: Mapping[Pair, PairVerdicts]) -> list[DirectionCheck]:
    """One check for each clip and configuration with a posterior, over the named subjects.

    Of configurations with the same one (a posterior, and logits that use it), the first is checked.
    """
    fits = grouped(((clip, base_of(name)), part.fits) for (clip, name), part in judged.items() if len(part.fits))
    distinct: dict[tuple[str, bytes], tuple[str, Float]] = {}
    for (clip, name), parts in fits.items():
        values = np.concatenate(parts)
        distinct.setdefault((clip, values.tobytes()), (name, values))
    return [
        DirectionCheck(
            clip=clip,
            configuration=name,
            n=len(tail),
            surprises=float(np.mean(tail < SMALL_TAIL)),
            claimed_deg=_median(claimed_rad, _DEGREES),
            implied_deg=_median(implied_rad, _DEGREES),
            share=_median(share),
        )
        for (clip, _), (name, values) in distinct.items()
        for tail, claimed_rad, implied_rad, share in [values.T]
    ]


def reliability(configuration: str, frames: Float, clips: Codes | None = None) -> Reliability:
    """Compute the calibration of frames (n, 3): the confidence, whether it was right, and Brier's score of each.

    ``clips`` (n,) are the codes of the frames' clips; None: all of one clip.
    """
    confidence, right, brier = frames.T
    clips = np.zeros(len(frames), dtype=np.intp) if clips is None else clips
    places = bins(confidence)
    counts = np.bincount(places, minlength=BINS).astype(np.float64)
    with np.errstate(invalid="ignore"):
        mean, share = (np.bincount(places, weights=values, minlength=BINS) / counts for values in (confidence, right))
    return Reliability(
        configuration=configuration,
        n=len(frames),
        brier=float(brier.mean()),
        adaptive_error=adaptive_error(confidence, right),
        interval=_interval(confidence - right, places, clips),
        confidence=mean,
        accuracy=share,
        counts=counts,
    )


def adaptive_error(confidence: Float, right: Float) -> float:
    """The expected calibration error of :data:`BINS` bins of equal numbers of frames; equal confidences share one."""
    order = np.argsort(confidence, kind="stable")
    edges = confidence[order][np.linspace(0, len(order), BINS + 1).astype(int)[1:-1].clip(max=len(order) - 1)]
    places = np.searchsorted(np.unique(edges), confidence, side="right")
    return float(np.abs(np.bincount(places, confidence - right)).sum() / len(confidence))


def _interval(gaps: Float, places: Codes, clips: Codes) -> Interval:
    """The interval of the calibration error, from the gaps (n,) between confidence and outcome and their bins.

    Noise only adds to the error, and resampled clips have it twice: their percentiles seldom hold a small error. The
    ends are the errors under which the found one is as large, or as small, as an expanded percentile (test inversion:
    Carpenter, Statistics in Medicine 18, 1999), if the gaps of all bins are scaled alike and have the noise of
    resampled clips.
    """
    n = int(clips.max()) + 1
    if n < LEAST_CLIPS:
        return NO_INTERVAL
    sums = np.bincount(clips * BINS + places, gaps, minlength=n * BINS).reshape(n, BINS)
    drawn = draw(np.zeros(n, dtype=np.intp), by_clip=False).astype(np.float64)
    of_bins = sums.sum(axis=0) / len(gaps)
    noise = (drawn @ sums) / (drawn @ np.bincount(clips, minlength=n))[:, None] - of_bins
    found = float(np.abs(of_bins).sum())

    def scale(end: int) -> float:
        """How many times as large the gaps are if the percentile at this end is the found error."""

        def is_less(factor: float) -> bool:
            return expanded_percentiles(np.abs(factor * of_bins + noise).sum(axis=1), n, n - 1)[end] < found

        low, high = 0.0, 1.0
        while is_less(high):
            low, high = high, 2 * high
        for _ in range(_HALVINGS if is_less(0.0) else 0):
            middle = (low + high) / 2
            low, high = (middle, high) if is_less(middle) else (low, middle)
        return low

    return Interval(low=found * scale(1), high=found * max(scale(0), 1.0), unit="clip")


def misfit_notes(checks: Iterable[DirectionCheck]) -> list[str]:
    """A note for each configuration whose directions do not fit on some of its clips."""
    notes = []
    for name, of_name in grouped((check.configuration, check) for check in checks).items():
        if unfit := [check for check in of_name if not check.fits]:
            where = f"{len(unfit)} of {len(of_name)} clips ({', '.join(check.clip for check in unfit)})"
            notes.append(
                f"{name}: directions do not fit the posterior on {where}: see the table of measured directions."
            )
    return notes


def _median(values: Float, scale: float = 1) -> float | None:
    known = values[~np.isnan(values)]
    return scale * float(np.median(known)) if len(known) else None
