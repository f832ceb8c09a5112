from __future__ import annotations

from dataclasses import replace

from harness.labels.labels import Label
from harness.report.verdict import NEXT_STEPS, next_steps
from harness.score.verdicts import ERROR_TYPES, judge_absent


def test_every_error_type_has_a_next_step() -> None:
    assert list(NEXT_STEPS) == list(ERROR_TYPES)


def test_the_most_frequent_error_types_are_told_with_their_share() -> None:
    absent = judge_absent("clip", "one", 1, "girl", Label(target="bird"))
    types = ["missed"] * 3 + ["outscored"] * 2 + ["no_subject"] * 3 + [None] * 9
    found = next_steps(replace(absent, error_type=each) for each in types)
    assert [line.split(" (")[0] for line in found] == ["3 of 8 wrong frames: no_subject", "3 of 8 wrong frames: missed"]
    assert all("Next: " in line for line in found)


def test_nothing_wrong_needs_no_next_step() -> None:
    assert next_steps([]) == []
