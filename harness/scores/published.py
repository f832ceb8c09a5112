"""Figures that somebody published for the configurations of an experiment, to be printed beside one's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from vfoa.settings import Settings

if TYPE_CHECKING:
    from harness.scores.score import Scores


class PublishedCount(Settings):
    """``correct`` of ``n`` frames."""

    correct: NonNegativeInt
    n: PositiveInt

    @model_validator(mode="after")
    def _share(self) -> Self:
        if self.correct > self.n:
            raise ValueError(f"found {self.correct} correct of {self.n}; expected at most {self.n}")
        return self


class Published(Settings):
    """``[published]`` of an experiment: where the figures stand, and what was counted, by configuration."""

    source: str
    counts: dict[str, PublishedCount] = Field(min_length=1)


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
