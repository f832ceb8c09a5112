"""The backward pass against the sum over every sequence."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vfoa.posterior.belief import Belief
from vfoa.posterior.filter import smoothed
from vfoa.posterior.grid import gaze_hypotheses, head_hypotheses
from vfoa.posterior.looks import Keys, columns_of, no_looks, predicted_looks

LEAVE = np.full((1, 1), 0.25)


def new_of(keys: Keys) -> np.ndarray:
    """A new look is at nowhere with probability 0.1, and else at any target."""
    count = len(keys) - 1
    return np.array([0.9 / count] * count + [0.1]).reshape(-1, 1, 1)


def beliefs_of(keys: list[Keys], likelihoods: list[np.ndarray]) -> list[Belief]:
    """The forward pass of a plain hidden Markov model."""
    found: list[Belief] = []
    for seen, likelihood in zip(keys, likelihoods, strict=True):
        new = new_of(seen)
        if found:
            before = found[-1]
            predicted, _ = predicted_looks(before.looked, *columns_of(before.keys, seen), LEAVE, new)
        else:
            predicted = new
        looked = predicted * likelihood[:, None, None]
        found.append(
            Belief(
                keys=seen,
                gaze=gaze_hypotheses("told"),
                head=head_hypotheses("told"),
                log_weights=np.zeros((1, 1)),
                looked=looked / looked.sum(),
                looks=no_looks(),
                leave=LEAVE,
                new=new,
            )
        )
    return found


def sequences_of(keys: list[Keys], likelihoods: list[np.ndarray]):
    """Every sequence of keys with its joint probability."""
    for sequence in product(*keys):
        weight = 1.0
        for at, key in enumerate(sequence):
            column, new = keys[at].index(key), new_of(keys[at]).ravel()
            if at == 0:
                step = new[column]
            elif sequence[at - 1] in keys[at]:
                step = 0.75 * (key == sequence[at - 1]) + 0.25 * new[column]
            else:
                step = new[column]
            weight *= step * likelihoods[at][column]
        yield sequence, weight


@st.composite
def comings_and_goings(draw: st.DrawFn):
    """Four frames with some of three targets each: keys, likelihoods."""
    ids = draw(st.lists(st.sets(st.integers(1, 3), min_size=1), min_size=4, max_size=4))
    keys = [(*sorted(each), None) for each in ids]
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    return keys, [rng.uniform(0.01, 1, len(key)) for key in keys]


@given(comings_and_goings())
def test_both_passes_are_the_sum_over_every_sequence(clip) -> None:
    keys, likelihoods = clip
    found = smoothed(beliefs_of(keys, likelihoods))
    for at, probabilities in enumerate(found):
        exact = dict.fromkeys(keys[at], 0.0)
        for sequence, weight in sequences_of(keys, likelihoods):
            exact[sequence[at]] += weight
        assert probabilities == pytest.approx(np.array(list(exact.values())) / sum(exact.values()))
