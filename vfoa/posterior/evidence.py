"""The evidence of one cue about the targets in one frame, and the state of the looks that its filter needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from vfoa.posterior.assumptions import TAILS
from vfoa.posterior.looks import Columns
from vfoa.types import Float

_AVERAGES = {"gaze": ("gk,gkt->gt", 1), "head": ("gk,gkt->kt", 0)}
"""The average over the other cue's hypotheses, and their axis."""


@dataclass(frozen=True, slots=True)
class Flow:
    """The flow of probability from the previous targets to those of the frame, for every pair of hypotheses.

    ``weights`` (G, K) are those of the pairs, ``looked`` (G, K, T') the probabilities of the previous targets, and
    ``columns`` (T,) gives each target's index among the previous ones. ``predicted`` (G, K, T) are the probabilities
    before the frame is seen; ``stayed`` is the part of them that comes from looks that go on.
    """

    weights: Float
    looked: Float
    columns: Columns
    predicted: Float
    stayed: Float

    def of(self, cue: Literal["gaze", "head"]) -> tuple[Float, Float]:
        """The previous targets (H, T') and the part (H, T) that stays, for each hypothesis of one cue."""
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
        """The evidence of a cue that was not measured."""
        return cls(np.zeros((hypotheses, targets)), np.ones((hypotheses, targets)))

    @classmethod
    def of(cls, likelihood: Float, excess: Float) -> Evidence:
        """The evidence from a log likelihood (H, T) and the logarithm (H, T) of 1 + square / TAILS (Student)."""
        return cls(likelihood, np.exp(-TAILS / 2 * excess))
