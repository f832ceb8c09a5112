"""Scores of a run: the focus recognition rate (FRR) per clip and configuration, and how reliable it is.

FRR = correct / annotated (frame, subject) pairs without ``ignore``; a pair without a prediction is wrong. "Frame" means
such a pair below. Pooled over subjects or clips means all their pairs together: a longer clip weighs more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from harness.files.groups import grouped
from harness.run.columns import MeasureColumns, PairColumns
from harness.run.directory import Pair
from harness.run.grid import base_of
from harness.run.manifest import Published
from harness.run.notes import Note
from harness.score.calibration import DirectionCheck, direction_checks, misfit_notes
from harness.score.doubts import data_notes
from harness.score.intervals import ScoredFrames
from harness.score.judged_subjects import JudgedSubject, judged_subjects
from harness.score.mistaken_labels import label_notes
from harness.score.reference import Reference
from harness.score.rows import ScoreRows
from harness.score.verdict_columns import PairVerdicts, judge_columns
from harness.score.verdicts import PLAIN, Verdict

Value = TypeVar("Value")


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
    rows: ScoreRows = field(compare=False, repr=False)
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
    says_nowhere = {
        *(base_of(name) for name, traits in reference.traits.items() if traits.says_nowhere),
        *(base_of(of_subject.configuration) for of_subject in subjects if of_subject.says_nowhere.any()),
    }
    phases = dict.fromkeys(phase for of_clip in reference.phases.values() for phase in of_clip.values())
    return Scores(
        clips=clips,
        configurations=configurations,
        rows=ScoreRows(subjects, says_nowhere),
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
        phases={phase: _phase_scores(judged_subjects(judged, reference, of_whole, phase)) for phase in phases},
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


def _phase_scores(subjects: Sequence[JudgedSubject]) -> Scores:
    return Scores(
        clips=tuple(dict.fromkeys(of_subject.clip for of_subject in subjects if len(of_subject.frames))),
        configurations=tuple(dict.fromkeys(of_subject.configuration for of_subject in subjects)),
        rows=ScoreRows(subjects),
        judged_subjects=tuple(subjects),
    )
