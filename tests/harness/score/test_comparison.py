from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from harness.score.comparison import compare, detectable_difference, format_p, with_holm
from harness.score.intervals import ScoredFrames, Units, difference_interval, pair
from harness.score.statistics import NO_INTERVAL

LOOK = 10


def _clips(*right: Sequence[int], first: int = 0) -> list[ScoredFrames]:
    """Clips of one subject: how many of the ten frames of each look are right; frames are numbered from ``first``."""
    return [
        ScoredFrames(
            clip=f"clip {number}",
            subject="girl",
            frames=np.arange(first, first + LOOK * len(looks)),
            looks=np.repeat(np.arange(len(looks)), LOOK),
            truth=np.full(LOOK * len(looks), "cup", dtype=np.object_),
            correct=np.array([frame < look for look in looks for frame in range(LOOK)], dtype=np.intp),
        )
        for number, looks in enumerate(right)
    ]


def test_many_looks_of_few_clips_are_joined_to_stretches_of_one_person() -> None:
    """Twenty looks of each of two people: the boy is right in the first configuration alone, the girl in the second."""
    (wrong,), (right,) = _clips([0] * 20), _clips([LOOK] * 20)
    units = pair([wrong, replace(right, subject="boy")], [right, replace(wrong, subject="boy")]).units
    assert units is not None
    stretches = units.merged()
    assert stretches.frames.tolist() == [3 * LOOK] * 5 + [5 * LOOK] + [3 * LOOK] * 5 + [5 * LOOK]
    assert stretches.values.tolist() == [*-stretches.frames[:6], *stretches.frames[6:]]


def test_looks_are_the_units_of_few_clips() -> None:
    """Eight looks that are all better: 2 of 256 sign flips are as far out, whatever the number of frames."""
    (found,) = compare({"a": _clips([2] * 4, [5] * 4), "b": _clips([6] * 4, [7] * 4)})
    assert (found.unit, found.looks, found.clips, found.n) == ("look", 8, 2, 80)
    assert (found.better, found.worse) == (24, 0)
    assert found.difference == pytest.approx(0.3)
    assert found.p == 2 / 2**8
    assert found.verdict == "better"
    assert "these clips only" in found.sentence
    (back,) = compare({"b": _clips([6] * 4, [7] * 4), "a": _clips([2] * 4, [5] * 4)})
    assert (back.verdict, back.worse, back.difference) == ("worse", 24, pytest.approx(-0.3))
    assert back.interval.low == pytest.approx(-found.interval.high, abs=0.02)


def test_a_gain_of_many_seeds_in_few_frames_outweighs_a_loss_of_one_seed_in_more() -> None:
    few = [replace(each, correct=np.full(20, 10), seeds=20) for each in _clips(*[[0, 0]] * 6)]
    more = [replace(each, correct=np.where(each.frames < 5, 20, 9)) for each in few]
    (found,) = compare({"few": few, "more": more})
    assert (found.better, found.worse, found.difference) == (30, 90, pytest.approx(35 / 400))
    assert (found.is_significant, found.verdict) == (True, "better")
    (back,) = compare({"more": more, "few": few})
    assert back.verdict == "worse"


def test_clips_are_the_units_of_six() -> None:
    (found,) = compare({"a": _clips(*[[2, 5]] * 6), "b": _clips(*[[6, 6]] * 6)})
    assert (found.unit, found.looks, found.clips) == ("clip", 12, 6)
    assert found.p == 2 / 2**6
    assert "these clips only" not in found.sentence


def test_a_long_look_is_no_evidence_by_itself() -> None:
    """McNemar's test would call 9 better frames of 9 significant."""
    (found,) = compare({"a": _clips([0]), "b": _clips([9])})
    assert (found.n, found.better, found.worse, found.p, found.looks) == (10, 9, 0, 1.0, 1)
    assert math.isnan(found.interval.low)
    assert found.detectable == math.inf
    assert not found.can_be_significant
    assert found.verdict == "cannot be told apart"


@pytest.mark.parametrize("seed", range(6))
def test_an_interval_holds_no_difference_exactly_where_the_corrected_test_rejects_none(seed: int) -> None:
    rng = np.random.default_rng(seed)
    right = {name: _clips(*rng.integers(0, 6 + 2 * k, (9, 3)).tolist()) for k, name in enumerate("abcd")}
    found = compare(right)
    assert {each.is_significant for each in found} == {True, False}
    for each in found:
        assert (each.interval.low <= 0 <= each.interval.high) == (not each.is_significant)
        assert each.interval.low < each.difference < each.interval.high


