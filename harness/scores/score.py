"""Scores of a run: the focus recognition rate (FRR) per clip and configuration, and what it is worth.

FRR = correct / annotated (frame, subject) pairs without ``ignore``; a pair without a prediction is wrong. "Frame" means
such a pair below. Pooled over subjects or clips means all their pairs together: a longer clip weighs more.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from harness.runs.measure_log import MeasureLog
from harness.runs.published import Published
from harness.runs.results import FrameRecord
from harness.scores.baselines import RULES
from harness.scores.events import EventCounts, count_events
from harness.scores.outcomes import Outcomes, collect_outcomes
from harness.scores.reference import Reference
from harness.scores.statistics import (
    Counts,
    Flags,
    Interval,
    bootstrap_interval,
    cohen_kappa,
    confusion_matrix,
    macro_f1,
    wilson_interval,
)
from harness.scores.verdicts import CAUSES, Verdict, judge
from vfoa.types import Float

__all__ = ["CAUSES", "ScoreRow", "Scores", "Verdict", "judge", "score"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreRow:
    """The scores of one configuration on one clip, on one subject of it, or on all clips together.

    ``clip`` is None for all clips, ``subject`` None for all subjects. ``predicted`` counts the frames with a
    prediction. Macro F1 is the mean over the labels that occur in the truth; for kappa, "no prediction" and "a target
    that is never the truth" are answers of their own. Measures are NaN where they have no value. ``baselines`` are
    the rates of the rules of :mod:`harness.scores.baselines`, ``causes`` the wrong frames by cause, in the order of
    :data:`CAUSES`, zeros included. ``resampled`` (replicates,) are the correct frames in each resample of the
    bootstrap: the same resamples for every configuration, so that two rows can be compared pair by pair.
    """

    clip: str | None
    subject: str | None
    configuration: str
    n: int
    correct: int
    predicted: int
    wilson: Interval
    bootstrap: Interval
    macro_f1: float
    kappa: float
    events: EventCounts
    baselines: Mapping[str, float]
    causes: Mapping[str, int]
    resampled: Float = field(compare=False, repr=False)

    @property
    def frr(self) -> float:
        """Share of the frames that are correct."""
        return self.correct / self.n

    @property
    def coverage(self) -> float:
        """Share of the frames with a prediction. FRR = coverage x :attr:`frr_predicted`."""
        return self.predicted / self.n

    @property
    def frr_predicted(self) -> float:
        """FRR given a detection: the share of correct ones among the frames with a prediction; NaN without any."""
        return self.correct / self.predicted if self.predicted else float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """All scores of a run. ``rows`` hold only what has annotated frames; ``verdicts`` the unscored frames, too.

    Clips and configurations are in the order of the results; verdicts by clip, configuration, subject, frame. ``notes``
    are what every table must say of the clips and the experiment, ``published`` somebody's figures to set beside.
    ``measures`` are the stages' against the truth.
    """

    clips: tuple[str, ...]
    configurations: tuple[str, ...]
    verdicts: tuple[Verdict, ...]
    rows: tuple[ScoreRow, ...]
    notes: tuple[str, ...] = ()
    published: Published | None = None
    measures: MeasureLog = field(default_factory=MeasureLog, compare=False, repr=False)

    def by_clip(self) -> list[ScoreRow]:
        """The rows of whole clips, and those of all clips together where there are several."""
        return [row for row in self.rows if row.subject is None]

    def by_subject(self) -> list[ScoreRow]:
        """The rows of single subjects."""
        return [row for row in self.rows if row.subject is not None]

    def verdicts_of(self, configuration: str) -> list[Verdict]:
        """One configuration's verdicts on all clips."""
        return [verdict for verdict in self.verdicts if verdict.configuration == configuration]


def score(records: Iterable[FrameRecord], reference: Reference) -> Scores:
    """Score every (clip, configuration) of which there are records.

    Parameters
    ----------
    records
        As :func:`harness.runs.results.read_results` gives them; each is looked at once.
    reference
        What they are scored against. A clip without labels has unscored verdicts and no rows.
    """
    measures = MeasureLog()
    outcomes = collect_outcomes(measures.watch(records), reference)
    clips = tuple(dict.fromkeys(each.clip for each in outcomes))
    configurations = tuple(dict.fromkeys(each.configuration for each in outcomes))
    rows = [row for group in _groups(outcomes, clips, configurations) if (row := _row(*group)) is not None]
    verdicts = tuple(verdict for each in outcomes for verdict in each.verdicts)
    return Scores(
        clips=clips,
        configurations=configurations,
        verdicts=verdicts,
        rows=tuple(rows),
        notes=reference.notes,
        published=reference.published,
        measures=measures,
    )


_Group = tuple[str | None, str | None, str, list[Outcomes]]


def _groups(outcomes: Sequence[Outcomes], clips: Sequence[str], configurations: Sequence[str]) -> Iterator[_Group]:
    """What is scored together, as (clip, subject, configuration, outcomes), in the order of the tables."""
    scored = [each for each in outcomes if len(each.correct)]
    for clip in clips:
        for configuration in configurations:
            group = [each for each in scored if (each.clip, each.configuration) == (clip, configuration)]
            yield clip, None, configuration, group
    if len({each.clip for each in scored}) > 1:
        for configuration in configurations:
            yield None, None, configuration, [each for each in scored if each.configuration == configuration]
    for clip in clips:
        for subject in dict.fromkeys(each.subject for each in scored if each.clip == clip):
            for each in scored:
                if (each.clip, each.subject) == (clip, subject):
                    yield clip, subject, each.configuration, [each]


def _row(clip: str | None, subject: str | None, configuration: str, group: list[Outcomes]) -> ScoreRow | None:
    if not group:
        return None
    correct, baselines = np.concatenate([each.correct for each in group]), _baselines(group)
    confusion = _confusion(group)
    resampled: Float = np.sum([each.resampled for each in group], axis=0)
    causes = Counter(cause for each in group for cause in each.causes)
    return ScoreRow(
        clip=clip,
        subject=subject,
        configuration=configuration,
        n=len(correct),
        correct=int(correct.sum()),
        predicted=int(sum(np.count_nonzero(each.predicted >= 0) for each in group)),
        wilson=wilson_interval(int(correct.sum()), len(correct)),
        bootstrap=bootstrap_interval([resampled], len(correct)),
        macro_f1=macro_f1(confusion),
        kappa=cohen_kappa(confusion),
        events=count_events((each.truth, each.predicted, each.positions) for each in group),
        baselines=baselines,
        causes={cause: causes[cause] for cause in CAUSES},
        resampled=resampled,
    )


def _baselines(group: list[Outcomes]) -> dict[str, float]:
    hits: Flags = np.concatenate([each.baselines for each in group])
    return dict(zip(RULES, hits.mean(axis=0).tolist(), strict=True))


def _confusion(group: list[Outcomes]) -> Counts:
    """Truth by answer, over the labels that occur in the truth, then any other answer or none.

    Answers that are never the truth are one: telling them apart would change neither kappa nor macro F1.
    """
    truth, predicted = (np.concatenate([getattr(each, name) for each in group]) for name in ("truth", "predicted"))
    labels, true_codes = np.unique(truth, return_inverse=True)
    another = len(labels)
    nearest = np.minimum(np.searchsorted(labels, predicted), another - 1)
    answers = np.where(labels[nearest] == predicted, nearest, another)
    return confusion_matrix(true_codes, answers, another + 1)
