"""The lines that say what a run found, and what to try next."""

from __future__ import annotations

import math
import re
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from harness.cli.terminal import print_scores, verdict_of_run
from harness.report import verdict
from harness.report.comparisons import factors_table
from harness.report.factors import compare_factors, grid_levels
from harness.report.tables import error_types_table
from harness.report.verdict import MOST_LINES, next_steps, verdict_lines
from harness.report.write import run_tables
from harness.score.baselines import BASELINES
from harness.score.comparison import Comparison, compare_pairs
from harness.score.reference import Reference
from harness.score.rows import ScoreRows
from harness.score.score import Scores
from harness.score.verdicts import ERROR_TYPES
from tests.records import answers, frame_record, labels, score, subject_record, target_record

TRUTH = [name for _ in range(30) for name in ("cup",) * 60 + ("book",) * 60]
"""Looks of 60 frames, far longer than what is joined."""


def _scores(
    right: Mapping[str, float],
    clips: int = 1,
    factors: Mapping[str, Mapping[str, str]] | None = None,
    truth: Sequence[str] = TRUTH[: 120 * 6],
) -> Scores:
    """Scores of configurations that are right in this share of each look, less by 2 % from clip to clip."""
    names = [f"clip {k}" for k in range(clips)]
    records = []
    for k, clip in enumerate(names):
        for configuration, share in right.items():
            given = [name if i % 60 < 60 * share * (1 - 0.02 * k) else "vase" for i, name in enumerate(truth)]
            records += answers(given, configuration=configuration, clip=clip)
    reference = Reference(labels={clip: labels(*truth) for clip in names}, factors=factors or {})
    return score(records, reference)


def _said(right: Mapping[str, float], **how: Any) -> list[str]:
    """The verdict on them."""
    lines = verdict_lines(_scores(right, **how))
    assert 1 <= len(lines) <= MOST_LINES
    return lines


