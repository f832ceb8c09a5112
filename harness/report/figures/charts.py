"""The charts: rates with intervals, by clip, error types, confusion, calibration and the learning curve.

Each function returns a figure of a width in inches; its height follows from what it shows.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.textpath import TextPath

from harness.files.ascending import natural_order
from harness.report.figures.style import INK, LINE, PANEL, SOFT, canvas, colour, is_wide, shape
from harness.report.formats import shortened
from harness.report.page.data import ERROR_COLOURS, LETTERS
from harness.run.fitted import FitRecord
from harness.score.calibration import Reliability
from harness.score.fit_logit import COMMONEST, DEFAULT, FITTED
from harness.score.rows import ScoreRow
from harness.score.verdicts import ERROR_TYPES, Verdict, answered
from vfoa.scoring import NO_HIT, NO_PREDICTION, OTHER

Rows = Sequence[tuple[str, ScoreRow]]
"""Rows of scores, each with the name of its configuration in the figure."""

_FRR = "focus recognition rate (%)"
_MOST_NAMES = 24
"""Most rows and columns of a confusion; rarer names share one."""
_MOST_LETTERS = 28
"""Most letters of a name in a confusion: longer ones would leave no room for its panels."""


def forest(rows: Rows, width: float) -> Figure:
    """FRR of each configuration over all clips, with its 95 % interval and the best rule that knows no labels."""
    figure = canvas(width, 0.75 + 0.19 * len(rows))
    axes = figure.add_subplot()
    for y, (_, row) in enumerate(rows):
        _interval(axes, row, y, y, label="FRR, 95 % interval" if y == 0 else None)
        best = 100 * row.baselines[row.best_baseline]
        axes.plot(
            [best, best], [y - 0.34, y + 0.34], color=SOFT, ls=(0, (2, 1)), label="best simple rule" if y == 0 else None
        )
        axes.text(1.01, y, f"{100 * row.frr:.1f}", transform=axes.get_yaxis_transform(), va="center")
    _named(axes, [name for name, _ in rows])
    axes.set(xlabel=_FRR, xlim=_limits(rows))
    axes.grid(axis="x")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def by_clip(rows: Rows, width: float) -> Figure:
    """FRR of each configuration on every clip, with the interval of the clip's looks."""
    names = list(dict.fromkeys(name for name, _ in rows))
    clips = list(dict.fromkeys(row.clip for _, row in rows))
    step = 0.8 / len(names)
    columns = (4 if is_wide(width) else 2) if max(map(len, names)) < 22 else (2 if is_wide(width) else 1)
    lines = math.ceil(len(names) / columns)
    figure = canvas(width, 0.7 + 0.14 * lines + len(clips) * (0.08 + 0.075 * len(names)))
    axes = figure.add_subplot()
    seen: set[str] = set()
    for name, row in rows:
        number, place = names.index(name), clips.index(row.clip)
        y = place - 0.4 + step * (number + 0.5)
        _interval(axes, row, y, number, label=None if name in seen else name, size=2.8)
        seen.add(name)
    for place in range(0, len(clips), 2):
        axes.axhspan(place - 0.5, place + 0.5, color=PANEL, lw=0)
    _named(axes, [str(clip) for clip in clips])
    axes.set(xlabel=f"{_FRR}, 95 % interval", ylabel="clip", xlim=_limits(rows))
    axes.grid(axis="x")
    figure.legend(loc="outside upper center", ncols=columns)
    return figure


def error_types(rows: Rows, width: float) -> Figure:
    """The share of wrong frames of each configuration over all clips, by error type."""
    present = [name for name in ERROR_TYPES if any(row.error_types[name] for _, row in rows)]
    columns = 4 if is_wide(width) else 2
    figure = canvas(width, 0.65 + 0.14 * math.ceil(len(present) / columns) + 0.24 * len(rows))
    axes = figure.add_subplot()
    most = max([5.0, *(100 * (row.n - row.correct) / row.n for _, row in rows)])
    for name in present:
        for y, (_, row) in enumerate(rows):
            before = sum(row.error_types[earlier] for earlier in present[: present.index(name)])
            share, left = 100 * row.error_types[name] / row.n, 100 * before / row.n
            label = f"{LETTERS[name]}  {name.replace('_', ' ')}" if y == 0 else None
            fill = ERROR_COLOURS[name][0]
            axes.barh(y, share, left=left, height=0.72, color=fill, ec="white", lw=0.4, label=label)
            if share > 0.045 * most:
                axes.text(left + share / 2, y, LETTERS[name], color="white", ha="center", va="center", weight="bold")
    for y, (_, row) in enumerate(rows):
        axes.text(100 * (row.n - row.correct) / row.n + 0.01 * most, y, f"{100 - 100 * row.frr:.1f}", va="center")
    _named(axes, [name for name, _ in rows])
    axes.set(xlabel="wrong frames (% of the labelled ones)", xlim=(0, 1.12 * most))
    axes.grid(axis="x")
    figure.legend(loc="outside upper center", ncols=columns)
    return figure


