"""The weights of the logit (:mod:`vfoa.logit`) from labelled sequences: penalised maximum likelihood.

The penalty is a normal prior about the posterior's answer (:func:`vfoa.logit.default_weights`), narrow enough that a
few labelled seconds are safe to fit: a weight that they do not show stays where it was. The constant has a wide one,
because the share of "nowhere" differs most between settings. Frames within :data:`INDEPENDENT_S` count as one: a look
lasts.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np

from vfoa.logit import Cases, LogitWeights, Weights, default_weights, probabilities
from vfoa.logit_cues import ROWS, Case, FrameFeatures, features, later_means
from vfoa.types import Flags, Float

Smoothing = Literal["forward", "both"]
SMOOTHINGS: tuple[Smoothing, ...] = ("forward", "both")

CONSTANT_SPREAD, SIZE_SPREAD = 2.0, 1.0
CUE_SPREADS = (1.0, 1.0, 1.0, 1.0, 0.3, 1.0)
"""Standard deviations of the prior: of the constant, of the weight of the size, and of the weights of each cue.
f of ``head_overlap`` is some three times as large as the others."""
INDEPENDENT_S = 0.5
"""Time after which a frame says something new, seconds: about a short look."""
UNKNOWN = -2
"""The target of a frame without a label, and the column of a target that is not among those seen: neither is fitted."""
_STEPS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledSequence:
    """One person's frames in one clip, in order: times in seconds, features, and the target looked at.

    ``targets`` are instance ids, None for nowhere, :data:`UNKNOWN` without a label. ``alone`` are the features of the
    gaze alone and of the head alone, None in frames that do not have it: without it, these cases are fitted on frames
    that have one direction only. Sequences of one ``group`` are left out together. ``weight`` is less than 1 if others
    repeat the same looks.
    """

    group: Hashable
    times_s: Sequence[float]
    seen: Sequence[FrameFeatures]
    targets: Sequence[int | None]
    weight: float = 1.0
    alone: Mapping[Case, Sequence[FrameFeatures | None]] = field(default_factory=dict)

    @cached_property
    def gaps_s(self) -> list[float]:
        """Time from each frame to the next, seconds; 0 after the last one."""
        return [*(max(after - before, 0.0) for before, after in pairwise(self.times_s)), 0.0]

    @cached_property
    def label_s(self) -> Float:
        """The time (n,) that a label of each frame stands for, seconds.

        It is the time to the next frame; of labels that are sparser, to the next label, but at most the usual one.
        """
        seconds = np.array(self.gaps_s[: len(self.times_s)])
        labelled = [place for place, target in enumerate(self.targets) if target != UNKNOWN]
        if len(labelled) > 1:
            to_next_s = np.diff([*(self.times_s[place] for place in labelled), self.times_s[-1]])
            usual_s = np.minimum(to_next_s, np.median(to_next_s[:-1]))
            seconds[labelled] = np.maximum(seconds[labelled], usual_s)
        return seconds


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """The frames of sequences for one case: features (N, T, F), NaN beyond a frame's targets.

    ``looked`` (N,) is the column of the target, -1 for nowhere or :data:`UNKNOWN`; ``weight`` (N,) is how much a frame
    counts.
    """

    features: Float
    looked: np.ndarray
    weight: Float

    @property
    def usable(self) -> Flags:
        """Whether each frame (N,) says something of the weights: it has a label and a target."""
        return (self.looked != UNKNOWN) & np.isfinite(self.features[..., 0]).any(axis=1)


def fit(
    sequences: Sequence[LabelledSequence],
    smoothings: Collection[Smoothing] = SMOOTHINGS,
    wanted: Collection[Case] = tuple(ROWS),
) -> LogitWeights:
    """Return the weights that fit these sequences.

    A case that no frame has, and cases and smoothings that are not wanted, keep the default weights.
    """
    fitted: dict[str, Cases] = {smoothing: getattr(default_weights(), smoothing) for smoothing in SMOOTHINGS}
    for smoothing in smoothings:
        cases = fitted[smoothing]
        by_case = {case: _fitted(case, smoothing, sequences, getattr(cases, case).vector) for case in wanted}
        fitted[smoothing] = cases.model_copy(update={case: weights for case, weights in by_case.items() if weights})
    return LogitWeights(**fitted)


def _fitted(case: Case, smoothing: Smoothing, sequences: Sequence[LabelledSequence], middle: Float) -> Weights | None:
    design = joined([design_of(case, smoothing == "both", sequence) for sequence in sequences])
    if not design.usable.any():
        return None
    scales = 3 if smoothing == "both" else 2
    spreads = [CONSTANT_SPREAD, SIZE_SPREAD, *np.repeat([CUE_SPREADS[row] for row in ROWS[case]], scales)]
    return Weights.of(case, maximised(design, np.array(spreads) ** -2.0, middle).tolist())


@lru_cache(maxsize=1024)
def design_of(case: Case, later: bool, sequence: LabelledSequence) -> Design:
    """Return the features of the frames that have the directions of a case; with ``later`` also of later frames."""
    frames = zip(sequence.times_s, sequence.alone.get(case, sequence.seen), sequence.targets, strict=True)
    known = [(at_s, seen, target) for at_s, seen, target in frames if seen is not None and seen.case == case]
    of_case = replace(
        sequence,
        times_s=[at_s for at_s, _, _ in known],
        seen=[seen for _, seen, _ in known],
        targets=[target for _, _, target in known],
    )
    after = later_means(of_case.seen, of_case.gaps_s[:-1]) if later and known else [None] * len(known)
    rows = [features(seen, case, mean) for seen, mean in zip(of_case.seen, after, strict=True)]
    looked = [
        -1 if target is None else seen.ids.index(target) if target in seen.ids else UNKNOWN for _, seen, target in known
    ]
    padded = np.full((len(rows), max(map(len, rows), default=0), 2 + len(ROWS[case]) * (3 if later else 2)), np.nan)
    for place, row in zip(padded, rows, strict=True):
        place[: len(row)] = row
    weight = sequence.weight * np.minimum(of_case.label_s / INDEPENDENT_S, 1.0)
    return Design(features=padded, looked=np.array(looked, dtype=np.intp), weight=weight)


def joined(designs: Sequence[Design]) -> Design:
    """Return the frames of all designs of one case."""
    width = max(design.features.shape[1] for design in designs)
    padded = [
        np.pad(design.features, ((0, 0), (0, width - design.features.shape[1]), (0, 0)), constant_values=np.nan)
        for design in designs
    ]
    return Design(
        features=np.concatenate(padded),
        looked=np.concatenate([design.looked for design in designs]),
        weight=np.concatenate([design.weight for design in designs]),
    )


def maximised(design: Design, precision: Float, middle: Float) -> Float:
    """The weights (F,) of the greatest penalised likelihood, by Newton's method; it is concave.

    ``precision`` and ``middle`` (F,) are those of the normal prior.
    """
    usable = design.usable
    x, looked, weight = design.features[usable], design.looked[usable], design.weight[usable]
    there = np.isfinite(x[..., 0])
    x = np.where(there[..., None], x, 0.0)
    chosen = np.where((looked >= 0)[:, None], x[np.arange(len(x)), looked], 0.0)
    flat = x.reshape(-1, x.shape[-1])

    def value(w: Float) -> tuple[float, Float]:
        utility = np.where(there, x @ w, -np.inf)
        p = probabilities(utility)
        logs = (chosen @ w) - _log_sum(utility)
        return float(weight @ logs - precision @ (w - middle) ** 2 / 2), p

    w = middle.copy()
    now, p = value(w)
    for _ in range(_STEPS):
        mean = np.einsum("nt,ntf->nf", p, x)
        slope = weight @ (chosen - mean) - precision * (w - middle)
        curve = (flat * (weight[:, None] * p).reshape(-1, 1)).T @ flat - (weight[:, None] * mean).T @ mean
        step = np.linalg.solve(curve + np.diag(precision), slope)
        if slope @ step < 1e-9:
            break
        while (better := value(w + step))[0] < now and np.abs(step).max() > 1e-12:
            step = step / 2
        w, (now, p) = w + step, better
    return w


def _log_sum(utility: Float) -> Float:
    """log(1 + sum of exp(utility)) of each row."""
    top = np.maximum(utility.max(axis=1, initial=0.0), 0.0)
    return np.asarray(top + np.log(np.exp(-top) + np.exp(utility - top[:, None]).sum(axis=1)))