def test_tables_page_and_terminal_share_one_comparison_of_each_pair(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[list[tuple[str, str]]] = []

    def counted(frames: Any, pairs: Iterable[tuple[str, str]]) -> tuple[Comparison, ...]:
        compared.append([*pairs])
        return compare_pairs(frames, compared[-1])

    monkeypatch.setattr("harness.score.comparison.compare_pairs", counted)
    right = {"bm-one": 0.5, "bm-two": 0.7, "sgbm-one": 0.5, "sgbm-two": 0.7}
    for factors, pairs in ((None, [6]), (_factors(*right), [1, 1, 6])):  # of a grid: those of each factor, too
        compared.clear()
        scores = _scores(right, factors=factors)
        tables = run_tables(scores)
        assert verdict_lines(scores) == verdict_lines(scores) != []
        assert sorted(map(len, compared)) == pairs
        assert (len(tables["comparisons"].rows), len(tables["factors"].rows)) == (6, sum(pairs) - 6)


def test_the_answer_comes_first_then_the_baseline_then_each_factor_then_the_next_step() -> None:
    right = {"bm-one": 0.5, "bm-two": 0.7, "sgbm-one": 0.5, "sgbm-two": 0.7}
    best, baseline, matcher, cones, step = _said(right, factors=_factors(*right))
    assert best.startswith("Best of 4 (2 equally good): bm-two, right in 70.0 % ")
    assert "simple rule" in baseline
    assert matcher.startswith("stereo.matcher: bm or sgbm, no difference: ")
    assert cones.startswith("attention.cones_cm: two beats one by 20.0 points")
    assert step.startswith("Next (its errors: 100 % missed): ")


def test_what_to_try_next_is_told_by_the_errors_of_the_best_configuration() -> None:
    """A grid of cones has many that are too narrow; wider ones than the best one's would not help it."""
    truth = ["cup"] * 60
    narrow = answers([None] * 60, configuration="narrow")
    best = answers(["cup"] * 58 + ["vase"] * 2, configuration="best")
    scores = score([*narrow, *best], Reference(labels={"clip": labels(*truth)}))
    assert [line for line in verdict_lines(scores) if line.startswith("2 of 2 wrong frames of best are ")] != []
    assert [line for line in verdict_lines(scores) if "no_hit" in line] == []


def _with_rows(scores: Scores, **changes: Any) -> Scores:
    """The scores with some values of their rows over all clips changed."""
    rows = ScoreRows(scores.judged_subjects)
    rows.overall = tuple(replace(row, **changes) for row in scores.rows.overall)
    return replace(scores, rows=rows)


@pytest.mark.parametrize(("nearest", "said"), [(0.0, "The simple rules are right in none"), (0.4, "commonest label")])
def test_rules_are_right_in_none_of_the_frames_only_if_each_is(nearest: float, said: str) -> None:
    """Among some of the frames, the rule that is best on all of them may be right in none."""
    scores = _scores({"default": 0.5}, truth=TRUTH[:120])
    rates = {**dict.fromkeys(BASELINES, 0.0), "nearest": nearest, "constant": 1.0}
    assert said in verdict_lines(_with_rows(scores, baselines=rates, best_baseline="commonest"))[1]


@pytest.mark.parametrize(("of_labels", "is_said"), [(0.857, True), (0.5, True), (0.499, False)])
@pytest.mark.parametrize("rule", [name for name in BASELINES if name != "constant"])
def test_a_constant_answer_that_is_as_good_is_told_beside_the_rule_that_is_beaten(
    rule: str, of_labels: float, is_said: bool
) -> None:
    """Where a person looks at nothing most of the time, a method may beat every rule that saw no labels."""
    scores = _scores({"default": 0.5}, truth=TRUTH[:120])
    rates = {**dict.fromkeys(BASELINES, 0.0), rule: 0.122, "constant": of_labels}
    for beats in ("yes", "not shown", "no"):
        line = verdict_lines(_with_rows(scores, baselines=rates, best_baseline=rule, beats=beats))[1]
        assert "12.2 %" in line
        assert (f"{100 * of_labels:.1f} %" in line) == is_said


def test_too_few_looks_for_an_interval_are_told() -> None:
    truth = ["cup"] * 20
    given = {"truth-60deg": truth, "truth-90deg": truth, **{f"sgbm-{n}": ["vase"] * 20 for n in range(11)}}
    records = [record for name, each in given.items() for record in answers(each, configuration=name)]
    best = verdict_lines(score(records, Reference(labels={"clip": labels(*truth)})))[0]
    assert best.startswith("Best of 13 (2 equally good): truth-60deg, right in 100.0 % of the frames (too few")


@pytest.mark.parametrize("configurations", [("default",), ("a", "b")])
@pytest.mark.parametrize("error_type", ERROR_TYPES)
def test_errors_of_any_number_are_told_in_a_line(
    error_type: str, configurations: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    scores = _scores(dict.fromkeys(configurations, 0.5), truth=TRUTH[:120])
    many = Counter({error_type: 123_456, "no_subject": 99_999})
    monkeypatch.setattr(verdict, "_error_types", lambda *_: many)
    lines = verdict_lines(scores)
    assert [line for line in lines if f"{max(many.values())} of {many.total()}" in line and error_type in line] != []


def test_the_tests_of_the_factors_and_all_steps_are_in_the_tables() -> None:
    right = {"bm-one": 0.5, "bm-two": 0.7, "sgbm-one": 0.5, "sgbm-two": 0.7}
    scores = _scores(right, factors=_factors(*right))
    rows = factors_table(scores).rows
    assert [row[:4] for row in rows] == [
        ("sgbm", "bm", "identical on 720 frames", "+0.0"),
        ("two", "one", "better", "+20.0"),
    ]
    assert factors_table(_scores(right)).rows == ()
    assert set(next_steps(scores, right)) <= set(error_types_table(scores).notes)


def test_a_factor_of_three_labels_is_told_from_its_best_one() -> None:
    right = {
        f"{matcher}-{cones}": share
        for matcher in ("bm", "sgbm")
        for cones, share in zip("abc", (0.5, 0.7, 0.7), strict=True)
    }
    lines = _said(right, factors=_factors(*right))
    assert lines[3].startswith("attention.cones_cm: b beats 1 of 2 others by 20.0 points; over the rest, ")


def test_configurations_scored_on_different_clips_are_not_compared() -> None:
    records = [*answers(TRUTH[:240], configuration="a", clip="x"), *answers(TRUTH[:240], configuration="b", clip="y")]
    lines = verdict_lines(score(records, Reference(labels={clip: labels(*TRUTH[:240]) for clip in "xy"})))
    assert "a or b, no frame is scored for both." in lines


def test_names_by_hand_are_no_grid() -> None:
    lines = _said({"bm-one": 0.5, "bm-two": 0.7, "sgbm-one": 0.5, "sgbm-two": 0.7})
    assert lines[2] == "bm-two beats bm-one by 20.0 and sgbm-one by 20.0 points."
    assert lines[3].startswith("bm-two or sgbm-two, no difference: ")


def test_a_grid_of_many_factors_lists_those_that_differ_and_the_largest_possible_difference_of_the_others() -> None:
    right = {
        "-".join(place): 0.5 + 0.2 * (place[1] == "two") + 0.02 * ((place[0] == "bm") != (place[2] == "x"))
        for place in product(("bm", "sgbm"), ("one", "two"), ("x", "y"))
    }
    lines = _said(right, factors=_factors(*right))
    assert "attention.cones_cm (two: 20.0 points)" in lines[2]
    assert lines[3].count("stereo.matcher, attention.method ") == 1
    assert float(re.findall(r"at most ([\d.]+) points", lines[3])[0]) > 0


@pytest.mark.parametrize("shares", [{"one": 0.5}, {"a": 0.5, "b": 0.9}, {f"number-{k}": k / 12 for k in range(12)}])
def test_the_best_of_any_number_of_configurations_is_named_with_its_rate(shares: dict[str, float]) -> None:
    best = max(shares, key=lambda name: shares[name])
    first, *_ = _said(shares)
    assert best in first
    assert f"{100 * (math.ceil(60 * shares[best]) / 60):.1f} %" in first


def test_a_difference_that_is_not_shown_is_told_with_the_largest_possible_one() -> None:
    right = {"bm-one": 0.5, "bm-two": 0.52, "sgbm-one": 0.52, "sgbm-two": 0.5}
    factors = _factors(*right)
    scores = _scores(right, factors=factors)
    frames = {name: scores.frames_of(name) for name in right}
    lines = verdict_lines(scores)
    for line, (comparison,) in zip(lines[2:4], compare_factors(frames, factors).values(), strict=True):
        assert not comparison.is_identical  # equal sums over a grid are not
        assert " or ".join(comparison.names) in line
        assert f" {100 * max(-comparison.interval.low, comparison.interval.high):.1f} points" in line


def test_too_few_units_are_counted() -> None:
    truth = ("cup",) * 120 + ("book",) * 120
    lines = _said({"a": 0.5, "b": 0.6}, truth=truth)
    assert lines[2] == "a or b, 2 joined looks cannot show a difference (10.0 points seen)."


@pytest.mark.parametrize(("clips", "scope"), [(1, "these clips only"), (6, "clips like these")])
def test_an_interval_says_what_it_is_valid_for(clips: int, scope: str) -> None:
    assert scope in _said({"a": 0.5, "b": 0.9}, clips=clips)[0]


def test_one_configuration_is_told_why_it_is_wrong_and_what_to_try() -> None:
    best, _, why, step = _said({"one": 0.9})
    assert best.startswith("one is right in 90.0 % ")
    assert why.startswith("72 of 72 ")
    assert step.startswith("Next: ")


def test_nothing_wrong_leaves_nothing_to_try() -> None:
    assert [line for line in _said({"a": 1.0, "b": 1.0}) if line.startswith("Next")] == []


def test_without_labels_nothing_is_claimed() -> None:
    (line,) = verdict_lines(score(answers(["cup"]), Reference(labels={})))
    assert line.startswith("Nothing is scored")


def _factors(*names: str) -> dict[str, dict[str, str]]:
    return {
        name: dict(zip(("stereo.matcher", "attention.cones_cm", "attention.method"), name.split("-"), strict=False))
        for name in names
    }


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
    things = [target_record(1, "bird"), target_record(2, "cup")]
    totals = {"missed": {2: 0.5}, "outscored": {1: 0.1, 2: 0.5}, "right": {1: 0.5, 2: 0.1}}
    types = ["missed"] * 3 + ["outscored"] * 2 + ["no_subject"] * 3 + ["right"] * 9
    records = [
        frame_record(
            things,
            [subject_record("girl", totals=totals[each], focus=1 if each == "right" else 2)] if each in totals else [],
            frame=frame,
        )
        for frame, each in enumerate(types, start=1)
    ]
    found = next_steps(score(records, Reference(labels={"clip": labels(*["bird"] * len(types))})), ("one",))
    assert [line.split(" (")[0] for line in found] == ["3 of 8 wrong frames: no_subject", "3 of 8 wrong frames: missed"]
    assert all("Next: " in line for line in found)


def test_a_run_without_recordings_is_advised_to_make_some() -> None:
    reference = Reference(labels={"clip": labels("cup", "cup")}, is_recorded=False)
    scores = score(answers(["cup", "dragon"]), reference)
    assert "(in a run with --recording light)" in verdict_lines(scores)[-1]


def test_on_the_terminal_the_command_to_view_a_run_names_its_folder() -> None:
    scores = score(answers(["cup", "dragon"]), Reference(labels={"clip": labels("cup", "cup")}, is_recorded=True))
    assert "(vfoa view runs/mine --failures)" in verdict_of_run(scores, Path("runs/mine"))[-1]
    assert "(vfoa view 'my runs/1' --failures)" in verdict_of_run(scores, Path("my runs/1"))[-1]
    assert "(vfoa view RUN --failures)" in verdict_lines(scores)[-1]


@pytest.mark.parametrize("folder", ["runs/mine", "runs/of my own", "runs/" + 9 * "long name "])
def test_a_command_in_the_verdict_stays_in_one_line_of_the_terminal(
    folder: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    scores = score(answers(["cup", "dragon"]), Reference(labels={"clip": labels("cup", "cup")}, is_recorded=True))
    print_scores(scores, Path(folder))
    lines = capsys.readouterr().out.splitlines()
    command = f"({shlex.join(['vfoa', 'view', folder, '--failures'])})"
    assert [line for line in lines if command in line]
    assert all(len(line) <= 80 for line in lines if folder not in line)


def test_a_command_in_a_note_stays_in_one_line_of_the_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    print_scores(score(answers(["cup"], clip="street"), Reference(labels={})), Path("run"))
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if "`vfoa annotate street`" in line]
    assert all(len(line) <= 60 for line in lines)


@pytest.mark.parametrize("columns", range(20, 32))
def test_a_percentage_stays_in_one_line_of_the_terminal(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    print_scores(score(answers(["cup"]), Reference(labels={"clip": labels("cup")})), Path("run"))
    lines = capsys.readouterr().out.splitlines()
    assert any("100.0 %" in line for line in lines)
    assert not [line for line in lines if line.startswith("%")]


def test_nothing_wrong_needs_no_next_step() -> None:
    assert next_steps(score([], Reference(labels={})), ("one",)) == []
