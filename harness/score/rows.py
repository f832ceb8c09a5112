"""The rows of a table of scores: one configuration on one clip, on one subject of it, or on all clips together."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from harness.files.groups import grouped
from harness.run.grid import base_of
from harness.score.baselines import BASELINES, SEES_LABELS
from harness.score.intervals import LEAST_UNITS, Units, balanced_values, rate_interval
from harness.score.judged_subjects import JudgedSubject
from harness.score.looks import MatchCounts, count_events
from harness.score.metrics import Metric, load_metrics
from harness.score.statistics import NO_INTERVAL, SIGNIFICANCE, Interval, sign_flip_p, wilson_interval
from harness.score.verdicts import ERROR_TYPES
from vfoa.types import Flags, Float

Beats = Literal["yes", "not shown", "no"]
"""Whether a configuration beats the best baseline: significantly, possibly by chance, or not at all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreRow:
    """The scores of one configuration on one clip, on one subject of it, or on all clips together.

    ``clip`` is None for all clips, ``subject`` None for all subjects. ``n`` counts frames, ``looks`` and ``clips``
    their looks and clips. ``predicted`` counts the frames with an answer, ``predicted_correct`` the right ones of
    these, ``no_hit`` the frames in which nothing got any attention. ``interval`` is that of the rate by clips or looks
    (see :mod:`harness.score.intervals`), ``balanced_interval`` that of the balanced FRR; ``wilson`` would hold for the
    rate if frames were independent. ``metrics`` are the values
    of :mod:`harness.score.metrics` by name, NaN without a value. ``nowhere`` counts the frames in which "looks at
    nothing" is true, said, and both; None for a method that cannot say it. ``visible`` and ``visible_correct`` count
    the frames whose line of sight no label calls blocked. ``baselines`` are the rates of
    :mod:`harness.score.baselines`, ``baselines_balanced`` their means of the rates with and without a true target;
    ``best_baseline`` is the one that is right most often and has not seen the labels, the first of equally good ones:
    on all labelled frames of these subjects, if only some are scored. ``beats`` says whether it is beaten.
    ``error_types`` are the wrong frames by error type, in the order of :data:`ERROR_TYPES`, zeros included.
    ``seed_rates`` are the rates under each seed, if a configuration ran under several; ``n`` counts all of them.
    """

    clip: str | None
    subject: str | None
    configuration: str
    n: int
    looks: int
    clips: int
    correct: int
    predicted: int
    predicted_correct: int
    no_hit: int
    interval: Interval
    balanced_interval: Interval
    wilson: Interval
    metrics: Mapping[str, float]
    events: MatchCounts
    nowhere: MatchCounts | None
    visible: int
    visible_correct: int
    baselines: Mapping[str, float]
    baselines_balanced: Mapping[str, float]
    best_baseline: str
    beats: Beats
    error_types: Mapping[str, int]
    seed_rates: tuple[float, ...] = ()

    @property
    def frr(self) -> float:
        """Share of the frames that are correct."""
        return self.correct / self.n

    @property
    def coverage(self) -> float:
        """Share of the frames with an answer: a target, or "looks at nothing" of a method that can say so."""
        return self.predicted / self.n

    @property
    def frr_predicted(self) -> float:
        """FRR given an answer: the share of correct ones among the frames with one; NaN without any."""
        return self.predicted_correct / self.predicted if self.predicted else math.nan

    @property
    def frr_visible(self) -> float:
        """FRR of the frames whose line of sight is free; NaN without any."""
        return self.visible_correct / self.visible if self.visible else math.nan


class ScoreRows:
    """The rows of the subjects that have scored frames, made when they are first asked for.

    They are in the order of the subjects: by clip, subject, configuration. Seeds of a configuration have one row
    together. ``says_nowhere`` are the configurations that can say "looks at nothing".
    """

    def __init__(self, subjects: Iterable[JudgedSubject], says_nowhere: Collection[str] = ()) -> None:
        self._says_nowhere = says_nowhere
        self._scored = [(base_of(each.configuration), each) for each in subjects if len(each.frames)]
        self._subjects_of = grouped(dict.fromkeys((each.clip, each.subject) for _, each in self._scored))

    def __bool__(self) -> bool:
        return bool(self._scored)

    def __iter__(self) -> Iterator[ScoreRow]:
        return iter((*self.by_clip, *self.by_subject))

    @cached_property
    def by_clip(self) -> tuple[ScoreRow, ...]:
        """The rows of whole clips and, if there are several clips or subjects, of all together."""
        return *self._of_clips, *self._of_all

    @cached_property
    def overall(self) -> tuple[ScoreRow, ...]:
        """The row of each configuration over all clips."""
        return self._of_all or self._of_clips

    @cached_property
    def by_subject(self) -> tuple[ScoreRow, ...]:
        """The rows of single subjects."""
        of_clips = {(row.clip, row.configuration): row for row in self._of_clips}
        groups = grouped(((each.clip, each.subject), (name, each)) for name, each in self._scored)
        return tuple(
            replace(of_clips[clip, name], subject=subject)
            if len(self._subjects_of[clip]) == 1
            else self._row(clip, subject, name, group)
            for (clip, subject), named in groups.items()
            for name, group in grouped(named).items()
        )

    @cached_property
    def _of_clips(self) -> tuple[ScoreRow, ...]:
        groups = grouped(((each.clip, name), each) for name, each in self._scored)
        return tuple(self._row(clip, None, name, group) for (clip, name), group in groups.items())

    @cached_property
    def _of_all(self) -> tuple[ScoreRow, ...]:
        if sum(map(len, self._subjects_of.values())) < 2:
            return ()
        return tuple(self._row(None, None, name, group) for name, group in grouped(self._scored).items())

    def _row(self, clip: str | None, subject: str | None, name: str, group: Sequence[JudgedSubject]) -> ScoreRow:
        return _row(clip, subject, name, group, self._metrics, says_nowhere=name in self._says_nowhere)

    @cached_property
    def _metrics(self) -> Mapping[str, Metric]:
        return load_metrics()


