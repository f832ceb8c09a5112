"""One's own rates beside published ones."""

from __future__ import annotations

from harness.report.formats import Table
from harness.score.reproductions import reproductions
from harness.score.score import Scores
from harness.score.statistics import wilson_interval


def published_table(scores: Scores) -> Table:
    """Published rates beside those of this run; no rows if none was published."""
    source = scores.published.source if scores.published else ""
    return Table(
        title="Beside the published figures",
        columns=("Configuration", "Published FRR %", "Wilson", "Here FRR %", "Wilson here", "Points", "p"),
        words=1,
        rows=tuple(
            (
                each.configuration,
                *_rate(each.published.correct, each.published.n),
                *_rate(each.correct, each.n),
                f"{100 * (each.correct / each.n - each.published.correct / each.published.n):+.1f}",
                "<0.001" if each.p < 0.001 else f"{each.p:.2g}",
            )
            for each in reproductions(scores)
        ),
        notes=(
            f"Published: {source}. p: Fisher's exact test that both rates are the same, two-sided; it takes "
            "frames as independent.",
        ),
    )


def _rate(correct: int, n: int) -> tuple[str, str]:
    interval = wilson_interval(correct, n)
    return f"{100 * correct / n:.1f}", f"{100 * interval.low:.0f}–{100 * interval.high:.0f}"