def confusion(verdicts: Mapping[str, Sequence[Verdict]], width: float) -> Figure:
    """What was answered for each true target, over all clips: one panel per configuration, each row 100 %."""
    pairs = {name: Counter((str(v.truth), answered(v)) for v in found) for name, found in verdicts.items()}
    truths, answers = _axes_of(pairs.values())
    columns, side, size = (3, 0.105, 6) if is_wide(width) else (2, 0.08, 5)
    columns = min(len(pairs), columns)
    lines = math.ceil(len(pairs) / columns)
    shown = {name: shortened(name, _MOST_LETTERS) for name in answers}
    # names below the last panel of each column, which are in two lines of panels where the last line is not full
    below = max(_inches(name, size) for name in shown.values()) * (1 + (lines > 1 and len(pairs) % columns > 0))
    figure = canvas(width, 0.8 + below + lines * (0.24 + side * len(truths)))
    grid = np.atleast_1d(figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)).ravel()
    image: Any = None
    for axes, (name, counts) in zip(grid, pairs.items(), strict=False):
        table = np.zeros((len(truths), len(answers)))
        for (truth, answer), count in counts.items():
            table[_place(truths, truth), _place(answers, answer)] += count
        shares = 100 * table / np.maximum(table.sum(axis=1, keepdims=True), 1)
        image = axes.imshow(np.where(table, shares, np.nan), cmap="Blues", vmin=0, vmax=100, aspect="auto")
        for place, truth in enumerate(truths):  # the right answers are framed; rare names are right and wrong ones
            if truth in answers and truth != OTHER:
                x = answers.index(truth)
                axes.plot(x + _SQUARE[0], place + _SQUARE[1], color=INK, lw=0.5)
        axes.set_title(name, loc="left")
        axes.set_xticks(range(len(answers)), shown.values(), rotation=90, fontsize=size)
        axes.set_yticks(range(len(truths)), [shortened(name, _MOST_LETTERS) for name in truths], fontsize=size)
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
    for axes in grid[len(pairs) :]:
        axes.set_visible(False)
    for axes in grid[max(len(pairs) - columns, 0) : len(pairs)]:
        axes.tick_params(labelbottom=True)
    figure.supxlabel("answer (framed: the right one)", fontsize=7.5)
    figure.supylabel("ground truth", fontsize=7.5)
    bar = figure.colorbar(image, ax=grid.tolist(), location="top", shrink=0.6, aspect=40, pad=0.01)
    bar.set_label("% of the frames of a true target")
    bar.outline.set_visible(False)
    return figure


def _inches(text: str, points: float) -> float:
    """The length of a text in letters of this size."""
    return float(TextPath((0, 0), text, size=points).get_extents().width) / 72


_SQUARE = np.array([[-0.5, 0.5, 0.5, -0.5, -0.5], [-0.5, -0.5, 0.5, 0.5, -0.5]])


def _axes_of(pairs: Any) -> tuple[list[str], list[str]]:
    """The names of rows and columns: by their words and numbers, "none" and missing answers last, rare ones as one.

    That one is :data:`OTHER`.
    """
    counts: Counter[str] = Counter()
    truths, answers = set[str](), set[str]()
    for of_pair in pairs:
        for (truth, answer), count in of_pair.items():
            truths.add(truth)
            answers.add(answer)
            counts[truth] += count
            counts[answer] += count  # one that is never right has a column, too
    last = ("none", NO_HIT, NO_PREDICTION)
    common = {name for name, _ in counts.most_common(_MOST_NAMES)}
    kept = [sorted(names & common - set(last), key=natural_order) for names in (truths, truths | answers)]
    rare = [OTHER] if (truths | answers) - common - set(last) else []
    rows = [*kept[0], *([OTHER] if truths - common - set(last) else []), *(name for name in last if name in truths)]
    return rows, [*kept[1], *rare, *(name for name in last if name in truths | answers)]


