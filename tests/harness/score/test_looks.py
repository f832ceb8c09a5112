"""Looks as units of inference, and events."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from harness.labels.labels import Label
from harness.score.looks import (
    LEAST_S,
    Event,
    MatchCounts,
    correlation_time_s,
    count_events,
    find_events,
    match_events,
    number_looks,
    seconds_from_change,
)
from vfoa.types import Codes


def _looks(letters: str, rate: float | None, positions: list[int] | None = None) -> str:
    """The looks of frames that show one letter for each target, as digits."""
    codes = np.array([ord(letter) for letter in letters], dtype=np.intp)
    places = np.array(positions or range(len(letters)), dtype=np.intp)
    return "".join(map(str, number_looks(codes, places, rate).tolist()))


@pytest.mark.parametrize(
    ("letters", "rate", "looks"),
    [
        ("aabbba", None, "001112"),  # no rate: nothing is joined
        ("aabbba", 1.0, "001111"),  # looks of 2, 3 and 1 s: the last joins the one before
        ("abcdef", 1.0, "001122"),
        ("aaa", 1.0, "000"),
        ("aabb", 100.0, "0000"),  # never lasts long enough: one look
        ("", 1.0, ""),
    ],
)
def test_looks_shorter_than_two_seconds_are_joined(letters: str, rate: float | None, looks: str) -> None:
    assert _looks(letters, rate) == looks


def test_a_gap_ends_a_look_and_sparse_labels_do_not() -> None:
    assert _looks("aaaa", None, [0, 1, 5, 6]) == "0011"
    assert _looks("aaaa", None, [0, 10, 20, 30]) == "0000"
    assert _looks("aabb", 10.0, [0, 10, 20, 30]) == "0011"  # a label stands for a second each


@given(letters=st.text("abc", min_size=1, max_size=80), rate=st.sampled_from([0.5, 1.0, 7.0, 25.0]))
def test_units_are_whole_looks_in_order_and_long_enough(letters: str, rate: float) -> None:
    codes = np.array([ord(letter) for letter in letters], dtype=np.intp)
    places = np.arange(len(letters), dtype=np.intp)
    units, looks = number_looks(codes, places, rate), number_looks(codes, places, None)
    assert units[0] == 0
    assert set(np.diff(units)) <= {0, 1}
    assert len({*zip(looks.tolist(), units.tolist(), strict=True)}) == looks[-1] + 1
    seconds = np.bincount(units) / rate
    assert len(seconds) == 1 or seconds.min() >= LEAST_S


@pytest.mark.parametrize("every", [1, 7, 25, 50])
def test_sparse_labels_show_how_long_verdicts_stay_alike(every: int) -> None:
    """Verdicts that change at random, once in 8 s on average: they stay alike for 4 s."""
    generator = np.random.default_rng(1)
    sequences = []
    for _ in range(20):
        right = np.cumsum(generator.random(25 * 300) < 1 / (25 * 8)) % 2 == 0
        positions = np.arange(0, len(right), every, dtype=np.intp)
        sequences.append((right[positions], positions, 25.0))
    assert correlation_time_s(sequences) == pytest.approx(4, rel=0.5)


def test_long_sequences_count_beside_short_ones() -> None:
    """Verdicts that change every 8 s on average, as above; few pairs of frames are far apart, and as unlike."""
    generator = np.random.default_rng(2)
    sequences = []
    for length_s in [4] * 200 + [120] * 10:
        right = np.cumsum(generator.random(25 * length_s) < 1 / (25 * 8)) % 2 == 0
        sequences.append((right, np.arange(len(right), dtype=np.intp), 25.0))
    assert correlation_time_s(sequences) == pytest.approx(4, rel=0.5)


def test_verdicts_that_do_not_change_stay_alike_for_no_known_time() -> None:
    """As do those of clips whose rate is not known, and single ones: nothing is left that shows a time."""
    changing, places = np.arange(200) % 100 < 50, np.arange(200, dtype=np.intp)
    known = [(changing, places, 25.0)]
    assert correlation_time_s(known) > 0
    assert correlation_time_s([]) == 0
    assert correlation_time_s([(np.ones(200, dtype=np.bool_), places, 25.0)]) == 0
    left_out = [(changing[::-1], places, None), (changing[:1], places[:1], 25.0), (changing[:0], places[:0], 25.0)]
    assert correlation_time_s(left_out) == 0
    assert correlation_time_s([*left_out, *known]) == correlation_time_s(known)


@pytest.mark.parametrize(
    ("letters", "times_s", "expected"),
    [
        ("aabb", [0, 1, 2, 3], [1.5, 0.5, 0.5, 1.5]),
        ("aabbc", [0, 1, 2, 3, 4], [1.5, 0.5, 0.5, 0.5, 0.5]),  # the nearer of two changes
        ("aaaa", [0, 1, 2, 3], [math.inf] * 4),
        ("-aa-", [0, 1, 2, 3], [math.inf] * 4),  # nobody says what there is before and after the labels
        ("aaibb", [0, 1, 2, 3, 4], [math.inf] * 5),  # nor in a gap
        ("a-a-b-", [0, 1, 2, 3, 4, 5], [3, 2, 1, 0, 1, 2]),  # a label of every other frame leaves no gap
        ("ab", [0, 10], [5, 5]),
        ("", [], []),
    ],
)
def test_a_change_is_midway_between_two_judged_frames(
    letters: str, times_s: list[float], expected: list[float]
) -> None:
    labels = [None if each == "-" else Label(target="ignore" if each == "i" else each) for each in letters]
    assert seconds_from_change(labels, times_s) == expected


CODES = {"A": 0, "B": 1, "C": 2, "-": 3, "?": -1}


def _codes(text: str) -> Codes:
    return np.array([CODES[sign] for sign in text], dtype=np.intp)


def _count(truth: str, found: str) -> MatchCounts:
    return count_events([(_codes(truth), _codes(found), np.arange(len(truth), dtype=np.intp))])


def test_an_example_written_out_by_hand() -> None:
    #        A1     B1    A2    C1   -1     five true events
    truth = "AAAAAA BBBB  AAA   CC   ---".replace(" ", "")
    found = "AAB?AA BABB  BAA   BB   ---".replace(" ", "")
    #        a b  a  b a b      a   b  -    found: AA, B, (no prediction), AA, B, A, BBB, AA, BB, --- : nine events
    # A1 takes the first AA (the second AA stays over), B1 the B of one frame, A2 the AA, -1 the ---; C1 nothing.
    counts = _count(truth, found)
    assert counts == MatchCounts(true=5, predicted=9, matched=4)
    assert counts.recall == 4 / 5
    assert counts.precision == 4 / 9
    assert counts.f_measure == pytest.approx(2 * (4 / 5) * (4 / 9) / (4 / 5 + 4 / 9))


def test_a_long_event_matches_only_one_of_two_that_it_covers() -> None:
    assert _count("AABAA", "AAAAA") == MatchCounts(true=3, predicted=1, matched=1)
    assert _count("AAAAA", "AABAA") == MatchCounts(true=1, predicted=3, matched=1)


def test_events_are_longest_runs() -> None:
    found = find_events(_codes("AAB?A"), np.arange(5, dtype=np.intp))
    assert found == [Event(0, 0, 1), Event(1, 2, 2), Event(0, 4, 4)]


def test_frames_that_are_not_scored_end_a_run() -> None:
    assert len(find_events(_codes("AAAA"), np.array([0, 1, 5, 6], dtype=np.intp))) == 2


def test_events_of_every_fifth_frame_are_those_of_all_frames() -> None:
    every = np.arange(0, 30, 5, dtype=np.intp)
    assert find_events(_codes("AAABBB"), every) == [Event(0, 0, 10), Event(1, 15, 25)]
    assert len(find_events(_codes("AAABBB"), np.where(every > 20, every + 50, every))) == 3
    assert count_events([(_codes("AAABBB"), _codes("AABBBB"), every)]) == MatchCounts(true=2, predicted=2, matched=2)


def test_a_perfect_prediction_matches_every_event() -> None:
    assert _count("AABBA-", "AABBA-") == MatchCounts(true=4, predicted=4, matched=4)


def test_no_prediction_is_no_event() -> None:
    counts = _count("AAB", "???")
    assert counts == MatchCounts(true=2, predicted=0, matched=0)
    assert counts.recall == 0
    assert math.isnan(counts.precision)
    assert counts.f_measure == 0


def test_sequences_are_counted_together_but_never_joined() -> None:
    sequence = (_codes("AA"), _codes("AA"), np.arange(2, dtype=np.intp))
    assert count_events([sequence, sequence]) == MatchCounts(true=2, predicted=2, matched=2)


def test_no_frames_have_no_events() -> None:
    counts = count_events([(_codes(""), _codes(""), _codes(""))])
    assert counts == MatchCounts(true=0, predicted=0, matched=0)
    assert all(math.isnan(rate) for rate in counts.rates)


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(-1, 2)), min_size=1, max_size=40))
def test_no_other_pairing_matches_more_events(pairs: list[tuple[int, int]]) -> None:
    truth, predicted = np.array(pairs, dtype=np.intp).T
    places = np.arange(len(pairs), dtype=np.intp)
    true, found = find_events(truth, places), find_events(predicted, places)
    fits = np.array(
        [[t.code == f.code and t.first <= f.last and f.first <= t.last for f in found] for t in true], dtype=np.intp
    ).reshape(len(true), len(found))
    rows, columns = linear_sum_assignment(fits, maximize=True)
    assert match_events(true, found) == fits[rows, columns].sum()
