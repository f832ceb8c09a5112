"""Scores of a run: the focus recognition rate (FRR) per clip and configuration, and how reliable it is.

FRR = correct / annotated (frame, subject) pairs without ``ignore``; a pair without a prediction is wrong. "Frame" means
such a pair below. Pooled over subjects or clips means all their pairs together: a longer clip weighs more.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.files.groups import grouped
from harness.run.columns import MeasureColumns, PairColumns
from harness.run.directory import Pair
from harness.run.grid import base_of
from harness.run.manifest import Published
from harness.run.notes import Note
from harness.score.baselines import BASELINES, SEES_LABELS
from harness.score.calibration import DirectionCheck, direction_checks, misfit_notes
from harness.score.doubts import data_notes
from harness.score.intervals import LEAST_UNITS, ScoredFrames, Units, balanced_values, rate_interval
from harness.score.judged_subjects import JudgedSubject, judged_subjects
from harness.score.looks import MatchCounts, count_events
from harness.score.metrics import Metric, load_metrics
from harness.score.mistaken_labels import label_notes
from harness.score.reference import Reference
from harness.score.statistics import NO_INTERVAL, SIGNIFICANCE, Interval, sign_flip_p, wilson_interval
from harness.score.verdict_columns import PairVerdicts, judge_columns
from harness.score.verdicts import ERROR_TYPES, PLAIN, Verdict
from vfoa.types import Flags, Float

Value = TypeVar("Value")
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """All scores of a run. ``rows`` hold only groups with annotated frames, ``judged_subjects`` the unscored ones, too.

    Clips and configurations are in the order of the results; subjects by clip, configuration, subject. ``notes``
    are shown with every table. ``published`` are published figures. ``measures`` compare the stages with the ground
    truth, ``directions`` the measured directions with the posterior. ``judged_subjects`` are the input of the rows.
    ``unknown_names``, ``factors``, ``settings`` and ``is_recorded`` are as in :class:`Reference`. ``phases`` are the
    scores of each phase of the clips that have some, on these clips together; without notes and measures.
    ``has_answers_of_file`` says whether another system gave the answers of a configuration.
    """

    clips: tuple[str, ...]
    configurations: tuple[str, ...]
    rows: tuple[ScoreRow, ...]
    notes: tuple[Note, ...] = ()
    published: Published | None = None
    factors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    measures: Mapping[Pair, MeasureColumns] = field(default_factory=dict, compare=False, repr=False)
    directions: tuple[DirectionCheck, ...] = ()
    judged_subjects: tuple[JudgedSubject, ...] = field(default=(), compare=False, repr=False)
    unknown_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    phases: Mapping[str, Scores] = field(default_factory=dict)
    has_answers_of_file: bool = False
    is_recorded: bool = True
    _memo: dict[str, Any] = field(default_factory=dict, init=False, compare=False, repr=False)

    def memoized(self, name: str, make: Callable[[], Value]) -> Value:
        """Return what ``make`` makes of these scores; the first result of a name is kept, as several tables ask."""
        if name not in self._memo:
            self._memo[name] = make()
        found: Value = self._memo[name]
        return found

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        """The verdicts as objects, one for each frame of a subject; the judged subjects have them as columns."""
        return tuple(verdict for of_subject in self.judged_subjects for verdict in of_subject.judged.verdicts())

    @property
    def wrong_frames(self) -> dict[Pair, set[int]]:
        """The frames in which somebody was judged wrong, of those that have some."""
        wrong: dict[Pair, set[int]] = {}
        for of_subject in self.judged_subjects:
            if frames := {*of_subject.frames[~of_subject.correct].tolist()}:
                wrong.setdefault((of_subject.clip, of_subject.configuration), set()).update(frames)
        return wrong

    def by_clip(self) -> list[ScoreRow]:
        """The rows of whole clips and, if there are several, of all clips together."""
        return [row for row in self.rows if row.subject is None]

    def overall(self) -> list[ScoreRow]:
        """The row of each configuration over all clips."""
        rows = self.by_clip()
        return [row for row in rows if row.clip is None] or rows

    def by_subject(self) -> list[ScoreRow]:
        """The rows of single subjects."""
        return [row for row in self.rows if row.subject is not None]

    @property
    def scored_configurations(self) -> tuple[str, ...]:
        """The configurations that have rows, in the order of the results; one name for all seeds of a configuration."""
        return tuple(dict.fromkeys(map(base_of, self.configurations)))

    def frames_of(self, configuration: str) -> list[ScoredFrames]:
        """One configuration's scored frames on all clips, as :func:`harness.score.comparison.compare` takes them."""
        seeds_of = grouped(
            ((of_subject.clip, of_subject.subject), of_subject)
            for of_subject in self.judged_subjects
            if base_of(of_subject.configuration) == configuration and len(of_subject.frames)
        )
        return [
            ScoredFrames(
                clip=clip,
                subject=subject,
                frames=seeds[0].frames.astype(np.intp),
                looks=seeds[0].looks,
                truth=np.array(seeds[0].true_names, dtype=np.object_),
                correct=np.sum([seed.correct for seed in seeds], axis=0, dtype=np.intp),
                seeds=len(seeds),
            )
            for (clip, subject), seeds in seeds_of.items()
        ]


