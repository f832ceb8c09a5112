"""``frr.csv``: every measure of every row; ``frames.csv``: per frame, subject and target, attention and verdict."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache

from harness.columns import FRAMES_COLUMNS, frr_columns
from harness.report.formats import Table, csv_cell, csv_share
from harness.run.records import FrameRecord, SubjectRecord
from harness.score.baselines import BASELINES
from harness.score.calibration import prediction_set
from harness.score.part_log import PartLog
from harness.score.score import ScoreRow, Scores
from harness.score.verdicts import ERROR_TYPES, Verdict

ALL = "(all)"
"""The clip, or the subject, in a row over all of them."""


def scores_table(scores: Scores) -> Table:
    """Every measure of every row, for programs: shares with six decimals, unknown values empty.

    Raises
    ------
    VfoaError
        If a metric has the name of an existing column.
    """
    return Table(
        title="Scores",
        columns=tuple(frr_columns()),
        words=3,
        rows=tuple((*_score_cells(row, scores), *map(csv_share, row.metrics.values())) for row in scores.rows),
    )


def _score_cells(row: ScoreRow, scores: Scores) -> tuple[str, ...]:
    events, said, nowhere = row.events, row.nowhere, [""] * 5
    if said:
        nowhere[:] = (
            *map(str, (said.true, said.predicted, said.matched)),
            csv_share(said.precision),
            csv_share(said.recall),
        )
    return (
        *(row.clip or ALL, row.subject or ALL, row.configuration),
        *map(str, (row.n, row.looks, row.clips, row.correct, row.n - row.correct, row.predicted, row.no_hit)),
        *map(csv_share, (row.frr, row.interval.low, row.interval.high)),
        "" if math.isnan(row.interval.low) else row.interval.unit,
        *map(csv_share, (row.wilson.low, row.wilson.high, row.coverage, row.frr_predicted)),
        *(str(row.visible), csv_share(row.frr_visible)),
        *nowhere,
        *map(str, (events.true, events.predicted, events.matched)),
        *map(csv_share, events.rates),
        *(csv_share(row.baselines[name]) for name in BASELINES),
        row.beats,
        *(str(row.error_types[error_type]) for error_type in ERROR_TYPES),
        _unknown_names(row, scores),
    )


def _unknown_names(row: ScoreRow, scores: Scores) -> str:
    clips = scores.unknown_names if row.clip is None else (row.clip,)
    return " ".join(dict.fromkeys(name for clip in clips for name in scores.unknown_names.get(clip, ())))


_cell = lru_cache(maxsize=None)(csv_cell)
FrameLines = tuple[int, str | None, list[str]]
"""A frame, a subject in it, and the beginnings of their rows."""


class FrameRows(PartLog[list[FrameLines]]):
    """Collects the rows of ``frames.csv`` from passing records, so that a long run is read once."""

    def __init__(self) -> None:
        super().__init__(list)

    def take(self, record: FrameRecord) -> None:
        """Add the rows of a record."""
        start = _start(record.clip, record.configuration, record.frame, time=f"{record.time_ns / 1e9:.3f}")
        names = {target.instance_id: _cell(target.name) for target in record.targets}
        rows = self.part(record.clip, record.configuration)
        for subject in record.subjects:
            lines = _subject_lines(f"{start}{_cell(subject.name or '')},{subject.track_id},", subject, names)
            rows.append((record.frame, subject.name, lines))

    def to_csv(self, verdicts: Iterable[Verdict]) -> str:
        """Return the table as text, in the order of the records: one row per target, ``focus`` 1 for the one looked at.

        A subject without attention values has one row without a target. Labelled frames that have no such subject, or
        no record, come last. ``set_90`` is 1 for the targets of the smallest set with 90 % of the probability, and
        blank if attention is no probability. Attention has four decimals, time three. A person that the manifest does
        not know has a track and no name.
        """
        judged = {(each.clip, each.configuration, each.frame, each.subject): each for each in verdicts}
        text = [",".join(FRAMES_COLUMNS) + "\n"]
        for pair, rows in self.parts.items():
            for frame, subject, lines in rows:
                # removed when used: if tracks share a name, the first is the one that was judged
                end = _judgement(judged.pop((*pair, frame, subject), None) if subject is not None else None)
                text += (end.join(lines), end) if lines else ()
        for verdict in judged.values():
            start = _start(verdict.clip, verdict.configuration, verdict.frame, time="")
            text.append(f"{start}{_cell(verdict.subject)},,,,,,,,,{_judgement(verdict)}")
        return "".join(text)


def _start(clip: str, configuration: str, frame: int, time: str) -> str:
    return f"{_cell(clip)},{_cell(configuration)},{frame},{time},"


def _subject_lines(start: str, subject: SubjectRecord, names: dict[int, str]) -> list[str]:
    if not subject.attention:
        return [f"{start},,,,,,,"]
    held = prediction_set(subject)
    return [
        f"{start}{names[value.instance_id]},{value.instance_id},{_number(value.gaze)},{_number(value.head)},"
        f"{value.total:.4f},{1 if value.instance_id == subject.focus else 0},"
        f"{'' if held is None else int(value.instance_id in held)},"
        for value in subject.attention
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"


def _judgement(verdict: Verdict | None) -> str:
    if verdict is None:
        return ",,,\n"
    return (
        f"{_cell(verdict.truth or '')},{_cell(verdict.predicted or '')},{verdict.outcome},{verdict.error_type or ''}\n"
    )
