"""Intervals, tests and agreement measures for right-or-wrong sequences.

They are short closed forms, written out: importing scipy.stats, statsmodels or scikit-learn takes as long as scoring a
run. The tests hold each of them to those libraries' own functions.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from vfoa.types import Float

Codes = NDArray[np.intp]
Counts = NDArray[np.intp]
Flags = NDArray[np.bool_]

LEVEL = 0.95
REPLICATES = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A 95 % confidence interval of a share, both ends in [0, 1]; NaN where there was nothing to measure."""

    low: float
    high: float


UNKNOWN = Interval(low=math.nan, high=math.nan)


def wilson_interval(correct: int, n: int) -> Interval:
    """Wilson's score interval of a share of independent trials (Wilson 1927)."""
    if n == 0:
        return UNKNOWN
    z = NormalDist().inv_cdf((1 + LEVEL) / 2)
    share = correct / n
    center = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return Interval(low=max(center - half, 0.0), high=min(center + half, 1.0))


def bootstrap_interval(resampled: Sequence[Float], n: int) -> Interval:
    """Percentile interval of a share pooled over ``n`` frames of sequences that were resampled each by itself.

    ``resampled`` are the sequences' :func:`resampled_sums`. The interval has no width where all frames agree; read
    Wilson's there.
    """
    if n == 0:
        return UNKNOWN
    low, high = np.quantile(np.sum(resampled, axis=0) / n, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return Interval(low=float(low), high=float(high))


def resampled_sums(correct: Flags, block: int, key: str) -> Float:
    """Correct frames (replicates,) in resampled sequences, by the moving-block bootstrap (Künsch 1989).

    Overlapping blocks of ``block`` frames are drawn with replacement until a sequence has its length again (the last
    one is cut). Neighbouring frames stay together, so that the spread is as wide as their dependence makes it.
    ``key`` seeds the drawing: the same key, length and block draw the same blocks, so that configurations are
    resampled alike, and nothing depends on what else is scored.
    """
    n = len(correct)
    if n == 0:
        return np.zeros(REPLICATES)
    block = min(block, n)
    starts = _block_starts(key, n, block)
    sums = np.concatenate(([0], np.cumsum(correct)))
    last = n - (starts.shape[1] - 1) * block
    in_block = sums[block:] - sums[:-block]
    cut = starts[:, -1]
    return in_block[starts[:, :-1]].sum(axis=1) + (sums[cut + last] - sums[cut]).astype(np.float64)


@lru_cache(maxsize=64)
def _block_starts(key: str, n: int, block: int) -> Codes:
    """Where the blocks begin: (replicates, blocks). Kept, because every configuration of a clip asks for the same."""
    rng = np.random.default_rng(list(hashlib.sha256(key.encode()).digest()))
    return rng.integers(0, n - block + 1, size=(REPLICATES, -(-n // block)))


def block_length(n: int, frames_per_second: float | None) -> int:
    """Frames in a bootstrap block: a second's worth, the time scale of a fixation; the cube root of n without a rate.

    At most a fifth of the sequence, so that there are blocks to draw from, and at least one frame.
    """
    wanted = round(frames_per_second) if frames_per_second else math.ceil(n ** (1 / 3))
    return max(1, min(wanted, n // 5))


def mcnemar_exact(better: int, worse: int) -> float:
    """Two-sided exact McNemar test (McNemar 1947): p of pairs that changed this unevenly if both ways are as likely."""
    changed = better + worse
    ways = term = 1
    for k in range(min(better, worse)):
        term = term * (changed - k) // (k + 1)  # the binomial coefficient of k + 1, in exact integers
        ways += term
    return min(1.0, 2 * ways / 2**changed)


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
    """Cohen's kappa (Cohen 1960), agreement beyond chance; NaN where chance alone would always agree."""
    n = confusion.sum()
    if n == 0:
        return math.nan
    observed = np.trace(confusion) / n
    expected = float(confusion.sum(axis=0) @ confusion.sum(axis=1)) / float(n) ** 2
    return math.nan if expected == 1.0 else float((observed - expected) / (1 - expected))


def macro_f1(confusion: Counts) -> float:
    """Mean F1 over the categories that occur in the truth (rows); NaN where there is no truth."""
    true, found = confusion.sum(axis=1), confusion.sum(axis=0)
    occurs = true > 0
    if not occurs.any():
        return math.nan
    return float((2 * np.diagonal(confusion)[occurs] / (true + found)[occurs]).mean())
