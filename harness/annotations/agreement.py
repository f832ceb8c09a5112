"""How far annotators agree on who looks at what: kappa with its interval, per target, and where they differ.

A frame is compared where both annotators judged it: a frame that only one labelled, or that one of them marked
``ignore`` or left as a suggestion, is not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby

import numpy as np

from harness.annotations.labels import IGNORED, Labels
from harness.scores.statistics import (
    LEVEL,
    REPLICATES,
    UNKNOWN,
    Codes,
    Counts,
    Interval,
    block_length,
    cohen_kappa,
    confusion_matrix,
    resampled_sums,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetAgreement:
    """One target: in how many compared frames the first, the second and both annotators named it.

    ``kappa`` is that of this target against all others.
    """

    target: str
    first: int
    second: int
    both: int
    kappa: float

    @property
    def share(self) -> float:
        """Specific agreement (Dice 1945): frames both named, over the mean of what each named."""
        return 2 * self.both / (self.first + self.second)


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """A range of compared frames in which two annotators name one and another target."""

    subject: str
    first_frame: int
    last_frame: int
    frames: int
    first: str
    second: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Two annotators on one subject, or (``subject`` None) on all subjects pooled.

    ``n`` frames are compared, ``skipped`` were labelled by at least one of them but not judged by both.
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
        """One row for each target that one of the two named, in the order of :attr:`targets`."""
        return [self._target(code) for code in range(len(self.targets))]

    def _target(self, code: int) -> TargetAgreement:
        first, second = int(self.confusion[code].sum()), int(self.confusion[:, code].sum())
        both = int(self.confusion[code, code])
        table = np.array([[both, first - both], [second - both, self.n - first - second + both]])
        return TargetAgreement(
            target=self.targets[code], first=first, second=second, both=both, kappa=cohen_kappa(table)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sequence:
    """One subject's compared frames, and what both annotators said there."""

    subject: str
    frames: tuple[int, ...]
    first: tuple[str, ...]
    second: tuple[str, ...]
    skipped: int


def compare_annotators(
    labels: Mapping[str, Labels], frames: Sequence[int], rate_hz: float | None, clip: str
) -> list[Agreement]:
    """Every pair of annotators, pooled first, then on each subject where there are several.

    Parameters
    ----------
    labels
        Each annotator's labels, in the order in which they are to be named.
    frames, rate_hz
        The clip's frame numbers and rate; a second's worth of frames is a block of the bootstrap.
    clip
        The clip's name, which seeds the drawing of blocks.
    """
    found = []
    for first, second in combinations(labels, 2):
        sequences = _sequences(labels[first], labels[second], frames)
        groups: list[tuple[str | None, list[_Sequence]]] = [(None, sequences)]
        if len(sequences) > 1:
            groups += [(each.subject, [each]) for each in sequences]
        found += [_agreement(first, second, subject, group, rate_hz, clip) for subject, group in groups]
    return found


def differences(first: Labels, second: Labels, frames: Sequence[int]) -> list[Difference]:
    """Where two annotators judged the same frames differently, by subject and frame."""
    found = []
    places = {frame: place for place, frame in enumerate(frames)}
    for each in _sequences(first, second, frames):
        said = zip(each.frames, each.first, each.second, strict=True)
        # in a run of one difference, place in the clip and rank in the list grow together
        runs = groupby(enumerate(said), key=lambda item: (places[item[1][0]] - item[0], item[1][1:]))
        for (_, (one, other)), run in runs:
            inside = [frame for _, (frame, *_) in run]
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
        pairs = [(frame, first.at(frame, subject), second.at(frame, subject)) for frame in frames]
        judged = [
            (frame, one.target, other.target)
            for frame, one, other in pairs
            if one and other and IGNORED not in (one.target, other.target)
        ]
        labelled = sum(one is not None or other is not None for _, one, other in pairs)
        numbers, said, heard = (tuple(column) for column in zip(*judged, strict=True)) if judged else ((), (), ())
        found.append(
            _Sequence(subject=subject, frames=numbers, first=said, second=heard, skipped=labelled - len(judged))
        )
    return found


def _agreement(
    first: str, second: str, subject: str | None, group: list[_Sequence], rate_hz: float | None, clip: str
) -> Agreement:
    targets = tuple(sorted({name for each in group for name in (*each.first, *each.second)}))
    coded = [(each, _codes(each.first, targets), _codes(each.second, targets)) for each in group]
    confusion = sum(
        (confusion_matrix(one, other, len(targets)) for _, one, other in coded),
        start=np.zeros((len(targets), len(targets)), dtype=np.intp),
    )
    draws = sum(
        (
            _resampled(one, other, len(targets), block_length(len(one), rate_hz), f"{clip}/{each.subject}")
            for each, one, other in coded
        ),
        start=np.zeros((REPLICATES, len(targets), len(targets))),
    )
    return Agreement(
        first=first,
        second=second,
        subject=subject,
        n=int(confusion.sum()),
        skipped=sum(each.skipped for each in group),
        agreed=int(np.trace(confusion)),
        kappa=cohen_kappa(confusion),
        interval=_interval(draws),
        targets=targets,
        confusion=confusion,
    )


def _codes(names: Sequence[str], targets: Sequence[str]) -> Codes:
    return np.array([targets.index(name) for name in names], dtype=np.intp)


def _resampled(first: Codes, second: Codes, categories: int, block: int, key: str) -> np.ndarray:
    """Confusion matrices (replicates, categories, categories) of the resampled sequence.

    The key draws the same blocks for every cell, so that each matrix counts one and the same resample.
    """
    counts = np.zeros((REPLICATES, categories, categories))
    for one, other in {*zip(first.tolist(), second.tolist(), strict=True)}:
        counts[:, one, other] = resampled_sums((first == one) & (second == other), block, key)
    return counts


def _interval(counts: np.ndarray) -> Interval:
    """Percentile interval of kappa over the resamples in which it has a value."""
    kappas = np.array([cohen_kappa(each) for each in counts])
    kappas = kappas[np.isfinite(kappas)]
    if not len(kappas):
        return UNKNOWN
    low, high = np.quantile(kappas, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(low=float(low), high=float(high))
