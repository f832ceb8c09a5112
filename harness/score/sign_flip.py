"""The paired permutation test of two configurations: exact, by flipping signs of units (Fisher 1935)."""

from __future__ import annotations

import math

import numpy as np

from harness.score.statistics import Codes
from vfoa.types import Float

SIGNIFICANCE = 0.05


def sign_flip_p(differences: Codes | Float) -> float:
    """Two-sided p of sums of differences (U,) in whole frames, if each unit's sign is as likely as its opposite.

    Were the two configurations equal, each unit's difference could as well have had the other sign. p is the share of
    all 2^U assignments whose total is at least as far from 0 as the one found. The total is a whole number, so its
    whole distribution is computed, one unit after another: p is exact for any number of units.
    """
    sizes = np.abs(np.rint(differences[differences != 0])).astype(np.int64)
    if not len(sizes):
        return 1.0
    step = math.gcd(*sizes.tolist())
    found = abs(int(differences.sum())) // step
    chance = np.ones(1)  # of the totals -k, -k + 2, ..., k, where k is the sum of the sizes so far
    for size in (sizes // step).tolist():
        wider = np.zeros(len(chance) + size)
        wider[: len(chance)] += chance / 2
        wider[size:] += chance / 2
        chance = wider
    # place i is the total 2 i - k: those from `found` up, and by symmetry as many from -found down
    upper = float(chance[(found + len(chance) - 1) // 2 :].sum())
    return 1.0 if found == 0 else min(1.0, 2 * upper)
