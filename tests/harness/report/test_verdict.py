"""The one sentence that says what a run found, and what to try next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from harness.labels.labels import Label
from harness.report.verdict import grid_levels, next_steps, verdict_sentence
from harness.score.outcomes import Reference
from harness.score.score import score
from harness.score.verdicts import judge_absent
from tests.records import answers, labels

TRUTH = [name for _ in range(30) for name in ("cup",) * 60 + ("book",) * 60]
"""Looks of 60 frames, far longer than what is joined."""


def _said(right: Mapping[str, float], clips: int = 1, factors: Mapping[str, Mapping[str, str]] | None = None) -> str:
    """The verdict on configurations that are right in this share of each look, less by 2 % from clip to clip."""
    names = [f"clip {k}" for k in range(clips)]
    truth = TRUTH[: 120 * 6]
    records = []
    for k, clip in enumerate(names):
        for configuration, share in right.items():
            given = [name if i % 60 < 60 * share * (1 - 0.02 * k) else "vase" for i, name in enumerate(truth)]
            records += answers(given, configuration=configuration, clip=clip)
    reference = Reference(labels={clip: labels(*truth) for clip in names}, factors=factors or {})
    return verdict_sentence(score(records, reference))


def test_a_grid_is_judged_by_its_factors_over_all_values_of_the_others() -> None:
    right = {"bm-one": 0.5, "bm-two": 0.7, "sgbm-one": 0.5, "sgbm-two": 0.7}
    said = _said(right, factors=_factors(*right))
    better, alike = said.split("; ")
    assert better.startswith("two beats one by 20.0 points")
    assert alike == "bm and sgbm are identical on 720 frames."


def test_names_by_hand_are_no_grid() -> None:
    said = _said({"bm-one": 0.5, "bm-two": 0.7, "sgbm-one": 0.5, "sgbm-two": 0.7})
    assert said.startswith("bm-two beats bm-one by 20.0 points")


def test_configurations_that_are_no_grid_are_compared_with_the_best() -> None:
    said = _said({"a": 0.5, "b": 0.9, "c": 0.9})
    better, alike = said.split("; ")
    assert better.startswith("b beats a by 40.0 points")
    assert alike == "b and c are identical on 720 frames."


def test_equal_sums_over_a_grid_are_not_identical() -> None:
    right = {"bm-one": 0.5, "bm-two": 0.52, "sgbm-one": 0.52, "sgbm-two": 0.5}
    alike = _said(right, factors=_factors(*right)).split("; ")[-1]
    assert alike.startswith("one and two cannot be told apart (0.0 points, ")
    assert alike.endswith(", these clips only, corrected for 2 comparisons).")


def test_clips_are_the_unit_where_there_are_enough() -> None:
    said = _said({"a": 0.5, "b": 0.9}, clips=6)
    assert said.startswith("b beats a by ")
    assert "these clips only" not in said


def test_one_configuration_is_compared_with_none() -> None:
    assert "none to compare it with" in _said({"one": 0.9})


def test_without_labels_nothing_is_claimed() -> None:
    assert verdict_sentence(score(answers(["cup"]), Reference(labels={}))).startswith("Nothing is scored")


def _factors(*names: str) -> dict[str, dict[str, str]]:
    return {name: dict(zip(("stereo.matcher", "attention.cones_cm"), name.split("-"), strict=False)) for name in names}


@pytest.mark.parametrize(
    ("factors", "levels"),
    [
        (_factors("bm-one", "bm-two", "sgbm-one", "sgbm-two"), [["bm", "sgbm"], ["one", "two"]]),
        (_factors("bm-one", "bm-two", "sgbm-one"), []),
        (_factors("bm", "sgbm"), []),
        (_factors("bm-one", "sgbm"), []),
        ({key: {} for key in ("a-x", "a-y", "b-x", "b-y")}, []),  # names by hand
    ],
)
def test_factors_are_those_of_a_whole_grid(factors: dict[str, dict[str, str]], levels: list[list[str]]) -> None:
    assert list(grid_levels(factors).values()) == levels


def test_the_most_frequent_error_types_are_told_with_their_share() -> None:
    absent = judge_absent("clip", "one", 1, "girl", Label(target="bird"))
    types = ["missed"] * 3 + ["outscored"] * 2 + ["no_subject"] * 3 + [None] * 9
    verdicts = tuple(replace(absent, error_type=each) for each in types)
    found = next_steps(replace(score([], Reference(labels={})), verdicts=verdicts), ("one",))
    assert [line.split(" (")[0] for line in found] == ["3 of 8 wrong frames: no_subject", "3 of 8 wrong frames: missed"]
    assert all("Next: " in line for line in found)


def test_nothing_wrong_needs_no_next_step() -> None:
    assert next_steps(score([], Reference(labels={})), ("one",)) == []
