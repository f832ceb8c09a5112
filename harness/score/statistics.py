"""Shares, corrections and agreement measures for right-or-wrong sequences.

They are short closed forms, written out: importing scipy.stats, statsmodels or scikit-learn takes as long as scoring a
run. The tests compare each of them with those libraries.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.intp]
Counts = NDArray[np.intp]
Flags = NDArray[np.bool_]

LEVEL = 0.95
SIGNIFICANCE = 0.05
REPLICATES = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A 95 % confidence interval of a share or of a difference of shares; NaN if it is not known.

    ``unit`` is the independent unit: ``"clip"`` is valid for clips like these, ``"look"`` for these clips only, and
    ``"frame"`` would be valid if frames were independent.
    """

    low: float
    high: float
    unit: Literal["clip", "look", "frame"] = "frame"


UNKNOWN = Interval(low=math.nan, high=math.nan)


def wilson_interval(correct: int, n: int) -> Interval:
    """Wilson's score interval (Wilson 1927) of a share of independent trials, which frames are not."""
    if n == 0:
        return UNKNOWN
    z = NormalDist().inv_cdf((1 + LEVEL) / 2)
    share = correct / n
    center = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return Interval(low=max(center - half, 0.0), high=min(center + half, 1.0))


def holm(p_values: Sequence[float]) -> list[float]:
    """Correct p values for their number by Holm's step-down method (Holm 1979), in the order given."""
    corrected = [0.0] * len(p_values)
    highest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        highest = max(highest, min(1.0, (len(p_values) - rank) * p_values[index]))
        corrected[index] = highest
    return corrected


def confusion_matrix(truth: Codes, predicted: Codes, categories: int) -> Counts:
    """Counts (categories, categories): rows truth, columns prediction, both coded 0 to categories - 1."""
    return np.bincount(truth * categories + predicted, minlength=categories**2).reshape(categories, categories)


def cohen_kappa(confusion: Counts) -> float:
    """Cohen's kappa (Cohen 1960), agreement beyond chance; NaN if chance alone would always agree."""
    n = confusion.sum()
    if n == 0:
        return math.nan
    observed = np.trace(confusion) / n
    expected = float(confusion.sum(axis=0) @ confusion.sum(axis=1)) / float(n) ** 2
    return math.nan if expected == 1.0 else float((observed - expected) / (1 - expected))


def macro_f1(confusion: Counts) -> float:
    """Mean F1 over the categories that occur in the truth (rows); NaN without ground truth."""
    true, found = confusion.sum(axis=1), confusion.sum(axis=0)
    occurs = true > 0
    if not occurs.any():
        return math.nan
    return float((2 * np.diagonal(confusion)[occurs] / (true + found)[occurs]).mean())
