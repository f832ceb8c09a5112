"""Truth by answer as heatmaps, with the same rows and columns for all configurations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np
from matplotlib.figure import Figure

from harness.report.plots.style import PAGE_IN
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from harness.score.verdicts import NO_HIT, NO_PREDICTION, Verdict, answered
from vfoa.errors import VfoaError

MOST_NAMES = 24
Confusion = Counter[tuple[str, str]]
"""Scored frames by truth and answer."""


def draw_confusion(scores: Scores, clip: str | None) -> Figure:
    """A heatmap for each configuration, of one clip or of all clips together.

    Raises
    ------
    VfoaError
        If nothing is scored, or there are too many names for one figure.
    """
    asked = without_oracles(scores.configurations)
    counts: dict[str, Confusion] = {}
    for (of, configuration), found in confusions(scores.verdicts).items():
        if configuration in asked and (clip is None or of == clip):
            counts.setdefault(configuration, Confusion()).update(found)
    truths = sorted({truth for found in counts.values() for truth, _ in found})
    if not truths:
        raise VfoaError("plot: no frame is scored" + (f" in {clip!r}" if clip else ""))
    last = [NO_HIT, NO_PREDICTION]
    given = {answer for found in counts.values() for _, answer in found}
    answers = [*truths, *sorted(given - {*truths, *last}), *(name for name in last if name in given)]
    if len(answers) > MOST_NAMES:
        raise VfoaError(f"plot: found {len(answers)} targets; expected at most {MOST_NAMES}: choose a clip (--clip)")
    columns = min(len(counts), 2 if len(answers) > 8 else 3)
    rows = -(-len(counts) // columns)
    cell = PAGE_IN / columns / (len(answers) + 3)
    figure = Figure(figsize=(PAGE_IN, rows * (max(cell, 0.2) * len(truths) + 1.1)), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for panel, (configuration, found) in zip(panels, counts.items(), strict=False):
        matrix = np.array([[found[truth, answer] for answer in answers] for truth in truths], dtype=float)
        shares = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1)
        panel.imshow(shares, cmap="Greys", vmin=0, vmax=1.15, aspect="auto")
        for r, row in enumerate(matrix):
            for c, count in enumerate(row):
                if count:
                    panel.text(
                        c,
                        r,
                        f"{count:.0f}",
                        ha="center",
                        va="center",
                        fontsize=6.5,
                        color="w" if shares[r, c] > 0.55 else "k",
                    )
        panel.set_xticks(range(len(answers)), answers, rotation=60, ha="right")
        panel.set_yticks(range(len(truths)), truths)
        panel.set_title(configuration)
        panel.spines[:].set_visible(True)
    for panel in panels[len(counts) :]:
        panel.set_visible(False)
    figure.supxlabel("answer", fontsize=8)
    figure.supylabel("truth", fontsize=8)
    return figure


def confusions(verdicts: Iterable[Verdict]) -> dict[tuple[str, str], Confusion]:
    """Count scored frames by clip and configuration, in the order of the verdicts."""
    found: dict[tuple[str, str], Confusion] = {}
    for verdict in verdicts:
        if verdict.outcome != "unscored":
            of_pair = found.setdefault((verdict.clip, verdict.configuration), Counter())
            of_pair[str(verdict.truth), answered(verdict)] += 1
    return found
