"""The belief about a person's target and its inputs: the targets that are seen, and the measured directions.

A hypothesis is a pair: a gaze hypothesis (scale of the error, bias, gain) and a head hypothesis (share). Each pair has
its own probability of every target and its own counts of looks. The filters of the gaze are kept per gaze hypothesis
and those of the head per head hypothesis, averaged over the other: filters per pair would multiply the cost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vfoa.geometry import MEAN_ANGLE_PER_SIGMA, unit
from vfoa.posterior.grid import Error, GazeHypotheses, HeadHypotheses, gaze_hypotheses, head_hypotheses
from vfoa.posterior.kalman import CONSTANT, GazeError, Normal
from vfoa.posterior.looks import Keys, LookCounts, no_looks
from vfoa.types import DirectionFit, Float

_UNLIKELY = math.log(1e-6)
"""Hypotheses whose log weight is this far below that of the likeliest are dropped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenery:
    """The targets of a person, as ``keys`` (T,), the last of which is None for nowhere.

    Directions (T - 1, 3) of the targets, and the variances (T - 1,) of the looks at each per tangent direction, rad^2;
    the direction (3,) to the camera.
    """

    keys: Keys
    directions: Float
    variances: Float
    to_camera: Float

    @property
    def middle(self) -> Float:
        """Middle (3,) of the targets' directions; the direction to the camera if they have no middle."""
        if len(self.directions):
            mean = self.directions.mean(axis=0)
            if np.linalg.norm(mean) > 1e-9:
                return unit(mean)
        return self.to_camera


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredCues:
    """The measured directions (3,), None where not measured, and the claimed errors: standard deviations, rad."""

    gaze: Float | None
    head: Float | None
    gaze_sigma_rad: float
    head_sigma_rad: float


@dataclass(frozen=True, kw_only=True)
class Belief:
    """The belief about a person: T targets of ``keys``, K head hypotheses, and G gaze hypotheses, the most of all.

    ``log_weights`` (K, G) are defined up to a constant; ``looked`` (T, K, G) sums to 1 over the targets. ``leave`` (K,
    G) and ``new`` (T, K, G) are the transition that led to this frame. ``tail`` is the probability, before the frame,
    of directions that fit worse than the measured ones. ``last_head`` (3,) was measured ``headless_s`` seconds ago.
    ``facing`` (3,) is where the body faces, None before the first head or gaze. ``counts`` says that later frames start
    from this belief, otherwise from the last one that counts; ``spare_s`` are the seconds that make the next one count
    earlier (:data:`vfoa.posterior.filter.COUNTED_S`).
    """

    keys: Keys
    gaze: GazeHypotheses
    head: HeadHypotheses
    log_weights: Float
    looked: Float
    looks: LookCounts
    leave: Float
    new: Float
    error: GazeError | None = None
    motion: Normal | None = None
    last_head: Float | None = None
    headless_s: float = 0.0
    facing: Float | None = None
    tail: float = 1.0
    counts: bool = True
    spare_s: float = 0.0

    @cached_property
    def weights(self) -> Float:
        """Probabilities (K, G) of the hypotheses."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        return np.asarray(weights / weights.sum())

    @cached_property
    def gaze_weights(self) -> Float:
        """Probabilities (G,) of the gaze hypotheses."""
        return np.asarray(self.weights.sum(axis=0))

    @cached_property
    def head_weights(self) -> Float:
        """Probabilities (K,) of the head hypotheses."""
        return np.asarray(self.weights.sum(axis=1))

    @cached_property
    def probabilities(self) -> Float:
        """Probabilities (T,) of the targets, summed over the hypotheses."""
        return np.asarray(self.looked.reshape(len(self.keys), -1) @ self.weights.ravel())

    @cached_property
    def implied_share(self) -> float:
        """Mean share of the way to the targets that the head turns, over the hypotheses."""
        return float(self.head_weights @ self.head.share)


def first_belief(keys: Keys) -> Belief:
    """The belief before anything is measured: one hypothesis of each kind, until a cue can tell several apart."""
    return Belief(
        keys=keys,
        gaze=gaze_hypotheses("told"),
        head=head_hypotheses("told"),
        log_weights=np.zeros((1, 1)),
        looked=np.full((len(keys), 1, 1), 1 / len(keys)),
        looks=no_looks(),
        leave=np.ones((1, 1)),
        new=np.ones((len(keys), 1, 1)),
    )


def with_cues(belief: Belief, cues: MeasuredCues, error: Error) -> Belief:
    """Add the hypotheses of a cue that is measured for the first time."""
    if belief.error is None and cues.gaze is not None:
        gaze = gaze_hypotheses(error)
        belief = replace(_of_pairs(belief, lambda array: array.repeat(len(gaze.scale), axis=-1)), gaze=gaze)
        belief = replace(belief, log_weights=belief.log_weights + gaze.log_prior)
    if belief.motion is None and cues.head is not None:
        head = head_hypotheses(error)
        belief = replace(_of_pairs(belief, lambda array: array.repeat(len(head.share), axis=-2)), head=head)
        belief = replace(belief, log_weights=belief.log_weights + head.log_prior[:, None])
    return belief


def _of_pairs(belief: Belief, chosen: Callable[[Float], Float]) -> Belief:
    """Return the belief with other pairs of hypotheses: ``chosen`` takes them from an array (..., K, G)."""
    looks = belief.looks
    return replace(
        belief,
        log_weights=chosen(belief.log_weights),
        looked=chosen(belief.looked),
        leave=chosen(belief.leave),
        new=chosen(belief.new),
        looks=replace(looks, begun=chosen(looks.begun), nowhere=chosen(looks.nowhere)),
    )


def pruned(belief: Belief) -> Belief:
    """Drop the gaze hypotheses that have become very unlikely, if there are enough of them to save time."""
    top = belief.log_weights.max(axis=0)
    rows = top > top.max() + _UNLIKELY
    if np.count_nonzero(rows) > 0.8 * len(rows):
        return belief
    return replace(
        _of_pairs(replace(belief, log_weights=belief.log_weights - top.max()), lambda array: array[..., rows]),
        gaze=belief.gaze.kept(rows),
        error=belief.error.kept(rows) if belief.error else None,
    )


def fit_of(belief: Belief, cues: MeasuredCues) -> DirectionFit:
    """Return how well the measured directions fit the belief: the error that they imply, beside the claimed one.

    Angles are those of the gaze; None if no gaze was measured. The implied error is the mean over the hypotheses of the
    root of the squares of noise and bias, as a mean angle.
    """
    share = None if belief.motion is None else belief.implied_share
    if cues.gaze is None or belief.error is None:
        return DirectionFit(tail=belief.tail, implied_share=share)
    noise = (belief.gaze.scale * cues.gaze_sigma_rad) ** 2
    constant = belief.gaze.bias_rad + (belief.looked.mean(axis=1) * belief.error.state.means[CONSTANT]).sum(axis=1)
    mean_square = noise + (constant**2).sum(axis=0) / 2
    implied = float(belief.gaze_weights @ np.sqrt(mean_square))
    return DirectionFit(
        tail=belief.tail,
        claimed_error_rad=MEAN_ANGLE_PER_SIGMA * cues.gaze_sigma_rad,
        implied_error_rad=MEAN_ANGLE_PER_SIGMA * implied,
        implied_share=share,
    )