def _place(names: Sequence[str], name: str) -> int:
    return names.index(name if name in names else OTHER)


def calibration(found: Sequence[tuple[str, Reliability]], width: float) -> Figure:
    """The share of right frames by confidence, in ten bins; the area of a marker is its number of frames."""
    columns = 2 if is_wide(width) else 1
    figure = canvas(width, min(width, 3.3) + 0.14 * math.ceil(len(found) / columns))
    axes = figure.add_subplot()
    axes.plot([0, 100], [0, 100], color=SOFT, ls=(0, (2, 2)), lw=0.8, label="calibrated")
    most = max(float(row.counts.max()) for _, row in found)
    for number, (name, row) in enumerate(found):
        label = f"{name}: error {row.calibration_error:.3f}, n {row.n}"
        seen = row.counts > 0
        x, y = 100 * row.confidence[seen], 100 * row.accuracy[seen]
        axes.plot(x, y, color=colour(number), label=label, marker=shape(number), ms=3)
        axes.scatter(
            x, y, s=4 + 60 * row.counts[seen] / most, color=colour(number), marker=shape(number), lw=0, alpha=0.45
        )
    axes.set(xlabel="confidence (%)", ylabel="right (% of the frames)", xlim=(0, 102), ylim=(0, 102))
    axes.grid()
    figure.legend(loc="outside upper center", ncols=columns)
    return figure


def learning_curve(fits: Sequence[tuple[str, FitRecord]], width: float) -> Figure:
    """FRR of the logit on what its fit did not see, by the labelled seconds that it was fitted to."""
    figure = canvas(width, 0.62 * min(width, 4.2) + 0.14 * 2 * len(fits))
    axes = figure.add_subplot()
    for number, (name, fit) in enumerate(fits):
        prefix = f"{name}: " if name else ""
        x, y = np.array(_points(fit)).T
        axes.plot(x, 100 * y, color=colour(number), marker=shape(number), ms=4, label=f"{prefix}{FITTED} weights")
        for method, line, label in _LEVELS:
            if score := fit.score_of(method):
                axes.axhline(100 * score.frr, color=colour(number), ls=line, lw=0.9, label=f"{prefix}{label}")
    axes.set_xscale("log")
    ticks = sorted({second for _, fit in fits for second, _ in _points(fit)})
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set(xlabel="labelled time that was fitted (s)", ylabel=_FRR)
    axes.grid()
    figure.legend(loc="outside upper center", ncols=3 if is_wide(width) else 1)
    return figure


def _points(fit: FitRecord) -> list[tuple[float, float]]:
    """Labelled seconds and FRR: of the parts, and of all labels."""
    points = [(float(row.method.removesuffix(" s")), row.frr) for row in fit.curve]
    whole = fit.score_of(f"{FITTED}, forward")
    return points + ([(fit.labelled_s, whole.frr)] if whole else [])


_LEVELS = (
    (f"{DEFAULT}, forward", (0, (4, 2)), DEFAULT),
    (COMMONEST, (0, (1, 1.5)), "commonest answer"),
)
"""Methods without a fit: the name in a fit's record, the line's dashes, and words for it."""


def _interval(axes: Any, row: ScoreRow, y: float, number: int, *, label: str | None, size: float = 4) -> None:
    """A rate with its interval; without one if it is not known."""
    if not math.isnan(row.interval.low):
        axes.plot([100 * row.interval.low, 100 * row.interval.high], [y, y], color=colour(number), lw=1)
    style = {"color": colour(number), "marker": shape(number), "ms": size, "lw": 0 if label is None else 1}
    axes.plot([100 * row.frr], [y], label=label, **style)


def _named(axes: Any, names: Sequence[str]) -> None:
    """Rows from top to bottom, with their names."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_color(LINE)


def _limits(rows: Rows) -> tuple[float, float]:
    """The range of rates, in steps of ten."""
    ends = [end for _, row in rows for end in (row.interval.low, row.frr, row.baselines[row.best_baseline])]
    lowest = min(end for end in ends if not math.isnan(end))
    return max(0.0, math.floor(10 * lowest - 0.3) * 10), 101.0
