"""Transitions and passes of the hidden Markov model against every sequence, counted out."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.scenes import make_subject
from vfoa.dwell import DwellSettings, prior, revise, transition
from vfoa.types import Attention, FrameResult, NoAttention, Scene, TargetAttention

BOTH = DwellSettings(smoothing="both", dwell_frames=4.0)
VITERBI = BOTH.model_copy(update={"smoothing": "viterbi"})
KEYS = (1, 2, None)
LEAVE = 1 / 4


def step_matrix():
    """Rows from, columns to."""
    return (1 - LEAVE) * np.eye(3) + LEAVE * prior(KEYS, BOTH)


def filtered(likelihoods):
    """The forward pass of a plain hidden Markov model: (N, 3) probabilities."""
    belief, found = None, []
    for likelihood in likelihoods:
        predicted = prior(KEYS, BOTH) if belief is None else belief @ step_matrix()
        belief = predicted * likelihood
        belief = belief / belief.sum()
        found.append(belief)
    return np.array(found)


def results(beliefs, keys=None):
    """Frames whose attention is these beliefs, about the same targets or about each frame's own."""
    frames = []
    for index, belief in enumerate(beliefs):
        seen = keys[index] if keys else KEYS
        values = tuple(
            TargetAttention(instance_id=key, gaze=0.75 * p, head=0.25 * p, total=p)
            for key, p in zip(seen[:-1], belief.tolist()[:-1], strict=True)
        )
        attention = Attention(subject=make_subject(), values=values, focus=seen[int(belief.argmax())])
        scene = Scene(index=index, time_ns=0, targets=(), people=())
        frames.append(FrameResult(scene=scene, attentions=(attention,)))
    return frames


def weighed_sequences(likelihoods):
    """Every sequence of columns with its joint probability."""
    step = step_matrix()
    for columns in product(range(3), repeat=len(likelihoods)):
        weight = prior(KEYS, BOTH)[columns[0]] * np.prod([one[c] for one, c in zip(likelihoods, columns, strict=True)])
        yield columns, weight * np.prod([step[a, b] for a, b in pairwise(columns)])


SEEDS = st.integers(0, 10_000)


@given(SEEDS, st.integers(0, 4))
def test_both_passes_are_the_sum_over_every_sequence(seed, at):
    likelihoods = np.random.default_rng(seed).uniform(0.01, 1, (5, 3))
    exact = np.zeros(3)
    for columns, weight in weighed_sequences(likelihoods):
        exact[columns[at]] += weight
    (attention,) = revise(results(filtered(likelihoods)), at, BOTH).attentions
    assert [value.total for value in attention.values] == pytest.approx((exact / exact.sum())[:2].tolist())
    for value in attention.values:
        assert (value.gaze, value.head) == pytest.approx((0.75 * value.total, 0.25 * value.total))


@given(SEEDS)
def test_viterbi_finds_the_likeliest_of_every_sequence(seed):
    likelihoods = np.random.default_rng(seed).uniform(0.01, 1, (5, 3))
    best, _ = max(weighed_sequences(likelihoods), key=lambda one: one[1])
    frames = results(filtered(likelihoods))
    assert [revise(frames, at, VITERBI).attentions[0].focus for at in range(5)] == [KEYS[column] for column in best]


@st.composite
def comings_and_goings(draw: st.DrawFn):
    """Four frames with some of three targets each: keys, likelihoods."""
    ids = draw(st.lists(st.sets(st.integers(1, 3), min_size=1), min_size=4, max_size=4))
    keys = [(*sorted(each), None) for each in ids]
    rng = np.random.default_rng(draw(SEEDS))
    return keys, [rng.uniform(0.01, 1, len(each)) for each in keys]


def sequences_of(keys, likelihoods):
    """Every sequence of keys with its joint probability; a transition is what it makes of a belief in one key alone."""
    for sequence in product(*keys):
        weight = 1.0
        for at, key in enumerate(sequence):
            expected = prior(keys[0], BOTH) if at == 0 else transition({sequence[at - 1]: 1.0}, keys[at], BOTH)[0]
            column = keys[at].index(key)
            weight *= expected[column] * likelihoods[at][column]
        yield sequence, weight


def forward(keys, likelihoods):
    """The beliefs of the forward pass."""
    found = []
    for at, likelihood in enumerate(likelihoods):
        held = dict(zip(keys[at - 1], found[-1].tolist(), strict=True)) if found else None
        belief = likelihood * (transition(held, keys[at], BOTH)[0] if held else prior(keys[0], BOTH))
        found.append(belief / belief.sum())
    return found


@given(comings_and_goings())
def test_targets_that_come_and_go_are_looked_at_in_the_likeliest_sequence(clip):
    keys, likelihoods = clip
    best, _ = max(sequences_of(keys, likelihoods), key=lambda one: one[1])
    frames = results(forward(keys, likelihoods), keys)
    assert tuple(revise(frames, at, VITERBI).attentions[0].focus for at in range(4)) == best