def test_a_corrected_interval_is_longer_than_one_of_a_single_comparison() -> None:
    right = {name: _clips(*[[k + j, 5] for j in range(9)]) for k, name in enumerate("abc")}
    right["b"] = _clips(*[[10 - j, 5] for j in range(9)])
    (alone,) = compare({name: right[name] for name in "ab"})
    corrected = compare(right)[0]
    assert corrected.interval.low < alone.interval.low
    assert corrected.interval.high > alone.interval.high


def test_several_comparisons_are_corrected_together() -> None:
    found = compare({"a": _clips([1] * 8), "b": _clips([3] * 8), "c": _clips([3] * 8)})
    assert [(each.reference, each.configuration, each.family) for each in found] == [
        ("a", "b", 3),
        ("a", "c", 3),
        ("b", "c", 3),
    ]
    assert [each.p_holm for each in found] == pytest.approx([6 / 2**8, 6 / 2**8, 1.0])
    assert "corrected for 3 comparisons" in found[0].sentence
    assert [each.can_be_significant for each in found] == [True] * 3
    few = {name: _clips([right] * 6) for name, right in (("a", 1), ("b", 3), ("c", 4))}  # alone, 2 / 2**6 is below 5 %
    assert [each.can_be_significant for each in compare(few)] == [False] * 3
    assert compare({name: few[name] for name in "ab"})[0].can_be_significant


def test_what_cannot_be_told_apart_says_what_could_have_been() -> None:
    (found,) = compare({"a": _clips([5, 2, 7, 4, 5, 6, 3, 4]), "b": _clips([6, 1, 8, 3, 5, 7, 2, 5])})
    assert found.verdict == "cannot be told apart"
    assert 0.05 < found.detectable < 0.3
    assert f"{100 * found.detectable:.1f} points" in found.sentence


def test_only_frames_that_both_scored_are_compared() -> None:
    (found,) = compare({"a": _clips([5, 5]), "b": _clips([5, 10], first=5)})
    assert found.n == 15
    assert found.looks == 2  # those of the first


def test_without_common_frames_nothing_is_claimed() -> None:
    (found,) = compare({"a": _clips([5]), "b": _clips([5], first=100)})
    assert (found.n, found.p, found.is_significant) == (0, 1.0, False)
    assert "no common frame" in found.sentence
    assert compare({"a": _clips([5])}) == ()


def test_configurations_that_are_right_on_the_same_frames_are_identical() -> None:
    right = [[2, 5, 7]] * 6
    (same,) = compare({"a": _clips(*right), "b": _clips(*right)})
    assert same.is_identical
    assert same.sentence == "b vs a: identical on 180 frames"
    assert same.interval == NO_INTERVAL
    (other,) = compare({"a": _clips([5, 5]), "b": _clips([4, 6])})
    assert (other.difference, other.is_identical) == (0, False)
    (nothing,) = compare({"a": _clips([5]), "b": _clips([5], first=100)})
    assert not nothing.is_identical


def test_p_values_for_people() -> None:
    shown = {1.0: "p = 1", 0.25: "p = 0.25", 0.0312: "p = 0.031", 0.001: "p = 0.001", 0.00099: "p < 0.001"}
    assert {p: format_p(p) for p in shown} == shown


@pytest.mark.parametrize(
    ("p_values", "levels"),
    [
        (
            (0.001, 0.2, 0.3),
            (0.05 / 3, 0.05 / 2, 0.05 / 2),
        ),  # one is rejected: the next is tested at 5 % / 2, and it ends
        ((0.2, 0.9, 0.3), (0.05 / 3, 0.05 / 3, 0.05 / 3)),
        ((0.02, 0.001, 0.001), (0.05 / 1, 0.05 / 3, 0.05 / 3)),  # equal p: one level, in any order
        ((0.001, 0.02, 0.02), (0.05 / 3, 0.05 / 2, 0.05 / 2)),
    ],
)
def test_intervals_have_the_level_at_which_holm_tests_their_comparison(
    p_values: tuple[float, ...], levels: tuple[float, ...]
) -> None:
    rng = np.random.default_rng(7)
    gains = rng.normal(1, 3, 12)
    units = Units(clips=np.arange(12), frames=np.full(12, 30.0), values=gains)
    (one,) = compare({"a": _clips([5, 5]), "b": _clips([4, 6])})
    corrected = with_holm([replace(one, p=p, units=units) for p in p_values])
    expected = [difference_interval(units, level) for level in levels]
    assert [comparison.interval for comparison in corrected] == expected
    assert [comparison.detectable for comparison in corrected] == [detectable_difference(units, family=3)] * 3
    assert detectable_difference(units, family=3) > detectable_difference(units) > 0
    assert len({interval.high for interval in (difference_interval(units, 0.05 / k) for k in (1, 2, 3))}) == 3
