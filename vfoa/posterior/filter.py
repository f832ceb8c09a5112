"""One frame of the posterior: what every hypothesis predicts, and Bayes' rule over targets and hypotheses.

A hypothesis is a pair of a gaze hypothesis (scale of the error, bias, gain) and a head hypothesis (share). Each has an
own probability of every target and own counts of looks. The filters of gaze and head are kept for the gaze hypothesis
and for the head hypothesis alone, averaged over the other: the pairs would cost as many times more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vfoa.geometry import angle_between, tangent_offset, unit
from vfoa.posterior.gaze_error import GazeError, first_error, next_error, weigh_gaze
from vfoa.posterior.grid import GazeHypotheses, HeadHypotheses, gaze_hypotheses, head_hypotheses
from vfoa.posterior.head_motion import HeadMotion, first_motion, next_motion, weigh_head
from vfoa.posterior.looks import Keys, Looks, columns_of, counted, leaving, new_look, no_looks, predicted_looks
from vfoa.posterior.settings import PosteriorSettings, sigma_rad
from vfoa.types import Float

_UNLIKELY = 1e-6
"""Hypotheses this much less likely than the likeliest are given up."""
_HEAD_BIAS_DEG = 5.0
"""Mean angle of the constant error of head poses."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenery:
    """The targets of a person, as ``keys`` (T,), of which the last is None for nowhere.

    Directions (T - 1, 3) of the targets and the variances (T - 1,) of the looks at each per tangent direction, rad^2;
    the direction (3,) to the camera.
    """

    keys: Keys
    directions: Float
    variances: Float
    to_camera: Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The measured directions (3,), None where there is none, and the claimed errors: standard deviations, rad."""

    gaze: Float | None
    head: Float | None
    gaze_sigma_rad: float
    head_sigma_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """The belief about a person. G gaze hypotheses, K head hypotheses, T targets of ``keys``.

    ``log_weights`` (G, K) up to a constant; ``looked`` (G, K, T) sums to 1 over the targets. ``leave`` (G, K) and
    ``new`` (G, K, T) are the transition that led to this frame. ``tail`` is the probability, before the frame, of
    directions that fit worse than those that were measured.
    """

    keys: Keys
    gaze: GazeHypotheses
    head: HeadHypotheses
    log_weights: Float
    looked: Float
    looks: Looks
    leave: Float
    new: Float
    error: GazeError | None = None
    motion: HeadMotion | None = None
    last_head: Float | None = None
    tail: float = 1.0

    @property
    def weights(self) -> Float:
        """Probabilities (G, K) of the hypotheses."""
        weights = np.exp(self.log_weights - self.log_weights.max())
        return np.asarray(weights / weights.sum())

    @property
    def probabilities(self) -> Float:
        """Probabilities (T,) of the targets, whatever the hypothesis."""
        return np.einsum("gk,gkt->t", self.weights, self.looked)


def update(
    before: Belief | None, scenery: Scenery, measured: Measured, dt_s: float, settings: PosteriorSettings
) -> Belief:
    """The belief after a frame that comes ``dt_s`` after the one before."""
    prior = _with_cues(before or _start(scenery.keys, settings), measured, settings)
    columns, known = columns_of(prior.keys, scenery.keys)
    new = new_look(prior.looks, len(scenery.keys) - 1, settings)
    if before is None:
        leave, predicted, stayed = np.ones(new.shape[:2]), new, np.zeros_like(new)
    else:
        leave = leaving(prior.looks, dt_s, settings)
        predicted, stayed = predicted_looks(prior.looked, columns, known, leave, new)

    weights = prior.weights
    flow = _Flow(prior.looked, columns, predicted, stayed)
    # of the first frame all counts: there is nothing yet that its error could last from
    power, head_power = (1.0, 1.0) if before is None else (settings.evidence, settings.head_evidence)
    error, gaze_evidence = _gaze_step(prior, scenery, measured, flow, weights, dt_s, settings)
    motion, head_evidence = _head_step(prior, scenery, measured, flow, weights, dt_s, settings)

    gaze_part, gaze_top = _scaled(gaze_evidence.likelihood)
    head_part, head_top = _scaled(head_power * head_evidence.likelihood)
    joint = predicted * gaze_part[:, None] * head_part[None]
    total = joint.sum(axis=-1)
    looked = joint / total[..., None]
    begun = looked * (1 - stayed / predicted)
    belief = replace(
        prior,
        keys=scenery.keys,
        log_weights=prior.log_weights + power * (np.log(total) + gaze_top + head_top.T),
        looked=looked,
        leave=leave,
        new=new,
        looks=counted(prior.looks, begun, 0.0 if before is None else dt_s),
        error=error,
        motion=motion,
        last_head=prior.last_head if measured.head is None else measured.head,
        tail=_tail(predicted, weights, gaze_evidence.tail, head_evidence.tail),
    )
    return _pruned(belief)


def answered(belief: Belief, probabilities: Float, settings: PosteriorSettings) -> Float:
    """The answer (T,) where the model has these probabilities (T,): flatter with a gaze of unknown error.

    Heads alone need no such correction: their likelihood is flattened already (``head_evidence``).
    """
    if settings.error == "told" or belief.error is None:
        return probabilities
    flat = probabilities ** (1 / settings.temperature)
    return np.asarray(flat / flat.sum())


@dataclass(frozen=True, slots=True)
class _Flow:
    """How probability goes from the targets before to those of the frame, of every pair of hypotheses."""

    looked: Float
    columns: np.ndarray
    predicted: Float
    stayed: Float

    def of_gaze(self, weights: Float) -> tuple[Float, Float]:
        """The targets before (G, T') and the part (G, T) that stays, averaged over the head hypotheses."""
        part = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1e-300)
        mean = "gk,gkt->gt"
        stay = np.einsum(mean, part, self.stayed) / np.maximum(np.einsum(mean, part, self.predicted), 1e-300)
        return np.einsum(mean, part, self.looked), stay

    def of_head(self, weights: Float) -> tuple[Float, Float]:
        """The same (K, T') and (K, T), averaged over the gaze hypotheses."""
        part = weights / np.maximum(weights.sum(axis=0), 1e-300)
        mean = "gk,gkt->kt"
        stay = np.einsum(mean, part, self.stayed) / np.maximum(np.einsum(mean, part, self.predicted), 1e-300)
        return np.einsum(mean, part, self.looked), stay


