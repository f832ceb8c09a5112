"""The frames of a sequence: Bayes' rule over targets and hypotheses, forwards and, with later frames known, backwards.

The backward pass is that of each of the likeliest hypotheses, with their weights after the last known frame. Under one
hypothesis the looks are a hidden Markov model, and the pass needs only the beliefs of the filter (Kim 1994).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vfoa.posterior.belief import Belief, MeasuredCues, Scenery, first_belief, pruned, with_cues
from vfoa.posterior.cues import FACING_S, facing_after, offsets_of, weighed_gaze, weighed_head
from vfoa.posterior.grid import PLAUSIBLE_SHARE, Error
from vfoa.posterior.looks import LEAST, Keys, Ways, columns_of, leaving, new_look, predicted_looks
from vfoa.types import Float

COUNTED_S = 0.04
"""Least mean time between frames that count for later ones, seconds. The powers below were chosen at 10 to 25 frames
per second.

The noise of a frame lasts into the next ones. If it is an AR(1) process with the time constant tau, n frames that are
dt apart are worth n (1 - rho) / (1 + rho) independent ones, rho = exp(-dt / tau). Where dt is short, that is n dt / (2
tau): a number per second, whatever the frame rate. So at most 1 / ``COUNTED_S`` frames per second count. Of 30 to 100
ms, 40 (tau = 20 ms) is what leaves the answers at 25 frames per second as they were; 60 depend a little less on the
rate. The answer in the others follows from the last one that counts and from their own directions.
"""
_EARLY_S = 0.0004
"""A frame counts this much too early, too: at usual rates some come exactly when one may count, and which these are
must not hang on the last digits of their times."""
_ERROR_POWER = 0.7
"""Power of the likelihood of the error (not of the target) in every frame but the first: consecutive frames carry less
information about the error than independent ones, because errors last."""
_HEAD_POWER = 0.33
"""Power of the likelihood of the head in every frame but the first: how a head moves is known only roughly, and the
error of one frame lasts into the next."""
_TEMPERATURE, _SMOOTHED_TEMPERATURE = 1.4, 2.0
"""Flattening for a gaze of unknown error: probabilities are raised to the power 1 / temperature, since the model has
errors without a hypothesis (temperature scaling, Guo et al. 2017). Later frames repeat the errors of the earlier ones.
"""
_DOUBT, _SMOOTHED_DOUBT = 0.67, 1.6
"""Rise of the temperature from a share of 0.8 to one of 1, for forward answers and for those that know later frames.

