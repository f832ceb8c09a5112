"""A run's scores on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.scores.score import Scores


def print_scores(scores: Scores) -> None:
    """Print the FRR table, and what else fits a terminal, each with what a reader must know of it."""
    from harness.cli.printing import print_reports
    from harness.report.oracle import terminal_ladder
    from harness.report.published import published_table
    from harness.report.stage_measures import terminal_measures
    from harness.report.tables import terminal_table

    others = (published_table(scores), terminal_ladder(scores), terminal_measures(scores))
    print_reports((terminal_table(scores), *(table for table in others if table.rows)))