@dataclass(frozen=True, slots=True)
class _Evidence:
    """Log likelihood (H, T), and the probability (H, T) of a worse fit; zeros and ones where nothing was measured."""

    likelihood: Float
    tail: Float


def _gaze_step(
    prior: Belief,
    scenery: Scenery,
    measured: Measured,
    flow: _Flow,
    weights: Float,
    dt_s: float,
    settings: PosteriorSettings,
) -> tuple[GazeError | None, _Evidence]:
    hypotheses, count = prior.gaze, len(scenery.keys)
    nothing = _Evidence(np.zeros((len(hypotheses.scale), count)), np.ones((len(hypotheses.scale), count)))
    if prior.error is None and measured.gaze is None:
        return None, nothing
    variance = ((hypotheses.scale * measured.gaze_sigma_rad) ** 2)[:, None]
    slow = settings.bias_share * variance
    head = prior.last_head if measured.head is None else measured.head
    around = sigma_rad(settings.nowhere_deg if head is None else settings.about_head_deg)
    drift = slow + np.append(scenery.variances, around**2)
    if prior.error is None:
        predicted = first_error(hypotheses.cell_rad**2, drift)
    else:
        looked, stay = flow.of_gaze(weights)
        keep = float(np.exp(-dt_s / settings.bias_s))
        predicted = next_error(prior.error, looked, flow.columns, stay, slow, drift, keep)
    if measured.gaze is None:
        return predicted, nothing
    aims = np.stack([_aims(scenery, gain, head) for gain in hypotheses.gains])
    offset = tangent_offset(aims, measured.gaze)[hypotheses.gain].transpose(2, 0, 1) - hypotheses.bias_rad[..., None]
    error, likelihood, square = weigh_gaze(predicted, offset, variance - slow, settings.tails)
    return error, _Evidence(likelihood, (1 + square / settings.tails) ** (-settings.tails / 2))


def _head_step(
    prior: Belief,
    scenery: Scenery,
    measured: Measured,
    flow: _Flow,
    weights: Float,
    dt_s: float,
    settings: PosteriorSettings,
) -> tuple[HeadMotion | None, _Evidence]:
    share, count = prior.head.share, len(scenery.keys)
    nothing = _Evidence(np.zeros((len(share), count)), np.ones((len(share), count)))
    if prior.motion is None and measured.head is None:
        return None, nothing
    noise = (1 - settings.bias_share) * measured.head_sigma_rad**2
    on_target = sigma_rad(settings.aside_deg) ** 2 + share[:, None] ** 2 * scenery.variances
    nowhere = np.full((len(share), 1), sigma_rad(settings.nowhere_deg) ** 2)
    aside = np.concatenate([on_target, nowhere], axis=1)
    middle = middle_of(scenery)
    goals = np.stack([np.vstack([_between(middle, scenery.directions, each), middle]) for each in share])
    if prior.motion is None or prior.last_head is None:
        rest = ((1 - share[:, None]) * sigma_rad(settings.rest_deg)) ** 2 + sigma_rad(_HEAD_BIAS_DEG) ** 2
        predicted = first_motion(rest, aside)
    else:
        looked, stay = flow.of_head(weights)
        last = tangent_offset(goals, prior.last_head)
        predicted = next_motion(prior.motion, looked, flow.columns, stay, last, noise, aside, dt_s, settings.head_lag_s)
    if measured.head is None:
        return predicted, nothing
    motion, likelihood, square = weigh_head(predicted, tangent_offset(goals, measured.head), noise, settings.tails)
    return motion, _Evidence(likelihood, (1 + square / settings.tails) ** (-settings.tails / 2))


