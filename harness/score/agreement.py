"""Agreement of annotators on who looks at what: kappa with its interval, agreement per target, and the differences.

A frame is compared if both annotators judged it. It is not compared if only one labelled it, or if one of them marked
it ``ignore`` or left it as a suggestion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from harness.labels.labels import IGNORED, Labels
from harness.score.intervals import can_resample, draw, expanded_percentiles
from harness.score.looks import gaps, number_looks, seconds_from_change
from harness.score.statistics import NO_INTERVAL, Counts, Interval
from vfoa.errors import VfoaError
from vfoa.scoring import cohen_kappa
from vfoa.types import Codes


class TargetAgreement(NamedTuple):
    """One target: the numbers of compared frames in which the first, the second and both annotators named it.

    ``kappa`` is that of this target against all others.
    """

    target: str
    first: int
    second: int
    both: int
    kappa: float

    @property
    def share(self) -> float:
        """Specific agreement (Dice 1945): frames that both named, over the mean of the frames that each named."""
        return 2 * self.both / (self.first + self.second)


class Difference(NamedTuple):
    """A range of compared frames in which two annotators name different targets."""

    subject: str
    first: str
    second: str
    first_frame: int
    last_frame: int
    frames: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Two annotators on one subject, or (``subject`` None) on all subjects pooled.

    ``n`` frames are compared; ``skipped`` frames were labelled by at least one of them but not judged by both, or are
    near a change.
    ``confusion`` (targets, targets) counts the first's answers in rows, the second's in columns.
    """

    first: str
    second: str
    subject: str | None
    n: int
    skipped: int
    agreed: int
    kappa: float
    interval: Interval
    targets: tuple[str, ...]
    confusion: Counts

    def by_target(self) -> list[TargetAgreement]:
        """One row for each target that either of the two named, in the order of :attr:`targets`."""
        rows = []
        for code, target in enumerate(self.targets):
            first, second = int(self.confusion[code].sum()), int(self.confusion[:, code].sum())
            both = int(self.confusion[code, code])
            table = np.array([[both, first - both], [second - both, self.n - first - second + both]])
            rows.append(TargetAgreement(target, first, second, both, cohen_kappa(table)))
        return rows


class _Compared(NamedTuple):
    """One subject's compared frames: place in the clip, and the answers of both annotators; and how many are not."""

    subject: str
    places: list[int]
    answers: list[tuple[str, str]]
    skipped: int


def compare_annotators(
    labels: Mapping[str, Labels],
    frames: Sequence[int],
    rate_hz: float | None,
    away_s: float = 0.0,
    times_s: Sequence[float] | None = None,
) -> list[Agreement]:
    """Compare every pair of annotators, first pooled, then on each subject if there are several.

    Parameters
    ----------
    labels
        Each annotator's labels, in the order in which they are to be named.
    frames, rate_hz
        The clip's frame numbers and rate; looks shorter than two seconds are joined for the interval.
    away_s
        Only frames that are farther than this from any change of the label by either of the two, seconds.
    times_s
        The times of the frames. Default: one after the other at the rate.

    Raises
    ------
    VfoaError
        If ``away_s`` is asked for, and the clip's frame rate is not known.
    """
    if away_s and rate_hz is None:
        raise VfoaError("--away: the clip's frame rate is not known; expected rate_hz in its manifest")
    if times_s is None:
        times_s = [place / (rate_hz or 1.0) for place in range(len(frames))]
    agreements = []
    for first, second in combinations(labels, 2):
        subjects = _compared(labels[first], labels[second], frames, times_s, away_s)
        agreements.append(_agreement(first, second, None, subjects, rate_hz))
        if len(subjects) > 1:
            agreements += [_agreement(first, second, subject.subject, [subject], rate_hz) for subject in subjects]
    return agreements


