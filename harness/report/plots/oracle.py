"""The oracle ablation as waterfalls: points of FRR that each stage costs."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.report.plots.style import COLUMN_IN, GREY, PAGE_IN, colour
from harness.score.oracle_ablation import Step, steps
from harness.score.score import Scores
from vfoa.errors import VfoaError


def draw_oracle(scores: Scores) -> Figure:
    """Draw a panel for each configuration: its rate, then the points gained by each true stage.

    Raises
    ------
    VfoaError
        If the run has no oracle ablation.
    """
    groups: list[list[Step]] = []
    for step in steps(scores):
        if step.replaced is None:
            groups.append([])
        groups[-1].append(step)
    if not groups:
        raise VfoaError("plot: the run has no oracle ablation; `vfoa run EXPERIMENT --oracle` makes one")
    columns = min(len(groups), 4)
    rows = -(-len(groups) // columns)
    width = COLUMN_IN if columns == 1 else PAGE_IN
    figure = Figure(figsize=(width, 2.3 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for panel, group in zip(panels, groups, strict=False):
        _draw(panel, group)
    for panel in panels[len(groups) :]:
        panel.set_visible(False)
    for panel in panels[::columns]:
        panel.set_ylabel("focus recognition rate, %")
    return figure


def _draw(axes: Axes, group: Sequence[Step]) -> None:
    rates = [100 * step.row.frr for step in group]
    axes.bar(0, rates[0], width=0.7, color="0.75")
    axes.text(0, rates[0], f"{rates[0]:.1f}", ha="center", va="bottom")
    for i, step in enumerate(group[1:], start=1):
        before, now = rates[i - 1], rates[i]
        gained = now - before
        axes.bar(
            i,
            gained,
            bottom=before,
            width=0.7,
            color=colour(2 if gained >= 0 else 1),
            hatch="" if gained >= 0 else "///",
        )
        if step.interval is not None and not math.isnan(step.interval.low):
            ends = [before + 100 * step.interval.low, before + 100 * step.interval.high]
            axes.plot([i, i], ends, color="0.2", lw=0.8, marker="_", ms=4)
        axes.plot([i - 1.35, i + 0.35], [before, before], color=GREY, lw=0.6)
        axes.text(i, max(before, now), f"{gained:+.1f}", ha="center", va="bottom")
    labels = ["as run", *(f"true {str(step.replaced).replace('_', ' ')}" for step in group[1:])]
    axes.set_xticks(range(len(group)), labels, rotation=40, ha="right")
    axes.set_title(group[0].configuration)
    axes.set_ylim(0, 112)
