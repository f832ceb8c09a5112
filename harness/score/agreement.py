"""Agreement of annotators on who looks at what: kappa with its interval, agreement per target, and the differences.

A frame is compared if both annotators judged it. It is not compared if only one labelled it, or if one of them marked
it ``ignore`` or left it as a suggestion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby
from typing import NamedTuple

import numpy as np

from harness.labels.labels import IGNORED, Labels
from harness.score.intervals import LEAST_UNITS, draw, expanded_percentiles
from harness.score.looks import number_looks
from harness.score.statistics import UNKNOWN, Codes, Counts, Interval, cohen_kappa, confusion_matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetAgreement:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A range of compared frames in which two annotators name different targets."""

    subject: str
    first_frame: int
    last_frame: int
    frames: int
    first: str
    second: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Two annotators on one subject, or (``subject`` None) on all subjects pooled.

    ``n`` frames are compared; ``skipped`` frames were labelled by at least one of them but not judged by both.
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
        return [self._target(code) for code in range(len(self.targets))]

    def _target(self, code: int) -> TargetAgreement:
        first, second = int(self.confusion[code].sum()), int(self.confusion[:, code].sum())
        both = int(self.confusion[code, code])
        table = np.array([[both, first - both], [second - both, self.n - first - second + both]])
        return TargetAgreement(
            target=self.targets[code], first=first, second=second, both=both, kappa=cohen_kappa(table)
        )


class _Sequence(NamedTuple):
    """One subject's compared frames by their place in the clip, and the answers of both annotators there."""

    subject: str
    places: tuple[int, ...]
    first: tuple[str, ...]
    second: tuple[str, ...]
    skipped: int


def compare_annotators(labels: Mapping[str, Labels], frames: Sequence[int], rate_hz: float | None) -> list[Agreement]:
    """Compare every pair of annotators, first pooled, then on each subject if there are several.

    Parameters
    ----------
    labels
        Each annotator's labels, in the order in which they are to be named.
    frames, rate_hz
        The clip's frame numbers and rate; looks shorter than two seconds are joined for the interval.
    """
    found = []
    for first, second in combinations(labels, 2):
        sequences = _sequences(labels[first], labels[second], frames)
        groups: list[tuple[str | None, list[_Sequence]]] = [(None, sequences)]
        if len(sequences) > 1:
            groups += [(each.subject, [each]) for each in sequences]
        found += [_agreement(first, second, subject, group, rate_hz) for subject, group in groups]
    return found


def differences(first: Labels, second: Labels, frames: Sequence[int]) -> list[Difference]:
    """Return the ranges in which two annotators judged the same frames differently, by subject and frame."""
    found = []
    for each in _sequences(first, second, frames):
        answers = zip(each.places, each.first, each.second, strict=True)
        # within a run of one difference, place in the clip and rank in the list grow together
        runs = groupby(enumerate(answers), key=lambda item: (item[1][0] - item[0], item[1][1:]))
        for (_, (one, other)), run in runs:
            inside = [frames[place] for _, (place, *_) in run]
            if one != other:
                found.append(
                    Difference(
                        subject=each.subject,
                        first_frame=inside[0],
                        last_frame=inside[-1],
                        frames=len(inside),
                        first=one,
                        second=other,
                    )
                )
    return found


def _sequences(first: Labels, second: Labels, frames: Sequence[int]) -> list[_Sequence]:
    first, second = first.confirmed(), second.confirmed()
    found = []
    for subject in sorted({*first.subjects, *second.subjects}):
        pairs = [(first.at(frame, subject), second.at(frame, subject)) for frame in frames]
        judged = [
            (place, one.target, other.target)
            for place, (one, other) in enumerate(pairs)
            if one and other and IGNORED not in (one.target, other.target)
        ]
        labelled = sum(one is not None or other is not None for one, other in pairs)
        places, one_said, other_said = zip(*judged, strict=True) if judged else ((), (), ())
        found.append(_Sequence(subject, places, one_said, other_said, labelled - len(judged)))
    return found


def _agreement(
    first: str, second: str, subject: str | None, group: list[_Sequence], rate_hz: float | None
) -> Agreement:
    targets = tuple(sorted({name for each in group for name in (*each.first, *each.second)}))
    coded = [(each, _codes(each.first, targets), _codes(each.second, targets)) for each in group]
    confusion = sum(
        (confusion_matrix(one, other, len(targets)) for _, one, other in coded),
        start=np.zeros((len(targets), len(targets)), dtype=np.intp),
    )
    return Agreement(
        first=first,
        second=second,
        subject=subject,
        n=int(confusion.sum()),
        skipped=sum(each.skipped for each in group),
        agreed=int(np.trace(confusion)),
        kappa=cohen_kappa(confusion),
        interval=_interval(coded, len(targets), rate_hz),
        targets=targets,
        confusion=confusion,
    )


def _codes(names: Sequence[str], targets: Sequence[str]) -> Codes:
    return np.array([targets.index(name) for name in names], dtype=np.intp)


def _interval(coded: Sequence[tuple[_Sequence, Codes, Codes]], categories: int, rate_hz: float | None) -> Interval:
    """Interval of kappa from resampled looks of the first annotator, per subject; unknown with few looks."""
    tables, subjects = [], []
    for subject, (each, first, second) in enumerate(coded):
        looks = number_looks(first, np.array(each.places, dtype=np.intp), rate_hz)
        of_looks = np.zeros((len(np.unique(looks)), categories, categories))
        np.add.at(of_looks, (looks, first, second), 1)
        tables.append(of_looks)
        subjects += [subject] * len(of_looks)
    groups, confusions = np.array(subjects, dtype=np.intp), np.concatenate(tables)
    n, df = len(groups), len(groups) - len(np.unique(groups))
    if n < LEAST_UNITS or df < 1:
        return UNKNOWN
    sums = draw(groups, by_clip=False).astype(np.intp) @ confusions.reshape(n, -1).astype(np.intp)
    kappas = np.array([cohen_kappa(each) for each in sums.reshape(-1, categories, categories)])
    kappas = kappas[np.isfinite(kappas)]
    if not len(kappas) or np.ptp(kappas) == 0:
        return UNKNOWN
    low, high = expanded_percentiles(kappas, n, df)
    return Interval(low=low, high=high, unit="look")
