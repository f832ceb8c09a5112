"""A sweep as heatmaps whose axes are the numbers themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.report.plots.style import PAGE_IN
from harness.report.sweep_grid import SweepGrid, edges, grid_of
from harness.score.sweep.runner import Sweep
from vfoa.types import Float


def draw_sweep(sweep: Sweep) -> Figure:
    """Focus recognition rates by two factors: the mean over all other settings, and the best of them."""
    grid = grid_of(sweep)
    others = len(grid.columns) - grid.numbers
    widths = [max(grid.numbers, 3), max(others, 2)] if grid.numbers and others else [1]
    figure = Figure(figsize=(PAGE_IN, 0.26 * len(grid.rows) * 2 + 2.4), layout="constrained")
    panels = figure.subplots(2, len(widths), squeeze=False, sharey=True, gridspec_kw={"width_ratios": widths})
    titles = ("Mean over all other settings", "Best of all other settings")
    low = float(np.nanmin(grid.mean))
    mesh: Any = None
    for row, (rates, title) in enumerate(zip((grid.mean, grid.best), titles, strict=True)):
        parts = [slice(0, grid.numbers), slice(grid.numbers, None)]
        for axes, part in zip(panels[row], [each for each in parts if len(grid.columns[each])], strict=True):
            mesh = _draw(axes, grid, rates, part, low)
        panels[row][0].set_title(title)
        panels[row][0].set_ylabel(grid.per)
    for axes in panels[1]:
        axes.set_xlabel(grid.across)
    figure.colorbar(mesh, ax=panels.ravel().tolist(), label="focus recognition rate, %", shrink=0.7)
    return figure


def _draw(axes: Axes, grid: SweepGrid, rates: Float, part: slice, low: float) -> Any:
    labels, cells = grid.columns[part], 100 * rates[:, part]
    numeric = part.start == 0 and grid.numbers > 0
    x = [float(label) for label in labels] if numeric else [float(i) for i in range(len(labels))]
    y = list(grid.row_numbers) if grid.row_numbers else [float(i) for i in range(len(grid.rows))]
    mesh = axes.pcolormesh(edges(x), edges(y), cells, cmap="cividis", vmin=100 * low, vmax=100, edgecolors="w", lw=0.3)
    axes.set_xticks(x, labels, rotation=90)
    axes.set_yticks(y, grid.rows)
    axes.spines[:].set_visible(False)
    best = np.nanargmax(cells, axis=1)
    axes.plot([x[i] for i in best], y, ls="", marker="o", mfc="w", mec="k", ms=4, mew=0.6)
    return mesh
