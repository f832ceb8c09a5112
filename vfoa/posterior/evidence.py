"""What a cue says of the targets in one frame, and what its filter needs to know of the looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from vfoa.types import Float

_AVERAGES = {"gaze": ("gk,gkt->gt", 1), "head": ("gk,gkt->kt", 0)}
"""The average over the other cue's hypotheses, and their axis."""


@dataclass(frozen=True, slots=True)
class Flow:
    """How probability goes from the targets before to those of the frame, of every pair of hypotheses.

    ``weights`` (G, K) of the pairs, ``looked`` (G, K, T') of the targets before and ``columns`` (T,) which of them each
    target was; ``predicted`` (G, K, T) before the frame, and the part ``stayed`` of it that goes on.
    """

    weights: Float
    looked: Float
    columns: np.ndarray
    predicted: Float
    stayed: Float

    def of(self, cue: Literal["gaze", "head"]) -> tuple[Float, Float]:
        """The targets before (H, T') and the part (H, T) that stays, for each hypothesis of one cue."""
        mean, other = _AVERAGES[cue]
        part = self.weights / np.maximum(self.weights.sum(axis=other, keepdims=True), 1e-300)
        stay = np.einsum(mean, part, self.stayed) / np.maximum(np.einsum(mean, part, self.predicted), 1e-300)
        return np.einsum(mean, part, self.looked), stay


@dataclass(frozen=True, slots=True)
class Evidence:
    """Log likelihood (H, T), and the probability (H, T) of a worse fit; zeros and ones where nothing was measured."""

    likelihood: Float
    tail: Float

    @classmethod
    def none(cls, hypotheses: int, targets: int) -> Evidence:
        """Of a cue that was not measured."""
        return cls(np.zeros((hypotheses, targets)), np.ones((hypotheses, targets)))

    @classmethod
    def of(cls, likelihood: Float, square: Float, tails: float) -> Evidence:
        """Of a log likelihood (H, T) and a squared surprise (H, T) in standard deviations, with Student's tails."""
        return cls(likelihood, (1 + square / tails) ** (-tails / 2))