def differences(first: Labels, second: Labels, frames: Sequence[int]) -> list[Difference]:
    """Return the ranges in which two annotators judged the same frames differently, by subject and frame.

    A gap between compared frames (:func:`harness.score.looks.gaps`) ends a range.
    """
    ranges = []
    for compared in _compared(first, second, frames, range(len(frames)), 0.0):
        gaps_before = [0, *np.cumsum(gaps(np.array(compared.places, dtype=np.intp))).tolist()]
        answers = zip(gaps_before, compared.answers, compared.places, strict=False)
        for (_, (ours, theirs)), run in groupby(answers, key=itemgetter(0, 1)):
            inside = [frames[place] for _, _, place in run]
            if ours != theirs:
                ranges.append(Difference(compared.subject, ours, theirs, inside[0], inside[-1], len(inside)))
    return ranges


def _compared(
    first: Labels, second: Labels, frames: Sequence[int], times_s: Sequence[float], away_s: float
) -> list[_Compared]:
    first, second = first.confirmed(), second.confirmed()
    by_subject = []
    for subject in sorted({*first.subjects, *second.subjects}):
        pairs = [(first.at(frame, subject), second.at(frame, subject)) for frame in frames]
        ours_s, theirs_s = (seconds_from_change(own, times_s) for own in zip(*pairs, strict=True))
        judged = {
            place: (ours.target, theirs.target)
            for place, ((ours, theirs), *from_s) in enumerate(zip(pairs, ours_s, theirs_s, strict=True))
            if ours and theirs and IGNORED not in (ours.target, theirs.target) and min(from_s) > away_s
        }
        labelled = sum(pair != (None, None) for pair in pairs)
        by_subject.append(_Compared(subject, list(judged), list(judged.values()), labelled - len(judged)))
    return by_subject


def _agreement(
    first: str, second: str, subject: str | None, group: list[_Compared], rate_hz: float | None
) -> Agreement:
    targets = tuple(sorted({name for compared in group for pair in compared.answers for name in pair}))
    tables = [_by_look(compared, targets, rate_hz) for compared in group]
    by_look = np.concatenate([np.zeros((0, len(targets), len(targets)), dtype=np.intp), *tables])
    confusion = by_look.sum(axis=0)
    return Agreement(
        first=first,
        second=second,
        subject=subject,
        n=int(confusion.sum()),
        skipped=sum(compared.skipped for compared in group),
        agreed=int(np.trace(confusion)),
        kappa=cohen_kappa(confusion),
        interval=_interval(np.repeat(np.arange(len(tables)), [len(table) for table in tables]), by_look),
        targets=targets,
        confusion=confusion,
    )


def _by_look(compared: _Compared, targets: Sequence[str], rate_hz: float | None) -> Counts:
    """The confusion of each look of the first annotator: (looks, targets, targets)."""
    code_of = {name: code for code, name in enumerate(targets)}
    codes = np.array([[code_of[name] for name in pair] for pair in compared.answers], dtype=np.intp).reshape(-1, 2)
    looks = number_looks(codes[:, 0], np.array(compared.places, dtype=np.intp), rate_hz)
    counts = np.zeros((looks.max(initial=-1) + 1, len(targets), len(targets)), dtype=np.intp)
    np.add.at(counts, (looks, *codes.T), 1)
    return counts


def _interval(subjects: Codes, by_look: Counts) -> Interval:
    """Interval of kappa from resampled looks of the first annotator, per subject; unknown with few looks."""
    n, df = len(subjects), len(subjects) - len(np.unique(subjects))
    if not can_resample(n, df):
        return NO_INTERVAL
    sums = draw(subjects, by_clip=False).astype(np.intp) @ by_look.reshape(n, -1)
    kappas = np.array([cohen_kappa(confusion) for confusion in sums.reshape(-1, *by_look.shape[1:])])
    kappas = kappas[np.isfinite(kappas)]
    if not len(kappas) or np.ptp(kappas) == 0:
        return NO_INTERVAL
    low, high = expanded_percentiles(kappas, n, df)
    return Interval(low=low, high=high, unit="look")
