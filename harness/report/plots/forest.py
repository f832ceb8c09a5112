"""Rates with their intervals: every configuration over all clips, and clip by clip."""

from __future__ import annotations

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.report.plots.style import GREY, PAGE_IN, colour, marker
from harness.report.verdict import overall
from harness.score.oracle_ablation import without_oracles
from harness.score.score import ScoreRow, Scores

MOST_CLIPS = 30
"""Most clips that fit a page; if there are more, those with the largest differences are drawn."""


def draw_forest(scores: Scores) -> Figure:
    """Focus recognition rates with 95 % intervals; a dash marks the best baseline."""
    names = without_oracles(scores.scored_configurations)
    pooled = [row for row in overall(scores) if row.configuration in names]
    clips = _clips(scores, names)
    height = max(0.28 * len(pooled), 0.13 * len(names) * len(clips) + 0.08 * len(clips)) + 0.8
    figure = Figure(figsize=(PAGE_IN if clips else 0.6 * PAGE_IN, height), layout="constrained")
    panels = figure.subplots(1, 2, squeeze=False)[0] if clips else [figure.subplots()]
    _draw(panels[0], pooled, [(len(pooled) - 1 - i) for i in range(len(pooled))], names)
    _finish(panels[0], pooled)
    panels[0].set_yticks(range(len(pooled)), [row.configuration for row in reversed(pooled)])
    panels[0].set_title("All clips" if clips else f"{pooled[0].clip or 'All clips'}")
    panels[0].plot([], [], color=GREY, ls=(0, (2, 1)), label="best baseline")
    panels[0].legend(loc="upper center", bbox_to_anchor=(0.5, -0.16))
    if clips:
        _draw_clips(panels[1], clips, names)
    return figure


def _clips(scores: Scores, names: Sequence[str]) -> list[tuple[str, list[ScoreRow]]]:
    rows = [row for row in scores.by_clip() if row.clip is not None and row.configuration in names]
    found = {clip: [row for row in rows if row.clip == clip] for clip in dict.fromkeys(str(row.clip) for row in rows)}
    if len(found) < 2:
        return []
    largest = sorted(found, key=lambda clip: -(max(r.frr for r in found[clip]) - min(r.frr for r in found[clip])))
    return [(clip, each) for clip, each in found.items() if clip in largest[:MOST_CLIPS]]


def _draw_clips(axes: Axes, clips: Sequence[tuple[str, Sequence[ScoreRow]]], names: Sequence[str]) -> None:
    step = len(names) + 0.8
    for place, (_, rows) in enumerate(clips):
        top = step * (len(clips) - place)
        if place % 2 == 0:
            axes.axhspan(top - step + 0.1, top + 0.1, color="0.95", lw=0)
        _draw(axes, rows, [top - 0.8 - names.index(row.configuration) for row in rows], names, baselines=False)
    _finish(axes, [row for _, rows in clips for row in rows])
    axes.set_yticks([step * (len(clips) - i - 0.5) + 0.1 for i in range(len(clips))], [clip for clip, _ in clips])
    axes.tick_params(axis="y", length=0)
    shown = len(clips)
    axes.set_title("By clip" if shown < MOST_CLIPS else f"The {shown} clips with the largest differences")
    handles = [
        axes.plot([], [], color=colour(i), marker=marker(i), ls="", label=name)[0] for i, name in enumerate(names)
    ]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=4)


def _draw(
    axes: Axes, rows: Sequence[ScoreRow], heights: Sequence[float], names: Sequence[str], *, baselines: bool = True
) -> None:
    for row, y in zip(rows, heights, strict=True):
        number = names.index(row.configuration)
        if not math.isnan(row.interval.low):
            axes.plot([100 * row.interval.low, 100 * row.interval.high], [y, y], color=colour(number), marker="|")
        axes.plot(100 * row.frr, y, color=colour(number), marker=marker(number), ls="", ms=5)
        if baselines:
            best = 100 * row.baselines[row.best_baseline]
            axes.plot([best, best], [y - 0.3, y + 0.3], color=GREY, ls=(0, (2, 1)))


def _finish(axes: Axes, rows: Sequence[ScoreRow]) -> None:
    lowest = min(min(row.frr, row.frr if math.isnan(row.interval.low) else row.interval.low) for row in rows)
    axes.set_xlim(max(100 * lowest - 4, -1), 101)
    axes.set_xlabel("focus recognition rate, %")
    axes.grid(axis="x", color="0.9", lw=0.5)
    axes.set_axisbelow(True)
