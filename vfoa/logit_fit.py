"""The weights of the logit (:mod:`vfoa.logit`) from labelled sequences: penalised maximum likelihood.

The penalty is a normal prior about the weights ``about``, with the standard deviation :data:`SPREAD`: a few labelled
seconds change what they show, and leave the rest. The constant, on which the share of "nowhere" depends, is almost
free, because that share differs most between settings. Frames within :data:`INDEPENDENT_S` count as one: a label lasts.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vfoa.logit import ROWS, Case, Cases, LogitWeights, Seen, Weights, features, later_means, probabilities
from vfoa.types import Float

SPREAD, CONSTANT_SPREAD = 1.0, 5.0
"""Standard deviations of the prior of a weight and of the constant."""
INDEPENDENT_S = 0.5
"""Time after which a frame says something new, seconds: about a short look."""
UNKNOWN = -2
"""The target of a frame without a label, and the column of a target that is not among those seen: neither is fitted."""
_STEPS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledSequence:
    """One person's frames in one clip, in order: times in seconds, features, and the target looked at.

    ``targets`` are instance ids, None for nowhere, :data:`UNKNOWN` without a label.
    Sequences of one ``group`` are left out together.
    """

    group: Hashable
    times_s: Sequence[float]
    seen: Sequence[Seen]
    targets: Sequence[int | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """The frames of sequences for one case: features (N, T, F), NaN beyond a frame's targets.

    ``looked`` (N,) is the column of the target, -1 for nowhere or :data:`UNKNOWN`; ``weight`` (N,) is how much a frame
    counts.
    """

    features: Float
    looked: np.ndarray
    weight: Float


def fit(sequences: Sequence[LabelledSequence], about: LogitWeights) -> LogitWeights:
    """Return the weights that fit these sequences; ``about`` is the middle of the prior.

    The case of one measured direction is fitted on all frames that have it, whether or not they have the other. A
    direction that no frame has keeps the weights of the prior.
    """
    fitted = {}
    for smoothing in ("forward", "both"):
        prior: Cases = getattr(about, smoothing)
        fitted[smoothing] = Cases(
            **{case: _fitted(case, smoothing == "both", sequences, getattr(prior, case)) for case in ROWS}
        )
    return LogitWeights(**fitted)


def _fitted(case: Case, later: bool, sequences: Sequence[LabelledSequence], prior: Weights) -> Weights:
    design = design_of(case, later, sequences)
    middle = prior.vector
    if not (design.looked != UNKNOWN).any():
        return prior
    spread = np.full(len(middle), SPREAD)
    spread[0] = CONSTANT_SPREAD
    return Weights.of(case, maximised(design, middle, spread**-2).tolist())


def design_of(case: Case, later: bool, sequences: Sequence[LabelledSequence]) -> Design:
    """Return the features of all frames that have the directions of a case; with ``later`` also of later frames."""
    rows: list[Float] = []
    looked: list[int] = []
    weight: list[float] = []
    for each in sequences:
        gaps_s = [max(after - before, 0.0) for before, after in pairwise(each.times_s)]
        after = later_means(each.seen, gaps_s) if later else [None] * len(each.seen)
        for seen, mean, target, gap_s in zip(each.seen, after, each.targets, [*gaps_s, 0.0], strict=True):
            if seen.case in (case, "both"):
                rows.append(features(seen, case, mean))
                looked.append(-1 if target is None else seen.ids.index(target) if target in seen.ids else UNKNOWN)
                weight.append(min(gap_s / INDEPENDENT_S, 1.0))
    width = max((len(row) for row in rows), default=0)
    count = 2 + len(ROWS[case]) * (3 if later else 2)
    padded = np.full((len(rows), width, count), np.nan)
    for place, row in zip(padded, rows, strict=True):
        place[: len(row)] = row
    return Design(features=padded, looked=np.array(looked, dtype=np.intp), weight=np.array(weight))


def maximised(design: Design, middle: Float, precision: Float) -> Float:
    """The weights (F,) of the greatest penalised likelihood, by Newton's method; it is concave."""
    usable = design.looked != UNKNOWN
    x, looked, weight = design.features[usable], design.looked[usable], design.weight[usable]
    there = np.isfinite(x[..., 0])
    x = np.where(there[..., None], x, 0.0)
    chosen = np.where((looked >= 0)[:, None], x[np.arange(len(x)), looked], 0.0)

    def value(w: Float) -> tuple[float, Float]:
        utility = np.where(there, x @ w, -np.inf)
        log_sum = np.logaddexp.reduce(np.column_stack([np.zeros(len(x)), utility]), axis=1)
        away = w - middle
        return float(weight @ (chosen @ w - log_sum) - precision @ away**2 / 2), probabilities(utility)

    w = middle
    now, p = value(w)
    for _ in range(_STEPS):
        mean = np.einsum("nt,ntf->nf", p, x)
        slope = weight @ (chosen - mean) - precision * (w - middle)
        curve = np.einsum("n,nt,ntf,ntg->fg", weight, p, x, x, optimize=True) - (weight[:, None] * mean).T @ mean
        step = np.linalg.solve(curve + np.diag(precision), slope)
        if slope @ step < 1e-9:
            break
        while (better := value(w + step))[0] < now and np.abs(step).max() > 1e-12:
            step = step / 2
        w, (now, p) = w + step, better
    return w
