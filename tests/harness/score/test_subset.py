"""``--where``: a finished run scored on some of its labelled frames."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from harness.files.io import atomic_write
from harness.report.tables import remarks
from harness.report.thumbnails import Thumbnail, lines_path, picture_path
from harness.run.directory import RunDirectory
from harness.run.records import FrameRecord, Vector
from harness.score.finished_run import read_scores
from harness.score.subset import Condition, conditions_of, measured_distances
from tests.command import vfoa
from tests.records import (
    answers,
    columns_by_pair,
    frame_record,
    labels,
    subject_record,
    target_record,
    write_clip,
    write_manifest,
    write_run,
)
from vfoa.errors import VfoaError

TRUTH = ("cup", "book", "cup", "none", "cup", "book")
TAGS = ("", "far occluded", "far", "", "", "")
NOTES = ("far", "far child", "", "", "childlike", "")
SAID = {"one": ("cup", "cup", "book", "cup", "cup", "book"), "two": ("cup", "book", "cup", "cup", "book", "book")}


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Two clips of six frames at 25 frames a second, the first at 0.04 s, under two configurations."""
    clips = [write_clip(tmp_path, clip, TRUTH, NOTES, TAGS) for clip in ("a", "b")]
    said = [answers(names, clip=clip, configuration=name) for clip in ("a", "b") for name, names in SAID.items()]
    return write_run(tmp_path / "run", (record for of_pair in said for record in of_pair), clips=clips).path


@pytest.mark.parametrize(
    ("conditions", "frames"),
    [
        (["target=cup"], [1, 3, 5]),
        (["target=cup|none"], [1, 3, 4, 5]),
        (["target!=cup"], [2, 4, 6]),
        (["note=child"], [2]),  # a word, and no part of one
        (["note!=far"], [3, 4, 5, 6]),
        (["tag=far"], [2, 3]),
        (["tag=occluded"], [2]),
        (["tag!=occluded", "tag=far|occluded"], [3]),
        (["distance<1.5", "target=none"], [4]),
        (["target_distance>=1"], [1, 2, 3, 5, 6]),  # nothing is at a distance in a frame without a true target
        (["subject=girl"], [1, 2, 3, 4, 5, 6]),
        (["time>=0.08"], [3, 4, 5, 6]),  # since the first frame, whatever the clip's clock says
        (["time<0.08"], [1, 2]),
        (["frame>2", "frame<=5", "target = cup"], [3, 5]),
        (["from_change<0.1"], [1, 2, 3, 4, 5, 6]),
    ],
)
def test_only_frames_that_meet_all_conditions_are_scored(run: Path, conditions: list[str], frames: list[int]) -> None:
    scores = read_scores(RunDirectory(run), [Condition.parse(text) for text in conditions])
    scored: dict[tuple[str, str], list[int]] = {(v.clip, v.configuration): [] for v in scores.verdicts}
    for verdict in scores.verdicts:
        if verdict.outcome != "unscored":
            scored[verdict.clip, verdict.configuration].append(verdict.frame)
    assert scored == dict.fromkeys([("a", "one"), ("a", "two"), ("b", "one"), ("b", "two")], frames)
    for row in scores.rows.overall:
        within = [SAID[row.configuration][frame - 1] == TRUTH[frame - 1] for frame in frames]
        assert (row.n, row.correct) == (2 * len(frames), 2 * sum(within))


def test_a_condition_on_the_target_tells_no_baseline_the_answer(run: Path) -> None:
    """A rule that is fitted to frames of one target alone would always be right: nothing could beat it."""

    def right_frames(*conditions: str) -> dict[str, float]:
        scores = read_scores(RunDirectory(run), [Condition.parse(text) for text in conditions])
        row = scores.rows.overall[0]
        return {name: rate * row.n for name, rate in row.baselines.items()}

    parts = [right_frames(f"target={target}") for target in ("cup", "book", "none")]
    assert parts[1]["commonest"] == parts[1]["constant"] == 0
    assert {name: sum(part[name] for part in parts) for name in parts[0]} == pytest.approx(right_frames())