def _row(
    clip: str | None,
    subject: str | None,
    configuration: str,
    group: Sequence[JudgedSubject],
    metrics: Mapping[str, Metric],
    *,
    says_nowhere: bool,
) -> ScoreRow:
    def column(name: str) -> Flags:
        return np.concatenate([getattr(of_subject, name) for of_subject in group])

    correct, no_hit, visible, baselines = column("correct"), column("no_hit"), ~column("blocked"), column("baselines")
    nowhere = column("nowhere")
    recalls = [baselines[frames].mean(axis=0) for frames in (~nowhere, nowhere) if frames.any()]
    answered = (column("predicted") >= 0) & ~no_hit
    error_types = sum((Counter(of_subject.error_types) for of_subject in group), Counter[str]())
    units = _units_of(group, [of_subject.correct for of_subject in group])
    interval = rate_interval(units)
    best = _best_baseline(group)
    return ScoreRow(
        clip=clip,
        subject=subject,
        configuration=configuration,
        n=len(correct),
        looks=len(units.stretched().frames),
        clips=units.n_clips,
        correct=_count(correct),
        predicted=_count(answered),
        predicted_correct=_count(answered & correct),
        no_hit=_count(no_hit),
        interval=interval,
        balanced_interval=_balanced_interval(group, correct, nowhere, interval),
        wilson=wilson_interval(_count(correct), len(correct)),
        metrics={name: float(metric(group)) for name, metric in metrics.items()},
        events=count_events((of_subject.truth, of_subject.predicted, of_subject.positions) for of_subject in group),
        nowhere=_matches(nowhere, column("says_nowhere")) if says_nowhere else None,
        visible=_count(visible),
        visible_correct=_count(correct & visible),
        baselines=dict(zip(BASELINES, baselines.mean(axis=0).tolist(), strict=True)),
        baselines_balanced=dict(zip(BASELINES, np.mean(recalls, axis=0).tolist(), strict=True)),
        best_baseline=best,
        beats=_beats(group, best),
        error_types={error_type: error_types[error_type] for error_type in ERROR_TYPES},
        seed_rates=_seed_rates(group),
    )


def _balanced_interval(group: Sequence[JudgedSubject], correct: Flags, nowhere: Flags, interval: Interval) -> Interval:
    """The interval of the balanced FRR; ``interval``, that of the FRR, if all frames have a target, or none has.

    Unknown if too few units hold frames with a target, or frames without one.
    """
    if nowhere.all() or not nowhere.any():
        return interval
    held = _units_of(group, [of_subject.nowhere for of_subject in group]).merged()
    if min(np.count_nonzero(held.values), np.count_nonzero(held.frames - held.values)) < LEAST_UNITS:
        return NO_INTERVAL
    ends = np.cumsum([len(of_subject.correct) for of_subject in group])[:-1]
    return rate_interval(_units_of(group, np.split(balanced_values(correct, nowhere), ends)))


def _seed_rates(group: Sequence[JudgedSubject]) -> tuple[float, ...]:
    by_seed = grouped((of_subject.configuration, of_subject.correct) for of_subject in group)
    return tuple(float(np.concatenate(flags).mean()) for flags in by_seed.values()) if len(by_seed) > 1 else ()


def _matches(true: Flags, predicted: Flags) -> MatchCounts:
    return MatchCounts(true=_count(true), predicted=_count(predicted), matched=_count(true & predicted))


def _beats(group: Sequence[JudgedSubject], baseline: str) -> Beats:
    place = list(BASELINES).index(baseline)
    gains = _units_of(group, [of_subject.correct.astype(int) - of_subject.baselines[:, place] for of_subject in group])
    if gains.values.sum() <= 0:
        return "no"
    return "yes" if sign_flip_p(gains.merged().values) < SIGNIFICANCE else "not shown"


def _best_baseline(group: Sequence[JudgedSubject]) -> str:
    """The baseline that is right most often and has not seen the labels; the first of equals."""
    right = dict(zip(BASELINES, np.sum([each.baselines_right for each in group], axis=0).tolist(), strict=True))
    return max((name for name in BASELINES if name not in SEES_LABELS), key=lambda name: right[name])


def _count(flags: Flags) -> int:
    return int(np.count_nonzero(flags))


def _units_of(group: Sequence[JudgedSubject], values: Sequence[NDArray[Any]]) -> Units:
    """The looks of some subjects, with the sums over their frames of a value (n,) per frame."""
    clips: dict[str, int] = {}
    of_tracks: dict[tuple[str, str], Float] = {}  # (looks, 2) by clip and subject: seeds share the looks
    for of_subject, value in zip(group, values, strict=True):
        of_looks = np.stack([np.bincount(of_subject.looks), np.bincount(of_subject.looks, value)], axis=1).astype(
            np.float64
        )
        key = of_subject.clip, of_subject.subject
        of_tracks[key] = of_tracks[key] + of_looks if key in of_tracks else of_looks
    sums = dict(sorted(of_tracks.items()))  # what is drawn does not depend on the order in which clips are given
    codes, looks = [clips.setdefault(clip, len(clips)) for clip, _ in sums], [*map(len, sums.values())]
    frames, totals = np.concatenate(list(sums.values())).T
    tracks = np.repeat(np.arange(len(sums)), looks)
    return Units(clips=np.repeat(codes, looks), frames=frames, values=totals, tracks=tracks)
