"""The target of each frame with later frames known: the backward pass under each of the likeliest hypotheses.

The weights of the hypotheses are those after the last known frame. Under one hypothesis the looks are a hidden Markov
model, and the backward pass needs only the beliefs of the filter (Kim 1994).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vfoa.posterior.belief import Belief
from vfoa.posterior.looks import Keys, columns_of, predicted_looks
from vfoa.types import Float

_MOST_HYPOTHESES = 48
"""Number of the likeliest hypotheses in the backward pass: the others together seldom have one percent."""


@dataclass(frozen=True, slots=True)
class _Step:
    """One frame under H chosen hypotheses: looked (H, T), and the transition to it, leave (H,) and new (H, T)."""

    keys: Keys
    looked: Float
    leave: Float
    new: Float


def smoothed(beliefs: Sequence[Belief]) -> list[Float]:
    """Probabilities (T,) of the targets in each frame, given all of them."""
    steps, weights = _likeliest_hypotheses(beliefs)
    later = steps[-1]
    given_all = later.looked
    answers = [weights @ given_all]
    for step in reversed(steps[:-1]):
        columns, known = columns_of(step.keys, later.keys)
        predicted, _ = predicted_looks(step.looked, columns, known, later.leave, later.new)
        ratio = given_all / np.maximum(predicted, 1e-300)
        anew = (ratio * later.new).sum(axis=1, keepdims=True)
        back, still = columns_of(later.keys, step.keys)
        stays = ratio[:, back] if still is None else np.where(still, ratio[:, back], anew)
        leave = later.leave[:, None]
        given_all = step.looked * ((1 - leave) * stays + leave * anew)
        given_all = given_all / given_all.sum(axis=1, keepdims=True)
        answers.append(weights @ given_all)
        later = step
    return answers[::-1]


def _likeliest_hypotheses(beliefs: Sequence[Belief]) -> tuple[list[_Step], Float]:
    """Return every frame under the hypotheses that are likeliest at the end, and their weights (H,)."""
    last = beliefs[-1]
    weights = last.weights.ravel()
    chosen = np.sort(np.argsort(weights, kind="stable")[-_MOST_HYPOTHESES:])
    gaze, head = np.unravel_index(chosen, last.weights.shape)
    number = last.gaze.number[gaze]
    steps = []
    for belief in beliefs:
        # a cue that came later had a single hypothesis before
        row = np.searchsorted(belief.gaze.number, number) if len(belief.gaze.number) > 1 else np.zeros_like(gaze)
        column = head if len(belief.head.share) > 1 else np.zeros_like(head)
        row = np.minimum(row, len(belief.gaze.number) - 1)
        steps.append(_Step(belief.keys, belief.looked[row, column], belief.leave[row, column], belief.new[row, column]))
    return steps, weights[chosen] / weights[chosen].sum()
