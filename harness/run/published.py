"""Published figures for the configurations of an experiment, printed beside the run's own."""

from __future__ import annotations

from typing import Self

from pydantic import Field, NonNegativeInt, PositiveInt, model_validator

from vfoa.settings import Settings


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
    """``[published]`` of an experiment: the source of the figures, and the counts by configuration."""

    source: str
    counts: dict[str, PublishedCount] = Field(min_length=1)
