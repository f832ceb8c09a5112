"""How far probabilities can be believed, as a table and as a diagram."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from harness.report.formats import Table
from harness.scores.reliability import BINS, Reliability

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def reliability_table(found: Sequence[Reliability]) -> Table:
    """One row for each configuration that gives probabilities, over all clips."""
    return Table(
        title="Calibration of the probabilities",
        columns=("Configuration", "n", "Right %", "Mean confidence %", "ECE", "Brier"),
        words=1,
        rows=tuple(
            (
                each.configuration,
                str(each.n),
                f"{100 * each.share_right:.1f}",
                f"{100 * each.mean_confidence:.1f}",
                f"{each.calibration_error:.3f}",
                f"{each.brier:.3f}",
            )
            for each in found
        ),
        notes=(
            f"Over the scored frames with a prediction. ECE: expected calibration error, {BINS} equal bins of the "
            "probability of what was predicted. Brier: squared distance of all probabilities from the truth, 0 to 2.",
        ),
    )


def reliability_figure(found: Sequence[Reliability]) -> Figure:
    """The reliability diagram: the share of right frames, and their number, against confidence."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 6), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(3, 1), sharex=True)
    above.plot([0, 1], [0, 1], color="0.6", linestyle="--", label="as sure as right")
    for each in found:
        filled = each.counts > 0
        label = f"{each.configuration} (ECE {each.calibration_error:.3f})"
        above.plot(each.confidence[filled], each.accuracy[filled], marker="o", label=label)
        below.step([k / BINS for k in range(BINS + 1)], [*each.counts, each.counts[-1]], where="post")
    above.set(ylabel="share of right frames", ylim=(0, 1))
    below.set(xlabel="confidence", ylabel="frames", xlim=(0, 1))
    above.legend()
    return figure