def middle_of(scenery: Scenery) -> Float:
    """The middle (3,) of the targets' directions; the way to the camera where they have none."""
    if len(scenery.directions):
        mean = scenery.directions.mean(axis=0)
        if np.linalg.norm(mean) > 1e-9:
            return unit(mean)
    return scenery.to_camera


def _aims(scenery: Scenery, gain: float, head: Float | None) -> Float:
    """Where a gaze at each target (T, 3) is measured with this gain. A gaze at nothing is about the measured head."""
    nowhere = _between(scenery.to_camera, middle_of(scenery), gain) if head is None else head
    return np.vstack([_between(scenery.to_camera, scenery.directions, gain), nowhere])


def _between(start: Float, ends: Float, share: float) -> Float:
    """Unit vectors (..., 3) at a share of the great circles from one direction to others."""
    angle = np.maximum(angle_between(start, ends), 1e-6)[..., None]
    return unit((np.sin((1 - share) * angle) * start + np.sin(share * angle) * ends) / np.maximum(np.sin(angle), 1e-9))


def _start(keys: Keys, settings: PosteriorSettings) -> Belief:
    """The belief before anything was measured: one hypothesis of each kind, until there is a cue to tell several."""
    told = settings.model_copy(update={"error": "told"})
    return Belief(
        keys=keys,
        gaze=gaze_hypotheses(told),
        head=head_hypotheses(told),
        log_weights=np.zeros((1, 1)),
        looked=np.full((1, 1, len(keys)), 1 / len(keys)),
        looks=no_looks((1, 1)),
        leave=np.ones((1, 1)),
        new=np.ones((1, 1, len(keys))),
    )


def _with_cues(belief: Belief, measured: Measured, settings: PosteriorSettings) -> Belief:
    """The belief with the hypotheses of a cue that is measured for the first time."""
    if belief.error is None and measured.gaze is not None:
        gaze = gaze_hypotheses(settings)
        belief = _repeated(replace(belief, gaze=gaze), gaze.log_prior, axis=0)
    if belief.motion is None and measured.head is not None:
        head = head_hypotheses(settings)
        belief = _repeated(replace(belief, head=head), head.log_prior, axis=1)
    return belief


def _repeated(belief: Belief, log_prior: Float, axis: int) -> Belief:
    count, shape = len(log_prior), (-1, 1) if axis == 0 else (1, -1)
    looks = belief.looks
    return replace(
        belief,
        log_weights=belief.log_weights + log_prior.reshape(shape),
        looked=np.repeat(belief.looked, count, axis=axis),
        looks=Looks(
            begun=np.repeat(looks.begun, count, axis=axis),
            nowhere=np.repeat(looks.nowhere, count, axis=axis),
            watched_s=np.repeat(looks.watched_s, count, axis=axis),
        ),
    )


def _scaled(log_likelihood: Float) -> tuple[Float, Float]:
    """Likelihoods (H, T) over the greatest of each row, and the logarithms (H, 1) of what was taken out."""
    top = log_likelihood.max(axis=1, keepdims=True)
    return np.exp(log_likelihood - top), top


def _tail(predicted: Float, weights: Float, gaze: Float, head: Float) -> float:
    """The probability of a worse fit of both cues: the smaller of the two, for two chances (Bonferroni)."""
    mean_gaze = float(np.einsum("gk,gkt,gt->", weights, predicted, gaze))
    mean_head = float(np.einsum("gk,gkt,kt->", weights, predicted, head))
    return min(1.0, 2 * min(mean_gaze, mean_head))


def _pruned(belief: Belief) -> Belief:
    """Without the gaze hypotheses that have become very unlikely, if they are many enough to be worth it."""
    top = belief.log_weights.max(axis=1)
    rows = top > top.max() + np.log(_UNLIKELY)
    if rows.mean() > 0.8:
        return belief
    return replace(
        belief,
        gaze=belief.gaze.kept(rows),
        log_weights=belief.log_weights[rows] - top.max(),
        looked=belief.looked[rows],
        leave=belief.leave[rows],
        new=belief.new[rows],
        looks=Looks(
            begun=belief.looks.begun[rows], nowhere=belief.looks.nowhere[rows], watched_s=belief.looks.watched_s[rows]
        ),
        error=belief.error.kept(rows) if belief.error else None,
    )
