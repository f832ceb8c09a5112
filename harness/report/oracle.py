"""The oracle ladder as a table: what each stage costs."""

from __future__ import annotations

from harness.ladder import steps
from harness.report.formats import Table
from harness.score import Scores


def ladder_table(scores: Scores) -> Table:
    """Points of FRR that each stage costs, over all clips; no rows for a run without ``--oracle``."""
    return Table(
        title="Oracle ladder: what each stage costs",
        columns=("Configuration", "Replaced by truth", "n", "FRR %", "Wilson", "Points"),
        words=2,
        rows=tuple(
            (
                step.configuration,
                (step.replaced or "nothing").replace("_", " "),
                str(step.row.n),
                f"{100 * step.row.frr:.1f}",
                f"{100 * step.row.wilson.low:.0f}–{100 * step.row.wilson.high:.0f}",
                "" if step.gained is None else f"{100 * step.gained:+.1f}",
            )
            for step in steps(scores)
        ),
        notes=(
            "Each row replaces one stage more by the truth. Points: FRR gained by that, given the rows above: errors "
            "interact, and a stage's error can hide another's (boxes that are too large forgive a gaze that is off).",
        ),
    )