def score(columns: Iterable[PairColumns], reference: Reference) -> Scores:
    """Score every (clip, configuration).

    Parameters
    ----------
    columns
        As :meth:`harness.score.finished_run.FinishedRun.columns` yields them.
    reference
        The labels to score against. A clip without labels has unscored verdicts and no rows.
    """
    judged, measures = dict[Pair, PairVerdicts](), dict[Pair, MeasureColumns]()
    whole = None if reference.all_labels is None else replace(reference, labels=reference.all_labels)
    of_whole = dict[Pair, PairVerdicts]()
    for each in columns:
        pair = each.clip, each.configuration
        judged[pair], measures[pair] = pair_verdicts(each, reference), each.measures
        if whole:
            of_whole[pair] = pair_verdicts(each, whole)
    subjects, directions = judged_subjects(judged, reference, of_whole), direction_checks(judged)
    clips = tuple(dict.fromkeys(of_subject.clip for of_subject in subjects))
    configurations = tuple(dict.fromkeys(of_subject.configuration for of_subject in subjects))
    metrics = load_metrics()
    says_nowhere = {
        *(base_of(name) for name, traits in reference.traits.items() if traits.says_nowhere),
        *(base_of(of_subject.configuration) for of_subject in subjects if of_subject.says_nowhere.any()),
    }
    phases = dict.fromkeys(phase for of_clip in reference.phases.values() for phase in of_clip.values())
    rows = [_row(*group, metrics, says_nowhere) for group in _groups(subjects, clips, configurations)]
    return Scores(
        clips=clips,
        configurations=configurations,
        rows=tuple(rows),
        notes=(
            *(*reference.notes, *map(Note, misfit_notes(directions))),
            *(*data_notes(judged, reference.settings), *label_notes(subjects)),
        ),
        published=reference.published,
        factors={base_of(name): place for name, place in reference.factors.items()},
        measures=measures,
        directions=tuple(directions),
        judged_subjects=tuple(subjects),
        unknown_names=reference.unknown_names,
        settings=reference.settings,
        is_recorded=reference.is_recorded,
        has_answers_of_file=any(traits.from_file for traits in reference.traits.values()),
        phases={phase: _phase_scores(judged_subjects(judged, reference, of_whole, phase), metrics) for phase in phases},
    )


def pair_verdicts(columns: PairColumns, reference: Reference) -> PairVerdicts:
    """The verdicts of a configuration on a clip."""
    clip = columns.clip
    return judge_columns(
        columns,
        reference.labels.get(clip),
        reference.wanted_frames(clip),
        reference.traits.get(columns.configuration, PLAIN),
        reference.phases.get(clip, {}),
    )


def _phase_scores(subjects: Sequence[JudgedSubject], metrics: Mapping[str, Metric]) -> Scores:
    clips = tuple(dict.fromkeys(of_subject.clip for of_subject in subjects if len(of_subject.frames)))
    configurations = tuple(dict.fromkeys(of_subject.configuration for of_subject in subjects))
    by_clip = [group for group in _groups(subjects, clips, configurations) if group[1] is None]
    overall = [group for group in by_clip if group[0] is None] or by_clip
    return Scores(
        clips=clips,
        configurations=configurations,
        rows=tuple(_row(*group, metrics, ()) for group in overall),
        judged_subjects=tuple(subjects),
    )


_Group = tuple[str | None, str | None, str, list[JudgedSubject]]


def _groups(subjects: Sequence[JudgedSubject], clips: Sequence[str], configurations: Sequence[str]) -> Iterator[_Group]:
    """Groups scored together, as (clip, subject, configuration, subjects), in the order of the tables."""
    scored = [of_subject for of_subject in subjects if len(of_subject.correct)]
    named = [(base_of(of_subject.configuration), of_subject) for of_subject in scored]
    names = dict.fromkeys(map(base_of, configurations))
    overall = grouped(named)
    by_clip = grouped(((each.clip, name), each) for name, each in named)
    by_subject = grouped(((each.clip, each.subject, name), each) for name, each in named)
    subjects_of = grouped((each.clip, each.subject) for each in scored)
    for clip in clips:
        yield from ((clip, None, name, by_clip[clip, name]) for name in names if (clip, name) in by_clip)
    if len(subjects_of) > 1:
        yield from ((None, None, name, overall[name]) for name in names if name in overall)
    for clip in clips:
        for subject in dict.fromkeys(subjects_of.get(clip, ())):
            for name in names:
                if group := by_subject.get((clip, subject, name)):
                    yield clip, subject, name, group


def _row(
    clip: str | None,
    subject: str | None,
    configuration: str,
    group: list[JudgedSubject],
    metrics: Mapping[str, Metric],
    says_nowhere: Collection[str],
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
        nowhere=_matches(nowhere, column("says_nowhere")) if configuration in says_nowhere else None,
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


def _seed_rates(group: list[JudgedSubject]) -> tuple[float, ...]:
    by_seed = grouped((of_subject.configuration, of_subject.correct) for of_subject in group)
    return tuple(float(np.concatenate(flags).mean()) for flags in by_seed.values()) if len(by_seed) > 1 else ()


def _matches(true: Flags, predicted: Flags) -> MatchCounts:
    return MatchCounts(true=_count(true), predicted=_count(predicted), matched=_count(true & predicted))


def _beats(group: list[JudgedSubject], baseline: str) -> Beats:
    place = list(BASELINES).index(baseline)
    gains = _units_of(group, [of_subject.correct.astype(int) - of_subject.baselines[:, place] for of_subject in group])
    if gains.values.sum() <= 0:
        return "no"
    return "yes" if sign_flip_p(gains.merged().values) < SIGNIFICANCE else "not shown"


def _best_baseline(group: list[JudgedSubject]) -> str:
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
