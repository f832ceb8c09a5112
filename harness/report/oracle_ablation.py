"""The oracle ablation as a table: what each stage costs."""

from __future__ import annotations

import math
from dataclasses import replace

from harness.report.formats import UNKNOWN, Table
from harness.score.oracle_ablation import steps
from harness.score.score import Scores
from harness.score.statistics import Interval


def ablation_table(scores: Scores) -> Table:
    """Points of FRR that each stage costs, over all clips; no rows for a run without ``--oracle``."""
    return Table(
        title="Oracle ablation: what each stage costs",
        columns=("Step", "Against the row above", "n", "FRR %", "Points", "95 %"),
        words=2,
        rows=tuple(
            (
                step.configuration if step.replaced is None else f"+ true {step.replaced.replace('_', ' ')}",
                step.reads,
                str(step.row.n),
                f"{100 * step.row.frr:.1f}",
                "" if step.gained is None else f"{100 * step.gained:+.1f}",
                _range(step.interval),
            )
            for step in steps(scores)
        ),
        notes=(
            "Each row replaces one stage more by the truth. Points: FRR gained by that, given the rows above: errors "
            "interact, and a stage's error can hide another's (boxes that are too large forgive a gaze that is off). "
            "95 %: interval of the points, by clips or, below 6 clips, by looks of these clips. As good: it holds 0.",
            "A true head pose can cost frames: a head need not point at what the eyes look at, and one that stops "
            "short of it is turned onto it by an error at times.",
        ),
    )


def terminal_ablation(scores: Scores) -> Table:
    """The same with fewer words under it."""
    return replace(
        ablation_table(scores),
        notes=(
            "Each row replaces one stage more by the truth; points of FRR gained by that, with their 95 % interval "
            "(as good: it holds 0). frr.md says how to read it.",
        ),
    )


def ablation_csv(scores: Scores) -> Table:
    """The same for programs: shares with six decimals, empty for the first step."""
    return Table(
        title="Oracle ablation",
        columns=("configuration", "replaced", "n", "frr", "gained", "gained_low", "gained_high", "reads"),
        words=2,
        rows=tuple(
            (
                *(step.configuration, step.replaced or "", str(step.row.n), f"{step.row.frr:.6f}"),
                "" if step.gained is None else f"{step.gained:.6f}",
                *_ends(step.interval),
                step.reads,
            )
            for step in steps(scores)
        ),
    )


def _range(interval: Interval | None) -> str:
    if interval is None:
        return ""
    return UNKNOWN if math.isnan(interval.low) else f"{100 * interval.low:+.1f} to {100 * interval.high:+.1f}"


def _ends(interval: Interval | None) -> tuple[str, str]:
    if interval is None or math.isnan(interval.low):
        return "", ""
    return f"{interval.low:.6f}", f"{interval.high:.6f}"
