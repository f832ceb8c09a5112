"""Tables of comparisons, and published figures beside those of a run."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from harness.report.comparisons import (
    comparison_table,
    plan_pairs,
    plan_sentence,
    plan_table,
    published_table,
    terminal_comparisons,
)
from harness.report.formats import UNKNOWN
from harness.run.experiment import load_experiment
from harness.run.manifest import Published
from harness.score.comparison import Comparison
from harness.score.reference import Reference
from harness.score.score import Scores
from harness.score.statistics import NO_INTERVAL, Interval
from tests.disk import write_text
from tests.records import answers, labels, score, texts_of
from vfoa.errors import VfoaError


def _pair(configuration: str, reference: str, *, better: int = 0, worse: int = 0, p: float = 1.0) -> Comparison:
    return Comparison(
        reference=reference,
        configuration=configuration,
        n=40,
        looks=8,
        clips=2,
        better=better,
        worse=worse,
        difference=(better - worse) / 40,
        interval=Interval(low=-0.1, high=0.1, unit="look"),
        unit="look",
        p=p,
        p_holm=p,
        family=1,
        detectable=0.1,
    )


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (("runs/demo/bm", "runs/demo/sgbm"), ("bm", "sgbm")),
        (("runs/demo-2/bm", "runs/demo/bm"), ("demo-2/bm", "demo/bm")),
        (("/far/run/bm", "near/bm"), ("/far/run/bm", "near/bm")),
        (("bm", "bm-2"), ("bm", "bm-2")),
    ],
)
def test_only_folders_that_all_names_share_are_left_out(names: tuple[str, str], shown: tuple[str, str]) -> None:
    assert terminal_comparisons([_pair(*names)]).rows[0][:2] == shown


def test_a_single_unit_is_not_several() -> None:
    units = [("look", 1, 1), ("look", 9, 1), ("clip", 9, 1), ("clip", 9, 7)]
    pairs = [replace(_pair("a", "b"), unit=unit, looks=looks, clips=clips) for unit, looks, clips in units]
    assert [row[5] for row in terminal_comparisons(pairs).rows] == ["1 look", "9 looks", "1 clip", "7 clips"]


def test_what_is_significant_says_in_which_direction() -> None:
    pairs = [
        _pair("a", "b", better=9, worse=0, p=0.004),
        _pair("a", "c", better=0, worse=9, p=0.004),
        _pair("a", "d", better=2, worse=1, p=1.0),
    ]
    assert [row[2] for row in terminal_comparisons(pairs).rows] == ["better", "worse", "not told apart"]


def test_configurations_without_a_common_frame_are_not_said_to_be_alike() -> None:
    apart = [replace(_pair("a", "b"), n=0, difference=math.nan, interval=NO_INTERVAL)]
    assert terminal_comparisons(apart).rows[0][2:5] == ("no common frame", UNKNOWN, UNKNOWN)


def test_notes_explain_columns_that_are_there() -> None:
    pairs = [_pair("b", "a", better=9)]
    for table, counts in ((comparison_table(pairs), True), (terminal_comparisons(pairs), False)):
        assert ("Better" in table.columns, any("Better" in note for note in table.notes)) == (counts, counts)


def test_identical_configurations_have_no_interval() -> None:
    (row,) = terminal_comparisons([replace(_pair("a", "b"), is_identical=True, interval=NO_INTERVAL)]).rows
    assert row[2:5] == ("identical on 40 frames", "+0.0", UNKNOWN)


@pytest.fixture(scope="module")
def pilot() -> Scores:
    """Eight clips of twelve looks of ten frames: c is right as often as a, and b on more frames of later clips."""
    truth = [name for _ in range(6) for name in ("cup",) * 10 + ("book",) * 10]
    records = []
    for clip in range(8):
        for configuration, right in {"a": 5, "b": 3 + clip % 5, "c": 5}.items():
            said = [name if frame % 10 < right else "vase" for frame, name in enumerate(truth)]
            records += answers(said, configuration=configuration, clip=f"clip {clip}")
    return score(records, Reference(labels={f"clip {clip}": labels(*truth) for clip in range(8)}))


def test_a_plan_begins_with_the_pair_that_needs_most(pilot: Scores) -> None:
    planned = plan_pairs(pilot, 0.05)
    assert [each.names for each in planned] == [("a", "b"), ("a", "c"), ("b", "c")]
    clips = planned[0].clips
    assert clips is not None
    first, _, assumed = plan_sentence(planned, 0.05).partition(": ")
    assert first == f"{clips.needed} clips ({clips.fewest} to {clips.most}"
    assert "5 points between any two configurations with a probability of 80 %" in assumed
    assert "assuming that clips differ as the 8 of this run do" in assumed
    rows = {row[:2]: row[2:4] for row in plan_table(planned, 0.05).rows}
    assert rows["b", "a"] == (str(clips.needed), f"{clips.fewest} to {clips.most}")


def test_a_plan_for_identical_configurations_is_not_known(pilot: Scores) -> None:
    planned = plan_pairs(pilot, 0.05)
    table = plan_table(planned, 0.05)
    assert [row[2:5] for row in table.rows if row[:2] == ("c", "a")] == [(UNKNOWN,) * 3]
    assert "c vs a: identical on 960 frames, so that their spread is not known." in table.notes
    assert plan_sentence(planned[1:2], 0.05).startswith("How many clips it takes is not known")


PAPER = Published.model_validate({"source": "Somebody, 2022", "counts": {"one": {"correct": 28, "n": 50}}})


def scored(correct: int, published: Published | None = PAPER):
    said = ["bird"] * correct + ["none"] * (50 - correct)
    return score(answers(said), Reference(labels={"clip": labels(*["bird"] * 50)}, published=published))


def test_the_same_counts_are_no_different() -> None:
    (row,) = published_table(scored(28)).rows
    assert row == ("one", "56.0", "42–69", "56.0", "42–69", "+0.0", "1")


def test_fishers_test_of_a_written_out_table() -> None:
    """Ours 3 of 3, theirs 0 of 3: one table of twenty is as extreme on either side."""
    theirs = Published.model_validate({"source": "-", "counts": {"one": {"correct": 0, "n": 3}}})
    ours = score(answers(["bird"] * 3), Reference(labels={"clip": labels(*["bird"] * 3)}, published=theirs))
    assert published_table(ours).rows[0][-1] == "0.1"


def test_the_tables_have_both_rates_and_their_distance() -> None:
    page = texts_of(scored(38))["frr.md"]
    (line,) = [line for line in page.splitlines() if line.startswith("| one") and "+20.0" in line]
    assert [cell.strip() for cell in line.split("|")[1:-1]][:6] == ["one", "56.0", "42–69", "76.0", "63–86", "+20.0"]
    assert "Somebody, 2022" in page
    assert "published" not in texts_of(scored(38, None))["frr.md"]


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        ("bm-on = { correct = 28, n = 50 }", "no configuration 'bm-on'; did you mean 'bm-one'?"),
        ("bm-one = { correct = 51, n = 50 }", "found 51 correct of 50"),
        ("bm-one = { correct = 5, n = 0 }", "published.counts.bm-one.n"),
    ],
)
def test_a_wrong_count_is_said_by_file_and_key(tmp_path: Path, counts: str, expected: str) -> None:
    text = (Path("harness/experiments/demo.toml")).read_text()
    path = write_text(tmp_path / "mine.toml", f'{text}\n[published]\nsource = "x"\n[published.counts]\n{counts}\n')
    with pytest.raises(VfoaError) as refused:
        load_experiment(str(path))
    assert expected in str(refused.value)
    assert "mine.toml" in str(refused.value)


@pytest.mark.parametrize("name", ["paper", "bandage_2"])
def test_the_papers_counts_stand_beside_the_runs_on_its_clip(name: str) -> None:
    published = load_experiment(name).published
    assert published is not None
    assert {each: count.correct for each, count in published.counts.items()} == {
        "bm-one": 28,
        "bm-two": 31,
        "sgbm-one": 35,
        "sgbm-two": 38,
    }
