"""A run's scores on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.scores.score import Scores


def print_scores(scores: Scores) -> None:
    """Print the FRR table, and what a reader must know of it."""
    from rich.console import Console

    from harness.report.formats import to_rich
    from harness.report.oracle import ladder_table
    from harness.report.published import published_table
    from harness.report.stage_measures import pooled_measures_table
    from harness.report.tables import terminal_table

    table = terminal_table(scores)
    console = Console()
    console.print(to_rich(table))
    for note in table.notes:
        console.print(f"- {note}", highlight=False, markup=False)
    for more in (published_table(scores), ladder_table(scores), pooled_measures_table(scores)):
        if more.rows:
            console.print(to_rich(more))
