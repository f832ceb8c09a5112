"""All that the tables and the page keep of a run's records, gathered record by record or taken over in parts."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

from harness.report.formats import Table
from harness.report.frames import FrameLines, FrameRows
from harness.report.page.attention_log import AttentionLog, TrackPart
from harness.report.reliability import direction_check_table, prediction_set_table
from harness.run.measure_log import MeasureLog
from harness.run.records import DirectionFitRecord, FrameRecord
from harness.score.outcomes import Judged, OutcomeLog
from harness.score.posterior_checks import DirectionLog, SetLog
from harness.score.reference import Reference
from harness.score.reliability import BeliefLog, Sureness
from harness.score.score import Scores, score_outcomes
from harness.stages.measures import FrameMeasures


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """What the logs have of some records of one configuration on one clip, in plain values."""

    judged: dict[str, Judged]
    times_ns: dict[int, int]
    measures: list[FrameMeasures]
    names: dict[int, str]
    rows: list[FrameLines]
    beliefs: dict[str, list[Sureness]]
    sets: list[tuple[bool, int]]
    fits: list[DirectionFitRecord]
    attention: dict[str, TrackPart]
    targets: list[str]


class RecordLogs:
    """The logs of a run. ``probabilistic`` are the configurations whose attention is a probability."""

    def __init__(self, reference: Reference, probabilistic: Collection[str]) -> None:
        self._reference = reference
        self.outcomes, self.measures = OutcomeLog(reference), MeasureLog()
        self.frames, self.attention = FrameRows(), AttentionLog()
        self.beliefs = BeliefLog(probabilistic, reference.labels)
        self.sets, self.directions = SetLog(reference.labels), DirectionLog()

    def watch(self, records: Iterable[FrameRecord]) -> None:
        """Look at each record once."""
        watched = self.directions.watch(self.sets.watch(self.beliefs.watch(self.frames.watch(records))))
        deque(map(self.outcomes.judge, self.measures.watch(self.attention.watch(watched))), maxlen=0)

    def scores(self) -> Scores:
        """The scores of all that was watched or added; notes tell where directions do not fit the posterior."""
        scores = score_outcomes(self.outcomes.outcomes(), self.measures, self._reference)
        unfit = (each.sentence() for each in self.directions.checks() if not each.fits)
        return replace(scores, notes=(*scores.notes, *unfit))

    def tables(self) -> tuple[Table, ...]:
        """How sets of answers and measured directions do."""
        return prediction_set_table(self.sets.coverages()), direction_check_table(self.directions.checks())

    def part(self, clip: str, configuration: str) -> Part:
        """What these logs, which have watched one configuration on one clip, have to give to others."""
        judged, times_ns = self.outcomes.part(clip, configuration)
        measures, names = self.measures.part(clip, configuration)
        attention, targets = self.attention.part()
        return Part(
            judged=judged,
            times_ns=times_ns,
            measures=measures,
            names=names,
            rows=self.frames.part(),
            beliefs=self.beliefs.part(clip, configuration),
            sets=self.sets.part(configuration),
            fits=self.directions.part(clip, configuration),
            attention=attention,
            targets=targets,
        )

    def add(self, clip: str, configuration: str, part: Part) -> None:
        """Take over what other logs have watched of one configuration on one clip."""
        self.outcomes.add(clip, configuration, part.judged, part.times_ns)
        self.measures.add(clip, configuration, part.measures, part.names)
        self.frames.add(clip, configuration, part.rows)
        self.beliefs.add(clip, configuration, part.beliefs)
        self.sets.add(configuration, part.sets)
        self.directions.add(clip, configuration, part.fits)
        self.attention.add(clip, configuration, part.attention, part.targets)