def test_the_best_baseline_is_that_of_all_labelled_frames(tmp_path: Path) -> None:
    """On looks at the book alone, the rule that always finds the book would be the best one, with 100 %."""
    clips = [write_clip(tmp_path, clip, ("cup", "cup", "cup", "book")) for clip in ("a", "b")]
    records = [record for clip in ("a", "b") for record in answers(["cup", "book", "cup", "book"], clip=clip)]
    directory = write_run(tmp_path / "run", records, clips=clips)
    for where in ([], [Condition.parse("target=book")]):
        scores = read_scores(directory, where)
        assert {row.best_baseline for row in scores.rows} == {"commonest"}
    (row,) = scores.rows.overall
    assert (row.frr, row.baselines["nearest"], row.baselines["commonest"], row.beats) == (1, 1, 0, "not shown")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", []),
        ("target=cup, time<5,", ["target=cup", "time<5"]),
        ("target=cup, red|mug, tag!=far,, frame >= 3", ["target=cup, red|mug", "tag!=far", "frame >= 3"]),
    ],
)
def test_a_comma_in_a_name_is_part_of_its_condition(text: str, parts: list[str]) -> None:
    assert [condition.text for condition in conditions_of(text)] == parts


LOOKS = ("cup",) * 5 + ("book",) * 6 + ("ignore",) * 2 + ("book",) * 4 + ("none",) * 4
"""Changes at 0.22 s, and at 0.70 s; between them nobody has labelled two frames."""


@pytest.mark.parametrize(
    ("condition", "frames"),
    [
        ("from_change>0.09", [1, 2, 3, 8, 9, 10, 11, 14, 15, 20, 21]),
        ("from_change<0.03", [5, 6, 17, 18]),
        ("from_change>10", []),
    ],
)
def test_frames_near_a_change_of_the_label_are_left_out(tmp_path: Path, condition: str, frames: list[int]) -> None:
    """People mark changes up to half a second late, and annotators disagree there."""
    clips = [write_clip(tmp_path, "a", LOOKS)]
    of_clip = write_run(tmp_path / "run", answers(["cup"] * len(LOOKS), clip="a"), clips=clips)
    if not frames:
        with pytest.raises(VfoaError, match="no labelled frame of the run meets this"):
            read_scores(of_clip, [Condition.parse(condition)])
        return
    scores = read_scores(of_clip, [Condition.parse(condition)])
    assert [verdict.frame for verdict in scores.verdicts if verdict.outcome != "unscored"] == frames


@pytest.mark.parametrize(
    ("condition", "frames"),
    [("from_change>0.07", [1, 7, 13]), ("from_change<0.07", [3, 5, 9, 11])],
)
def test_labels_that_are_sparser_than_the_frames_change_as_well(
    tmp_path: Path, condition: str, frames: list[int]
) -> None:
    """Every other frame of 0.04 s is labelled: the label changes at 0.12 s and at 0.36 s after the first frame."""
    targets = [name for target in ("cup",) * 2 + ("book",) * 3 + ("none",) * 2 for name in (target, "ignore")]
    clips = [write_clip(tmp_path, "a", targets)]
    of_clip = write_run(tmp_path / "run", answers(["cup"] * 14, clip="a"), clips=clips)
    scores = read_scores(of_clip, [Condition.parse(condition)])
    assert [verdict.frame for verdict in scores.verdicts if verdict.outcome != "unscored"] == frames


def test_a_bar_in_a_name_is_written_with_a_backslash(tmp_path: Path) -> None:
    """Without one, it separates names; blanks around it belong to none."""
    clips = [write_clip(tmp_path, "a", ("cup|lid", "cup", "lid", "none"))]
    directory = write_run(tmp_path / "run", answers(["cup"] * 4, clip="a"), clips=clips)
    for text, count in (("target=cup\\|lid", 1), ("target=cup | lid", 2), ("target!=cup\\|lid|none", 2)):
        (row, *_) = read_scores(directory, [Condition.parse(text)]).rows
        assert row.n == count
    with pytest.raises(VfoaError, match=r"target 'mug': .*none; a \| in a name is written \\\|"):
        read_scores(directory, [Condition.parse("target=cup|mug")])


def test_one_clip_of_several(run: Path) -> None:
    scores = read_scores(RunDirectory(run), [Condition.parse("clip!=a")])
    assert {row.clip for row in scores.rows} == {"b"}
    assert str(scores.notes[-1]) == "Only frames with clip!=a."


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("target", "--where: found 'target';"),
        ("targets=cup", "--where: found 'targets' in 'targets=cup'"),
        ("target<3", r"--where: found 'target<3'; expected"),
        ("time=3", r"--where: found 'time=3'; expected"),
        ("time>soon", r"--where: found 'time>soon'; expected"),
        ("target=cop", r"--where: target 'cop': .*'cup'"),
        ("tag=fur", r"--where: tag 'fur': .*'far'"),
        ("distance>1.01", r"--where distance>1\.01: .*; distance is 1.0 to 1.0$"),
        ("frame>99", "--where frame>99: .*; frame is 1 to 6$"),
        ("time>=0.25", r"--where time>=0\.25: .*; time is 0\.0 to 0\.2$"),
    ],
)
def test_a_wrong_condition_is_one_line(run: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message) as error:
        read_scores(RunDirectory(run), [Condition.parse(text)])
    assert "\n" not in str(error.value)


