"""``frr.csv``: every measure of every row, for programs."""

from __future__ import annotations

import math

from harness.report.formats import Table
from harness.score.baselines import BASELINES
from harness.score.metrics import load_metrics
from harness.score.score import ERROR_TYPES, ScoreRow, Scores
from vfoa.errors import VfoaError

ALL = "(all)"
"""The clip, or the subject, in a row over all of them."""


def scores_table(scores: Scores) -> Table:
    """Every measure of every row, for programs: shares with six decimals, unknown ones empty.

    Raises
    ------
    VfoaError
        If a metric has the name of a column that is there already.
    """
    columns = (
        *("clip", "subject", "configuration", "n", "looks", "clips", "correct", "wrong", "predicted", "no_hit", "frr"),
        *("interval_low", "interval_high", "interval_unit", "wilson_low", "wilson_high", "coverage", "frr_predicted"),
        *("n_visible", "frr_visible"),
        *("none_true", "none_said", "none_right", "none_precision", "none_recall"),
        *("true_events", "found_events", "matched_events", "event_recall", "event_precision", "event_f"),
        *(f"baseline_{name}" for name in BASELINES),
        "beats_baselines",
        *(f"error_type_{error_type}" for error_type in ERROR_TYPES),
    )
    metrics = tuple(load_metrics())
    if taken := sorted({*columns} & {*metrics}):
        raise VfoaError(f"metric {taken[0]!r}: frr.csv has a column of that name; expected another name")
    rows = tuple((*_score_cells(row), *(_share(row.metrics[name]) for name in metrics)) for row in scores.rows)
    return Table(title="Scores", columns=(*columns, *metrics), words=3, rows=rows)


def _score_cells(row: ScoreRow) -> tuple[str, ...]:
    events = row.events
    return (
        *(row.clip or ALL, row.subject or ALL, row.configuration),
        *map(str, (row.n, row.looks, row.clips, row.correct, row.n - row.correct, row.predicted, row.no_hit)),
        *map(_share, (row.frr, row.interval.low, row.interval.high)),
        "" if math.isnan(row.interval.low) else row.interval.unit,
        *map(_share, (row.wilson.low, row.wilson.high, row.coverage, row.frr_predicted)),
        *(str(row.visible), _share(row.frr_visible)),
        *_nowhere_cells(row),
        *map(str, (events.true, events.found, events.matched)),
        *map(_share, events.rates),
        *(_share(row.baselines[name]) for name in BASELINES),
        row.beats,
        *(str(row.error_types[error_type]) for error_type in ERROR_TYPES),
    )


def _nowhere_cells(row: ScoreRow) -> tuple[str, ...]:
    found = row.nowhere
    if found is None:
        return ("",) * 5
    return (*map(str, (found.true, found.said, found.right)), _share(found.precision), _share(found.recall))


def _share(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6f}"
