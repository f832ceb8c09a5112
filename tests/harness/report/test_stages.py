"""Stages against the truth, and their times."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from harness.pipeline.measures import DisparityMeasure, FrameMeasures, PersonMeasure, TargetMeasure
from harness.report.page.render import render_page
from harness.report.stages import object_measures_table, stage_measures_table, stage_times, terminal_measures
from harness.report.write import run_tables
from harness.run.directory import Pair, RunDirectory
from harness.run.records import FrameRecord
from harness.run.timings import join_timings, time_rows
from harness.score.reference import Reference
from harness.score.score import Scores
from tests.disk import write_text
from tests.record_tables import measured as with_measures
from tests.records import answers, labels, run_manifest, score
from vfoa.errors import VfoaError


def measured(record: FrameRecord, *, error_px: float, eyes_m: float | None, box_iou: float | None) -> FrameRecord:
    thing = TargetMeasure(
        truth_id=9, label="cup", instance_id=1, mask_iou=0.5, box_iou=box_iou, center_error_m=0.02 if box_iou else None
    )
    person = PersonMeasure(name="girl", head_box_iou=0.8, eye_error_m=eyes_m, head_error_deg=None, gaze_error_deg=12.0)
    disparity = DisparityMeasure(error_px=error_px, over_2_px=0.1, known=0.75)
    return with_measures(record, FrameMeasures(disparity=disparity, targets=(thing,), people=(person,)))


@pytest.fixture
def scores() -> Scores:
    records = [
        measured(record, error_px=error, eyes_m=eyes, box_iou=iou)
        for clip in ("a", "b")
        for record, error, eyes, iou in zip(
            answers(["mug"] * 3, clip=clip), (0.5, 1.0, 2.5), (0.05, None, 0.07), (0.6, 0.0, 0.3), strict=True
        )
    ]
    return score(records, Reference(labels={clip: labels(*["mug"] * 3) for clip in ("a", "b")}))


def test_medians_shares_and_percentiles_by_clip_and_over_all(scores: Scores) -> None:
    table = stage_measures_table(scores)
    assert [row[:2] for row in table.rows] == [("a", "one"), ("b", "one"), ("(all)", "one")]
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert row["Disparity px"] == "1.00"
    assert (row["Over 2 px %"], row["Known %"]) == ("10.0", "75.0")
    assert (row["Mask IoU"], row["Box IoU"], row["Centre cm"]) == ("0.50", "0.30", "2.0")
    assert (row["Eyes cm"], row["Eyes 95 %"]) == ("6.0", "6.9")
    assert (row["Head deg"], row["Gaze deg"]) == ("–", "12.0")
    assert [row[0] for row in terminal_measures(stage_measures_table(scores), scores).rows] == ["one"]


def test_objects_without_a_true_box_do_not_count_in_the_mean_over_clips() -> None:
    """Sintel has masks and no boxes, rendered clips have both."""
    ious = {"boxes": 0.5, "masks": None}
    records = [
        measured(record, error_px=1.0, eyes_m=None, box_iou=iou)
        for clip, iou in ious.items()
        for record in answers(["mug"] * 3, clip=clip)
    ]
    table = stage_measures_table(score(records, Reference(labels={clip: labels(*["mug"] * 3) for clip in ious})))
    assert [row[table.columns.index("Box IoU")] for row in table.rows] == ["0.50", "–", "0.50"]


def test_a_true_thing_bears_the_runs_own_name_for_it(scores: Scores) -> None:
    assert [row[:4] for row in object_measures_table(scores).rows] == [
        ("a", "mug", "one", "3"),
        ("b", "mug", "one", "3"),
    ]


def test_a_run_that_knows_no_truth_has_no_rows() -> None:
    unknown = score(answers(["mug"]), Reference(labels={"clip": labels("mug")}))
    assert stage_measures_table(unknown).rows == object_measures_table(unknown).rows == ()


def test_the_page_has_every_table_once(scores: Scores) -> None:
    titles = re.findall(
        r"<summary>([^<]*)</summary>", render_page(scores, run_tables(scores), {}, run_manifest(scores.clips))
    )
    assert "Stages against the truth" in titles
    assert sorted(set(titles)) == sorted(titles)


def _timed(folder: Path, rows: Iterable[tuple[str, str, int, str, float]]) -> RunDirectory:
    """A run of which these are the times: clip, configuration, frame, stage and ms."""
    directory, pairs = RunDirectory(folder), dict[Pair, str]()
    for clip, configuration, frame, stage, ms in rows:
        row = time_rows((clip, configuration), frame, {stage: ms / 1e3}).decode()
        pairs[clip, configuration] = pairs.get((clip, configuration), "") + row
    for pair, text in pairs.items():
        write_text(directory.partial(pair, "csv"), text)
    join_timings(directory, pairs)
    return directory


def test_a_stage_has_its_median_over_clips_and_frames(tmp_path: Path) -> None:
    times = [
        ("a", "one", 1, 9.0),
        ("a", "one", 2, 1.0),
        ("b", "one", 1, 2.0),
        ("a", "two", 1, 4.0),
        ("a", "two", 2, 5.0),
    ]
    rows = [(clip, name, frame, "head_pose", ms) for clip, name, frame, ms in times]
    table = stage_times(_timed(tmp_path, [*rows, ("a", "two", 1, "gaze", 7.0)])).table()
    assert table.columns == ("Stage", "one", "two")
    assert table.rows == (("head pose", "2.0", "4.5"), ("gaze", "–", "7.0"))


def test_the_stages_of_thousands_of_seeds_keep_their_times(tmp_path: Path) -> None:
    directory, seeds = RunDirectory(tmp_path), range(4000)
    rows = (
        time_rows(("a", f"one.seed{seed}"), 1, {f"stage_{stage}": (seed + stage) / 1e3 for stage in range(9)})
        for seed in seeds
    )
    write_text(directory.partial(("a", "one"), "csv"), b"".join(rows).decode())
    join_timings(directory, [("a", "one")])
    assert stage_times(directory).ms == {f"stage_{stage}": [seed + stage for seed in seeds] for stage in range(9)}


def test_no_times_no_rows(tmp_path: Path) -> None:
    assert stage_times(RunDirectory(tmp_path)).ms == stage_times(_timed(tmp_path / "run", [])).ms == {}


@pytest.mark.parametrize("content", [b"", b"clip,configuration,frame,stage,ms\n", b"PAR1"])
def test_another_file_is_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    directory = RunDirectory(tmp_path)
    directory.timings.write_bytes(content)
    with pytest.raises(VfoaError, match=r"timings\.parquet: damaged: ") as caught:
        stage_times(directory)
    assert "\n" not in str(caught.value)


def test_times_without_a_number_are_refused(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    write_text(directory.partial(("a", "one"), "csv"), "a,one,1,gaze,fast\n")
    with pytest.raises(VfoaError, match=r"a__one\.csv: not the times of stages: .*fast"):
        join_timings(directory, [("a", "one")])
    assert not directory.timings.exists()
