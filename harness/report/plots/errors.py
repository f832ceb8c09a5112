"""Error types of the wrong frames, stacked by configuration."""

from __future__ import annotations

from matplotlib.figure import Figure

from harness.report.plots.style import COLUMN_IN, error_style
from harness.report.verdict import overall
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from harness.score.verdicts import ERROR_TYPES


def draw_errors(scores: Scores) -> Figure:
    """Shares of the scored frames by error type, over all clips."""
    names = without_oracles(scores.scored_configurations)
    rows = [row for row in overall(scores) if row.configuration in names]
    seen = [each for each in ERROR_TYPES if any(row.error_types[each] for row in rows)]
    figure = Figure(figsize=(1.5 * COLUMN_IN, 0.28 * len(rows) + 1.2), layout="constrained")
    axes = figure.subplots()
    starts = [0.0] * len(rows)
    for error_type in seen:
        colour, hatch = error_style(error_type)
        shares = [100 * row.error_types[error_type] / row.n for row in rows]
        axes.barh(
            range(len(rows)),
            shares,
            left=starts,
            height=0.7,
            color=colour,
            edgecolor="white",
            hatch=hatch,
            label=error_type.replace("_", " "),
        )
        starts = [start + share for start, share in zip(starts, shares, strict=True)]
    axes.set_yticks(range(len(rows)), [row.configuration for row in rows])
    axes.invert_yaxis()
    axes.set_xlabel("share of the scored frames, %")
    figure.legend(loc="outside lower center", ncols=3)
    return figure
