"""Whether measured directions fit what the posterior believes of them: posterior-predictive checks (Rubin 1984).

Before each frame the posterior says how probable directions are that fit worse than those that come. Where the model is
right, these tail probabilities are spread evenly; where many are small, the directions do not fit it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from harness.run.records import DirectionFitRecord, FrameRecord

SMALL_TAIL = 0.05
"""A tail probability below this is a surprise; that share of the frames has one where the model is right."""

MOST_SURPRISES = 0.15
"""The share of surprising frames above which directions do not fit."""

MOST_TIMES_CLAIMED = 1.5
"""How many times its claimed error a model may be wrong, or the other way round, without a word."""

FEWEST_FRAMES = 20
"""Fewer frames say nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionCheck:
    """One configuration on one clip: the share of surprising frames, and the median errors in degrees, of ``n`` frames.

    ``claimed_deg`` is the mean gaze error that its source claims, ``implied_deg`` what the directions imply; None
    without gaze.
    """

    clip: str
    configuration: str
    n: int
    surprises: float
    claimed_deg: float | None
    implied_deg: float | None

    @property
    def fits(self) -> bool:
        """Whether there is nothing to say."""
        if self.n < FEWEST_FRAMES:
            return True
        times = self.implied_deg / self.claimed_deg if self.implied_deg and self.claimed_deg else 1.0
        return self.surprises <= MOST_SURPRISES and 1 / MOST_TIMES_CLAIMED <= times <= MOST_TIMES_CLAIMED

    def sentence(self) -> str:
        """Notes for the reader of the probabilities."""
        parts = [f"{100 * self.surprises:.0f} % of {self.n} frames surprise it (expected {100 * SMALL_TAIL:.0f} %)"]
        if self.claimed_deg is not None and self.implied_deg is not None:
            claimed, implied = (f"{angle:.0f} deg" for angle in (self.claimed_deg, self.implied_deg))
            parts.append(f"the gaze claims an error of {claimed}, the directions imply {implied}")
        return f"{self.clip}, {self.configuration}: directions do not fit the posterior: {'; '.join(parts)}."


@dataclass(slots=True)
class DirectionLog:
    """Keeps the fit of every subject in every frame while records pass by."""

    _found: dict[tuple[str, str], list[DirectionFitRecord]] = field(default_factory=dict)

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Hand the records on."""
        for record in records:
            fits = [each.fit for each in record.subjects if each.fit is not None and each.name is not None]
            if fits:
                self._found.setdefault((record.clip, record.configuration), []).extend(fits)
            yield record

    def part(self, clip: str, configuration: str) -> list[DirectionFitRecord]:
        """What was found so far of a configuration on a clip, for another log."""
        return self._found.get((clip, configuration), [])

    def add(self, clip: str, configuration: str, found: list[DirectionFitRecord]) -> None:
        """Take over a part of another log."""
        if found:
            self._found.setdefault((clip, configuration), []).extend(found)

    def checks(self) -> list[DirectionCheck]:
        """One for each clip and configuration with a posterior, over the named subjects."""
        return [
            DirectionCheck(
                clip=clip,
                configuration=configuration,
                n=len(fits),
                surprises=float(np.mean([each.tail < SMALL_TAIL for each in fits])),
                claimed_deg=_median_deg([each.claimed_error_rad for each in fits]),
                implied_deg=_median_deg([each.implied_error_rad for each in fits]),
            )
            for (clip, configuration), fits in self._found.items()
        ]


def _median_deg(angles_rad: list[float | None]) -> float | None:
    known = [angle for angle in angles_rad if angle is not None]
    return float(np.degrees(np.median(known))) if known else None