Chosen on eight people of vr_objects and the first half of idiap_vfoa, heads only.
"""
_MOST_HYPOTHESES = 48
"""Number of the likeliest hypotheses in the backward pass: the others together seldom have one percent."""


def update(before: Belief | None, scenery: Scenery, cues: MeasuredCues, dt_s: float, error: Error) -> Belief:
    """Return the belief after a frame that comes ``dt_s`` seconds after the last one that counts (``before``)."""
    prior = with_cues(before or first_belief(scenery.keys), cues, error)
    columns, known = columns_of(prior.keys, scenery.keys)
    new = new_look(prior.looks, len(scenery.keys) - 1)
    if before is None:
        leave, predicted, stayed = np.ones(new.shape[1:]), new, np.zeros_like(new)
    else:
        leave = leaving(prior.looks, dt_s)
        predicted, stayed = predicted_looks(prior.looked, columns, known, leave, new)

    # time that is left over makes the next frame count earlier, so that a jitter of the times changes nothing
    budget_s = 2 * COUNTED_S if before is None else min(before.spare_s + dt_s, 2 * COUNTED_S)
    counts = prior is not before or budget_s >= COUNTED_S - _EARLY_S  # the first frame of a cue always does
    headless_s = prior.headless_s + dt_s if cues.head is None else 0.0
    if prior.last_head is not None and headless_s > FACING_S:
        prior = replace(prior, last_head=None)  # of an older one nobody knows where it has turned since
    # the first frame counts in full: no earlier frame shares its error
    power, head_power = (1.0, 1.0) if before is None else (_ERROR_POWER, _HEAD_POWER)
    ways = Ways(columns, *(prior.weights * each for each in (prior.looked, stayed, predicted)))
    offsets = offsets_of(prior, scenery, cues)
    gaze_error, by_gaze = weighed_gaze(prior, scenery, cues, offsets.gaze, ways, dt_s)
    motion, by_head = weighed_head(prior, scenery, cues, offsets, ways, dt_s)

    likelihood = by_gaze.likelihood[:, None] * (by_head.likelihood**head_power)[..., None]
    seen, went_on = predicted * likelihood, stayed * likelihood
    total = seen.sum(axis=0)
    belief = replace(
        prior,
        keys=scenery.keys,
        log_weights=prior.log_weights + power * np.log(total),
        looked=seen / total,
        leave=leave,
        new=new,
        looks=prior.looks.after(
            1 - went_on.sum(axis=0) / total,
            (seen[-1] - went_on[-1]) / total,
            0.0 if before is None else dt_s,
        ),
        error=gaze_error,
        motion=motion,
        last_head=prior.last_head if cues.head is None else cues.head,
        headless_s=headless_s,
        facing=facing_after(prior, scenery, cues, dt_s),
        tail=min(1.0, 2 * by_gaze.tail, 2 * by_head.tail),  # of a worse fit of either cue (Bonferroni)
        counts=counts,
        spare_s=max(budget_s - COUNTED_S, -_EARLY_S),
    )
    return pruned(belief) if counts else belief


def answered(belief: Belief, probabilities: Float, error: Error, *, later_known: bool = False) -> Float:
    """The answer (T,) for the model's probabilities (T,): flatter if gaze or head are doubtful and the error unknown.

    ``later_known`` says that they are those of smoothing. A head is doubtful if it turns farther than people do
    (:data:`vfoa.posterior.grid.PLAUSIBLE_SHARE`).
    """
    if error == "told":
        return probabilities
    temperature = 1.0
    if belief.error is not None:
        temperature = _SMOOTHED_TEMPERATURE if later_known else _TEMPERATURE
    doubt = (belief.implied_share - PLAUSIBLE_SHARE) / (1 - PLAUSIBLE_SHARE) if belief.motion is not None else 0.0
    if doubt > 0:
        temperature *= 1 + doubt * (_SMOOTHED_DOUBT if later_known else _DOUBT)
    flat = probabilities ** (1 / temperature)
    return np.asarray(flat / flat.sum())


# With later frames known


@dataclass(frozen=True, slots=True)
class _ChosenHypotheses:
    """One frame under H chosen hypotheses: looked (T, H), and the transition to it, leave (H,) and new (T, H)."""

    keys: Keys
    looked: Float
    leave: Float
    new: Float


def smoothed(beliefs: Sequence[Belief]) -> list[Float]:
    """Probabilities (T,) of the targets in each frame, given all of them that count, and itself."""
    steps, weights = _likeliest_hypotheses(beliefs)
    later = steps[-1]
    given_all = later.looked
    answers = [given_all @ weights]
    for belief, step in zip(reversed(beliefs[:-1]), reversed(steps[:-1]), strict=True):
        columns, known = columns_of(step.keys, later.keys)
        predicted, _ = predicted_looks(step.looked, columns, known, later.leave, later.new)
        ratio = given_all / np.maximum(predicted, LEAST)
        anew = (ratio * later.new).sum(axis=0)
        back, still = columns_of(later.keys, step.keys)
        stays = ratio[back] if still is None else np.where(still[:, None], ratio[back], anew)
        given = step.looked * ((1 - later.leave) * stays + later.leave * anew)
        given = given / given.sum(axis=0)
        answers.append(given @ weights)
        if belief.counts:
            later, given_all = step, given
    return answers[::-1]


def _likeliest_hypotheses(beliefs: Sequence[Belief]) -> tuple[list[_ChosenHypotheses], Float]:
    """Return every frame under the hypotheses that are likeliest at the end, and their weights (H,)."""
    last = beliefs[-1]
    weights = last.weights.ravel()
    chosen = np.sort(np.argsort(weights, kind="stable")[-_MOST_HYPOTHESES:])
    head, gaze = np.unravel_index(chosen, last.weights.shape)
    number = last.gaze.number[gaze]
    steps = []
    for belief in beliefs:
        # a cue that came later had a single hypothesis before
        row = np.searchsorted(belief.gaze.number, number) if len(belief.gaze.number) > 1 else np.zeros_like(gaze)
        column = head if len(belief.head.share) > 1 else np.zeros_like(head)
        pair = ..., column, row
        steps.append(_ChosenHypotheses(belief.keys, belief.looked[pair], belief.leave[pair], belief.new[pair]))
    return steps, weights[chosen] / weights[chosen].sum()
