"""The oracle ladder as a table: what each stage costs."""

from __future__ import annotations

from dataclasses import replace

from harness.report.formats import Table
from harness.scores.ladder import steps
from harness.scores.score import Scores


def ladder_table(scores: Scores) -> Table:
    """Points of FRR that each stage costs, over all clips; no rows for a run without ``--oracle``."""
    return Table(
        title="Oracle ladder: what each stage costs",
        columns=("Rung", "Against the row above", "n", "FRR %", "Points", "Bootstrap"),
        words=2,
        rows=tuple(
            (
                step.configuration if step.replaced is None else f"+ true {step.replaced.replace('_', ' ')}",
                step.reads,
                str(step.row.n),
                f"{100 * step.row.frr:.1f}",
                "" if step.gained is None else f"{100 * step.gained:+.1f}",
                "" if step.interval is None else f"{100 * step.interval.low:+.1f} to {100 * step.interval.high:+.1f}",
            )
            for step in steps(scores)
        ),
        notes=(
            "Each row replaces one stage more by the truth. Points: FRR gained by that, given the rows above: errors "
            "interact, and a stage's error can hide another's (boxes that are too large forgive a gaze that is off). "
            "Bootstrap: 95 % interval of the points, both rungs on the same resamples (moving blocks of one second). "
            "As good: it holds 0.",
            "A true head pose can cost frames: a head need not point at what the eyes look at, and one that stops "
            "short of it is turned onto it by an error at times.",
        ),
    )


def terminal_ladder(scores: Scores) -> Table:
    """The same with fewer words under it."""
    return replace(
        ladder_table(scores),
        notes=(
            "Each row replaces one stage more by the truth; points of FRR gained by that, with their 95 % interval "
            "(as good: it holds 0). frr.md says how to read it.",
        ),
    )


def ladder_csv(scores: Scores) -> Table:
    """The same for programs: shares with six decimals, empty for the lowest rung."""
    return Table(
        title="Oracle ladder",
        columns=("configuration", "replaced", "n", "frr", "gained", "gained_low", "gained_high", "reads"),
        words=2,
        rows=tuple(
            (
                *(step.configuration, step.replaced or "", str(step.row.n), f"{step.row.frr:.6f}"),
                "" if step.gained is None else f"{step.gained:.6f}",
                *(("", "") if step.interval is None else (f"{step.interval.low:.6f}", f"{step.interval.high:.6f}")),
                step.reads,
            )
            for step in steps(scores)
        ),
    )
