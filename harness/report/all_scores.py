"""``frr.csv``: every measure of every row, for programs."""

from __future__ import annotations

import math

from harness.report.formats import Table
from harness.scores.baselines import RULES
from harness.scores.score import CAUSES, ScoreRow, Scores

ALL = "(all)"
"""What stands for the clip, or the subject, in a row over all of them."""


def scores_table(scores: Scores) -> Table:
    """Every measure of every row, for programs: shares with six decimals, unknown ones empty."""
    columns = (
        *("clip", "subject", "configuration", "n", "correct", "wrong", "predicted", "frr"),
        *("wilson_low", "wilson_high", "bootstrap_low", "bootstrap_high", "coverage", "frr_predicted"),
        *("macro_f1", "kappa", "true_events", "found_events", "matched_events"),
        *("event_recall", "event_precision", "event_f"),
        *(f"baseline_{rule}" for rule in RULES),
        *(f"cause_{cause}" for cause in CAUSES),
    )
    return Table(title="Scores", columns=columns, words=3, rows=tuple(_score_cells(row) for row in scores.rows))


def _score_cells(row: ScoreRow) -> tuple[str, ...]:
    events = row.events
    return (
        *(row.clip or ALL, row.subject or ALL, row.configuration),
        *map(str, (row.n, row.correct, row.n - row.correct, row.predicted)),
        *map(_share, (row.frr, row.wilson.low, row.wilson.high, row.bootstrap.low, row.bootstrap.high)),
        *map(_share, (row.coverage, row.frr_predicted, row.macro_f1, row.kappa)),
        *map(str, (events.true, events.found, events.matched)),
        *map(_share, events.rates),
        *(_share(row.baselines[rule]) for rule in RULES),
        *(str(row.causes[cause]) for cause in CAUSES),
    )


def _share(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6f}"
