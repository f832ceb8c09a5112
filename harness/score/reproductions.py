"""Published figures beside those of a run: the rates, and how likely they are to be the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.run.published import PublishedCount
from harness.score.score import Scores


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """One configuration here and there. ``p`` is of Fisher's exact test, two-sided, that both rates are the same."""

    configuration: str
    published: PublishedCount
    correct: int
    n: int
    p: float


def reproductions(scores: Scores) -> list[Reproduction]:
    """The configurations that were scored here and have a published count, in the order of the scores.

    The publication's frames are not known one by one, so the two samples are taken as independent.
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
