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
_STEPS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledSequence:
    """One person's frames in one clip, in order: times in seconds, features, and what is right.

    ``targets`` are the instance ids of each label's name, any of which is right: (None,) for nowhere, () without a
    label, or if no such target is among those seen: it is not fitted. ``alone`` are the features of the gaze alone and
    of the head alone, None in frames that do not have it: without it, these cases are fitted on frames that have one
    direction only. Sequences of one ``group`` are left out together. ``weight`` is less than 1 if others repeat the
    same looks.
    """

    group: Hashable
    times_s: Sequence[float]
    seen: Sequence[FrameFeatures]
    targets: Sequence[tuple[int | None, ...]]
    weight: float = 1.0
    alone: Mapping[Case, Sequence[FrameFeatures | None]] = field(default_factory=dict)

    @cached_property
    def gaps_s(self) -> list[float]:
        """Time from each frame to the next, seconds; 0 after the last one."""
        return [*(max(after - before, 0.0) for before, after in pairwise(self.times_s)), 0.0]

    @cached_property
    def label_s(self) -> Float:
        """The time (n,) that a label of each frame stands for, seconds.

        It is the time to the next frame; of labels that are sparser, to the next label, but at most the usual one. The
        last label stands for the usual time, and one alone for ``INDEPENDENT_S``.
        """
        seconds = np.array(self.gaps_s[: len(self.times_s)])
        if labelled := [place for place, right in enumerate(self.targets) if right]:
            to_next_s = np.diff([self.times_s[place] for place in labelled])
            usual_s = np.median(to_next_s) if len(to_next_s) else INDEPENDENT_S
            seconds[labelled] = np.maximum(seconds[labelled], np.minimum([*to_next_s, usual_s], usual_s))
        return seconds


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """The frames of sequences for one case: features (N, T, F), NaN beyond a frame's targets.

    ``right`` (N, 1 + T) says whether nowhere, and each target, is right; none is without a label. ``weight`` (N,) is
    how much a frame counts.
    """

    features: Float
    right: Flags
    weight: Float

    @property
    def usable(self) -> Flags:
        """Whether each frame (N,) says something of the weights: it has a label and a target."""
        return np.asarray(self.right.any(axis=1) & np.isfinite(self.features[..., 0]).any(axis=1))


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
    padded = np.full((len(rows), max(map(len, rows), default=0), 2 + len(ROWS[case]) * (3 if later else 2)), np.nan)
    right = np.zeros((len(rows), 1 + padded.shape[1]), dtype=np.bool_)
    for place, (row, (_, seen, targets)) in enumerate(zip(rows, known, strict=True)):
        padded[place, : len(row)] = row
        right[place, : 1 + len(row)] = [number in targets for number in (None, *seen.ids)]
    weight = sequence.weight * np.minimum(of_case.label_s / INDEPENDENT_S, 1.0)
    return Design(features=padded, right=right, weight=weight)


def joined(designs: Sequence[Design]) -> Design:
    """Return the frames of all designs of one case."""
    width = max(design.features.shape[1] for design in designs)
    missing = [((0, 0), (0, width - design.features.shape[1])) for design in designs]
    of_targets = [
        np.pad(design.features, (*pads, (0, 0)), constant_values=np.nan)
        for design, pads in zip(designs, missing, strict=True)
    ]
    return Design(
        features=np.concatenate(of_targets),
        right=np.concatenate([np.pad(design.right, pads) for design, pads in zip(designs, missing, strict=True)]),
        weight=np.concatenate([design.weight for design in designs]),
    )


def maximised(design: Design, precision: Float, middle: Float) -> Float:
    """The weights (F,) of the greatest penalised likelihood, by Newton's method.

    It is concave if each frame has one right answer. Where any of several targets is right, the steps are those of the
    likelihood with these in their present proportions: they are uphill, too (Lange, Hunter and Yang 2000, optimization
    transfer). ``precision`` and ``middle`` (F,) are those of the normal prior.
    """
    usable = design.usable
    x, right, weight = design.features[usable], design.right[usable], design.weight[usable]
    there = np.isfinite(x[..., 0])
    x = np.where(there[..., None], x, 0.0)
    flat = x.reshape(-1, x.shape[-1])

    def value(w: Float) -> tuple[float, Float, Float]:
        utility = np.where(there, x @ w, -np.inf)
        of_right = np.where(right, np.pad(utility, ((0, 0), (1, 0))), -np.inf)
        chance = _log_sum(of_right)
        logs = chance - _log_sum(np.pad(utility, ((0, 0), (1, 0))))
        chosen = np.einsum("nt,ntf->nf", np.exp(of_right[:, 1:] - chance[:, None]), x)
        return float(weight @ logs - precision @ (w - middle) ** 2 / 2), probabilities(utility), chosen

    w = middle.copy()
    now, p, chosen = value(w)
    for _ in range(_STEPS):
        mean = np.einsum("nt,ntf->nf", p, x)
        slope = weight @ (chosen - mean) - precision * (w - middle)
        curve = (flat * (weight[:, None] * p).reshape(-1, 1)).T @ flat - (weight[:, None] * mean).T @ mean
        step = np.linalg.solve(curve + np.diag(precision), slope)
        if slope @ step < 1e-9:
            break
        while (better := value(w + step))[0] < now and np.abs(step).max() > 1e-12:
            step = step / 2
        w, (now, p, chosen) = w + step, better
    return w


def _log_sum(utility: Float) -> Float:
    """log(sum of exp(utility)) of each row."""
    top = utility.max(axis=1)
    return np.asarray(top + np.log(np.exp(utility - top[:, None]).sum(axis=1)))