def test_distances_are_medians_over_the_configurations_that_measured_them() -> None:
    def record(configuration: str, eyes: Vector | None, centers: Sequence[Vector]) -> FrameRecord:
        things = [target_record(number, "cup", center=center) for number, center in enumerate(centers)]
        return frame_record(things, [subject_record("girl", eyes=eyes)], configuration=configuration)

    records = [
        record("a", (0.0, 0.0, 2.0), [(0.0, 3.0, 2.0), (0.0, 1.0, 2.0)]),
        record("b", (3.0, 0.0, 4.0), []),
        record("c", (0.0, 0.0, 3.0), [(0.0, 0.0, 6.0)]),
        record("d", None, [(0.0, 0.0, 6.0)]),
    ]
    assert measured_distances(columns_by_pair(records), {"clip": labels("cup")}) == {("clip", 1, "girl"): (3.0, 2.0)}


def test_times_that_a_run_lacks_are_asked_for(run: Path) -> None:
    directory = RunDirectory(run)
    manifest = directory.read_manifest().plain()
    for clip in manifest["clips"]:
        del clip["times_ns"]
    write_manifest(directory, manifest)
    with pytest.raises(VfoaError, match="--where: time: the run has no times of a"):
        read_scores(directory, [Condition.parse("time>1")])


def test_a_clip_without_such_frames_is_not_called_unlabelled(run: Path) -> None:
    scores = read_scores(RunDirectory(run), [Condition.parse("clip=a")])
    texts = [note.text for note in remarks(scores)]
    assert "b: no labelled frame meets the conditions, not scored." in texts
    assert not [text for text in texts if "vfoa annotate" in text or (text.startswith("a:") and "not scored" in text)]


def test_score_prints_the_subset_and_writes_nothing(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    code, out, err = vfoa(monkeypatch, capsys, "score", str(run), "--where", "target=cup", "--where", "frame<5")
    assert (code, err) == (0, "")
    assert "Only frames with target=cup and frame<5." in out
    cells = [line.split()[:3] for line in out.splitlines() if line.split()[:1] in (["one"], ["two"])]
    assert cells[:2] == [["one", "4", "50.0"], ["two", "4", "100.0"]]
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before


def test_report_writes_the_page_of_these_frames_to_a_file_of_its_own(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("harness.report.write.BUDGET_BYTES", 0)
    for clip in ("a", "b"):
        seen = Thumbnail(frame=3, size=(2, 2), boxes=[], subjects=[])
        atomic_write(lines_path(run, clip, "one"), msgspec.json.encode(seen) + b"\n")
        atomic_write(picture_path(run, clip, 3), b"a picture")
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    page = tmp_path / "pages" / "few.html"
    page.parent.mkdir()
    where = ("report", str(run), "--where", "target=cup", "--where", "frame<5")
    assert vfoa(monkeypatch, capsys, *where, "--page", str(page))[:2] == (0, f"Page: {page}\n")
    text = page.read_text(encoding="utf-8")
    assert "Only frames with target=cup,frame&lt;5" in text
    assert "n = 4 labelled frames" in text
    assert '"pictures":"../run/thumbnails"' in text  # it has room for one of two
    assert {path: path.read_bytes() for path in run.rglob("*") if path.is_file()} == before
    code, _, err = vfoa(monkeypatch, capsys, *where)
    assert (code, err.count("\n"), "--page" in err) == (2, 1, True)
    assert vfoa(monkeypatch, capsys, *where, "--page", str(page))[0] == 2  # not replaced unasked
    assert vfoa(monkeypatch, capsys, *where, "--page", str(page), "--serve")[0] == 2


def test_compare_counts_these_frames_only(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = vfoa(monkeypatch, capsys, "compare", str(run), "--where", "target=cup", "--json")
    assert code == 0
    (row,) = json.loads(out)["comparisons"]
    assert (row["n"], row["better"], row["worse"]) == (6, 2, 2)
