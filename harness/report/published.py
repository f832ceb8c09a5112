"""Published rates beside those of a run, and how likely they are to be the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.report.formats import Table
from harness.run.published import PublishedCount
from harness.score.score import Scores
from harness.score.statistics import wilson_interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """One configuration's rates here and as published; ``p`` is of Fisher's exact two-sided test of equality."""

    configuration: str
    published: PublishedCount
    correct: int
    n: int
    p: float


def reproductions(scores: Scores) -> list[Reproduction]:
    """The configurations that were scored here and have a published count, in the order of the scores.

    The publication's frames are not known one by one, so the two samples are treated as independent.
    """
    if scores.published is None:
        return []
    from scipy.stats import fisher_exact

    pooled = [row for row in scores.by_clip() if row.clip is None] or scores.by_clip()
    found = []
    for row in pooled:
        if count := scores.published.counts.get(row.configuration):
            table = np.array([[row.correct, row.n - row.correct], [count.correct, count.n - count.correct]])
            found.append(
                Reproduction(
                    configuration=row.configuration,
                    published=count,
                    correct=row.correct,
                    n=row.n,
                    p=float(fisher_exact(table).pvalue),
                )
            )
    return found


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
