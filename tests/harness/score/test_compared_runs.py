"""Runs side by side: which configurations are compared, their order, and the frames that changed their verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from harness.report.compared_runs import changes_table, compared_lines, ranking_table
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.score.compared_runs import ComparedRuns, compare_runs
from tests.disk import write_text
from tests.records import answers, write_clip, write_run
from vfoa.errors import VfoaError

TRUTH = ["cup"] * 6 + ["can"] * 6


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def _right(*frames: int) -> list[str]:
    """Answers that are right in these of the frames 1 to 12; elsewhere "looks at nothing" of a label that says so."""
    return [name if frame in frames else "none" for frame, name in enumerate(TRUTH, start=1)]


def _run(name: str, answered: Mapping[str, Sequence[str]]) -> Path:
    """A finished run of one clip with these answers of each configuration."""
    clip = write_clip(Path.cwd(), "table", TRUTH)
    records = [
        record
        for configuration, said in answered.items()
        for record in answers(said, clip="table", configuration=configuration)
    ]
    return write_run(Path(name), records, clips=[clip], notes=[]).path


ALL = range(1, 13)


def _named(compared: ComparedRuns) -> list[tuple[str, str]]:
    return [comparison.names for comparison in compared.comparisons]


def test_configurations_of_the_same_name_are_compared_and_stand_together() -> None:
    for run in "abc":
        _run(run, {"one": _right(*ALL), "two": _right(1, 2)})
    compared = compare_runs([Path(run) for run in "abc"])
    assert _named(compared) == [
        (f"{first}/{name}", f"{second}/{name}")
        for name in ("one", "two")
        for first, second in (("a", "b"), ("a", "c"), ("b", "c"))
    ]
    assert {comparison.family for comparison in compared.comparisons} == {6}


def test_configurations_of_one_run_are_compared_with_each_other() -> None:
    run = _run("a", {"one": _right(*ALL), "two": _right(1), "three": _right(2)})
    assert _named(compare_runs([run])) == [("a/one", "a/two"), ("a/one", "a/three"), ("a/two", "a/three")]


def test_runs_without_a_common_name_are_compared_in_all_pairs() -> None:
    runs = [_run("a", {"one": _right(*ALL)}), _run("b", {"two": _right(1)})]
    assert _named(compare_runs(runs)) == [("a/one", "b/two")]


def test_a_configuration_of_one_run_alone_is_ranked_and_named_as_not_compared() -> None:
    runs = [_run("a", {"one": _right(1, 2)}), _run("b", {"one": _right(*ALL), "more": _right(*range(1, 7))})]
    compared = compare_runs(runs)
    assert compared.uncompared == ["b/more"]
    table = ranking_table(compared)
    assert [(row[0], row[1], row[3]) for row in table.rows] == [
        ("b/one", "100.0", "12"),
        ("b/more", "50.0", "12"),
        ("a/one", "16.7", "12"),
    ]
    assert "In one run only, so ranked and not compared: b/more." in table.notes


def test_equal_runs_are_said_to_be_identical() -> None:
    for run in "ab":
        _run(run, {"one": _right(*ALL), "two": _right(1, 2)})
    identical, best = compared_lines(compare_runs([Path("a"), Path("b")]))
    assert identical == "a and b: identical on 24 frames of 2 configurations."
    assert best.startswith("Best of 4 (2 equally good): a/one, right in 100.0 % of the frames")


def test_a_single_configuration_and_a_run_without_labels_are_said_to_have_no_comparison() -> None:
    run = _run("a", {"one": _right(*ALL)})
    alone, best = compared_lines(compare_runs([run]))
    assert "one configuration" in alone
    assert best.startswith("Best of 1: one, right in 100.0 %")
    write_clip(Path.cwd(), "table", ["ignore"] * len(TRUTH))
    (unscored,) = compared_lines(compare_runs([run]))
    assert "no frame has a label" in unscored


def test_a_run_that_differs_in_one_configuration_is_not_identical() -> None:
    _run("a", {"one": _right(*ALL), "two": _right(1, 2)})
    _run("b", {"one": _right(*ALL), "two": _right(1, 3)})
    lines = compared_lines(compare_runs([Path("a"), Path("b")]))
    assert lines[0] == "No significant difference in 2 pairs; 1 identical."


def test_frames_that_changed_are_stretches_with_the_same_answers() -> None:
    before, after = _right(1, 2, 3, 7, 8, 9, 12), _right(1, 5, 6, 7, 8, 9)
    after[2] = "can"
    runs = [_run("a", {"one": before}), _run("b", {"one": after})]
    changes = list(compare_runs(runs).changes())
    assert [(change.frames, change.is_better) for change in changes] == [
        ((2,), False),
        ((3,), False),  # another answer
        ((5, 6), True),
        ((12,), False),
    ]
    first, second, third, last = changes_table(changes, "").rows
    assert first[:9] == ("b/one", "a/one", "worse", "table", "girl", "2", "cup", "cup", "(nothing hit)")
    assert (second[5], second[8], second[9]) == ("3", "can", "missed")
    assert third[2:6] == ("better", "table", "girl", "5–6")
    assert third[-1] == "2"
    assert last[5] == "12"


def test_a_baseline_is_ranked_and_compared_by_name() -> None:
    baseline, other = _run("a", {"one": _right(*ALL), "two": _right(1)}), _run("b", {"two": _right(1, 2)})
    compared = compare_runs([other], baseline)
    assert _named(compared) == [("a/two", "b/two")]
    assert [row.name for row in compared.ranked()] == ["a/one", "b/two", "a/two"]
    assert compared.uncompared == ["a/one"]


def test_runs_that_are_scored_against_other_annotators_are_named() -> None:
    _run("a", {"one": _right(*ALL)})
    clip = write_clip(Path.cwd(), "table", TRUTH)
    theirs = Path("annotations", "table.csv").read_text().replace("1,1,girl,cup", "1,1,girl,none")
    write_text(Path("annotations", "table@anna.csv"), theirs)
    write_run(Path("b"), answers(_right(1, 2), clip="table", configuration="one"), clips=[clip], annotator="anna")
    with pytest.raises(VfoaError, match=r"^a/one and b/one: .*frame 1: .*same labels \(a: the clip's; b: .*'anna'; "):
        compare_runs([Path("a"), Path("b")])


def test_labels_that_changed_since_a_run_was_scored_are_said() -> None:
    for name in "ab":
        _run(name, {"one": _right(*ALL)})
        rescore(RunDirectory(Path(name)))
    assert not any("have changed" in note for note in ranking_table(compare_runs([Path("a"), Path("b")])).notes)
    labels = Path("annotations", "table.csv")
    labels.write_text(labels.read_text().replace("1,1,girl,cup", "1,1,girl,none"))
    rescore(RunDirectory(Path("b")))
    (note,) = (note for note in ranking_table(compare_runs([Path("a"), Path("b")])).notes if "have changed" in note)
    assert note.startswith("a: labels of table have changed")


def test_runs_under_other_numbers_of_seeds_are_named() -> None:
    _run("a", {f"one.seed{seed}": _right(*ALL) for seed in (1, 2)})
    _run("b", {"one": _right(1, 2)})
    with pytest.raises(VfoaError, match=r"^a/one and b/one: found runs under 2 and under 1 seeds; "):
        compare_runs([Path("a"), Path("b")])


def test_a_configuration_that_the_baseline_lacks_is_one_line() -> None:
    baseline, other = _run("a", {"one": _right(*ALL)}), _run("b", {"two": _right(1, 2)})
    with pytest.raises(VfoaError, match=r"^a: .*'two' of b; found one$"):
        compare_runs([other], baseline)