@given(comings_and_goings(), st.integers(0, 3))
def test_targets_that_are_hidden_for_a_while_take_nothing_from_those_that_are_seen(clip, at):
    """A frame still lists them, with no probability at all."""
    keys, likelihoods = clip
    beliefs = forward(keys, likelihoods)
    listed = [(1, 2, 3, None)] * 4
    with_hidden = [
        np.array([dict(zip(seen, belief.tolist(), strict=True)).get(key, 0.0) for key in listed[0]])
        for seen, belief in zip(keys, beliefs, strict=True)
    ]
    exact = dict.fromkeys(listed[0], 0.0)
    for sequence, weight in sequences_of(keys, likelihoods):
        exact[sequence[at]] += weight
    (attention,) = revise(results(with_hidden, listed), at, BOTH).attentions
    total = sum(exact.values())
    assert [value.total for value in attention.values] == pytest.approx([exact[key] / total for key in (1, 2, 3)])


def test_one_frame_that_disagrees_is_outvoted_by_those_around_it():
    likelihoods = np.array([[0.8, 0.1, 0.1]] * 3 + [[0.3, 0.4, 0.1]] + [[0.8, 0.1, 0.1]] * 3)
    frames = results(filtered(likelihoods))
    for smoothing in (BOTH, VITERBI):
        assert revise(frames, 3, smoothing).attentions[0].focus == 1


def test_a_frame_without_attention_stays_so_and_is_passed_over():
    frames = results(filtered(np.array([[0.8, 0.1, 0.1]] * 3)))
    gap = Attention(subject=make_subject(), missing=NoAttention.NO_DIRECTION)
    frames[1] = FrameResult(scene=frames[1].scene, attentions=(gap,))
    assert revise(frames, 1, BOTH).attentions == (gap,)
    assert revise(frames, 0, BOTH).attentions[0].focus == 1


def revised(frames, smoothing):
    """Every frame as those around it have it."""
    return [revise(frames, at, smoothing) for at in range(len(frames))]


@pytest.mark.parametrize("smoothing", [BOTH, VITERBI], ids=["both", "viterbi"])
def test_frames_without_attention_count_for_nothing(smoothing):
    whole = results(filtered(np.random.default_rng(4).uniform(0.01, 1, (4, 3))))
    gap = replace(whole[0], attentions=(Attention(subject=make_subject(), missing=NoAttention.NO_EYES_3D),))
    assert revised([gap, *whole[:2], gap, *whole[2:], gap], smoothing)[1:3] == revised(whole, smoothing)[:2]


@pytest.mark.parametrize("smoothing", [BOTH, VITERBI], ids=["both", "viterbi"])
def test_every_subject_has_a_past_and_a_future_of_its_own(smoothing):
    likelihoods = np.random.default_rng(5).uniform(0.01, 1, (2, 5, 3))
    one, other = (results(filtered(each)) for each in likelihoods)
    other = [
        replace(frame, attentions=tuple(replace(a, subject=replace(a.subject, track_id=2)) for a in frame.attentions))
        for frame in other
    ]
    both = [replace(a, attentions=b.attentions + a.attentions) for a, b in zip(one, other, strict=True)]
    alone = [revised(other, smoothing), revised(one, smoothing)]
    for together, *apart in zip(revised(both, smoothing), *alone, strict=True):
        assert [a.values for a in together.attentions] == [a.values for each in apart for a in each.attentions]
        assert [a.focus for a in together.attentions] == [a.focus for each in apart for a in each.attentions]


@pytest.mark.parametrize("smoothing", [BOTH, VITERBI], ids=["both", "viterbi"])
def test_a_target_that_cannot_be_stays_without_attention_and_ties_are_not_kept(smoothing):
    frames = results(filtered(np.array([[0.0, 0.5, 0.5], [0.0, 0.9, 0.1]])))
    frames[0] = replace(frames[0], attentions=(replace(frames[0].attentions[0], tied=(1,)),))
    (attention,) = revise(frames, 0, smoothing).attentions
    assert attention.values[0] == TargetAttention(instance_id=1, gaze=0.0, head=0.0, total=0.0)
    assert (attention.focus, attention.tied) == (2, ())


def test_what_was_believed_of_a_target_that_is_gone_is_open_again():
    predicted, stay = transition({1: 0.2, 2: 0.7, None: 0.1}, (1, None), BOTH)
    assert predicted.sum() == pytest.approx(1)
    stayed = np.array([0.15, 0.075])
    assert stay == pytest.approx(stayed / predicted)
    assert predicted == pytest.approx(stayed + (1 - stayed.sum()) * prior((1, None), BOTH))


def test_only_later_frames_make_a_frame_wait():
    awaited = {kind: BOTH.model_copy(update={"smoothing": kind}).frames_awaited for kind in ("off", "forward", "both")}
    assert awaited == {"off": 0, "forward": 0, "both": 25}


@pytest.mark.parametrize(
    ("name", "good", "refused"),
    [
        ("p_nowhere", (0.01, 0.99), (0, 1)),
        ("dwell_frames", (1.1, 500), (1,)),
        ("look_ahead_frames", (1, 1000), (0, 1001)),
    ],
)
def test_a_setting_outside_of_its_range_is_refused(name, good, refused):
    for value in good:
        assert getattr(DwellSettings(**{name: value}), name) == value
    for value in refused:
        with pytest.raises(ValidationError, match=name):
            DwellSettings(**{name: value})
