from __future__ import annotations

import base64
import csv
import io
import json
import re
import zlib
from collections.abc import Sequence
from pathlib import Path

import pytest
from rich.console import Console

from harness.labels.labels import Labels
from harness.report.formats import to_rich
from harness.report.frames_csv import frames_csv
from harness.report.page.data import page_data
from harness.report.page.render import NO_THUMBNAILS
from harness.report.tables import (
    MOST_REMARKS,
    frr_table,
    paper_table,
    printed_table,
    summary_table,
    terminal_table,
    unlabelled_table,
)
from harness.run.manifest import AnswerTraits
from harness.run.notes import Note
from harness.run.records import FrameRecord
from harness.run.table_records import read_records
from harness.score.reference import Reference
from harness.score.verdicts import ERROR_TYPES
from tests.records import (
    answers,
    frame_record,
    labels,
    score,
    score_run,
    scored_records,
    subject_record,
    target_record,
    texts_of,
    write_run,
)
from vfoa.errors import VfoaError

PAPER = {"BM, 1 cone": 28, "SGBM, 1 cone": 35, "BM, 2 cones": 31, "SGBM, 2 cones": 38}
NOTES = (Note("bandage_2: the right view is re-projected"),)


def _paper_records() -> list[FrameRecord]:
    return [
        record
        for name, correct in PAPER.items()
        for record in answers(
            ["dragon"] * correct + ["none"] * (44 - correct) + [None] * 6, clip="bandage_2", configuration=name
        )
    ]


PAPER_LABELS = {"bandage_2": labels(*["dragon"] * 50)}


def _csv(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_the_papers_table_comes_out_as_printed_there() -> None:
    scores = score(_paper_records(), Reference(labels=PAPER_LABELS))
    assert paper_table(scores).rows == (
        ("BM, 1 cone", "28", "22", "56.0"),
        ("SGBM, 1 cone", "35", "15", "70.0"),
        ("BM, 2 cones", "31", "19", "62.0"),
        ("SGBM, 2 cones", "38", "12", "76.0"),
    )
    table = frr_table(scores)
    wilson = [row[table.columns.index("Wilson")] for row in table.rows]
    assert wilson == ["42–69", "56–81", "48–74", "63–86"]


def test_a_run_gets_all_its_tables_and_its_page_and_nothing_else(tmp_path: Path) -> None:
    score_run(tmp_path, _paper_records(), Reference(labels=PAPER_LABELS, notes=NOTES))
    assert {path.name for path in tmp_path.iterdir()} == {
        *(
            "frr.csv",
            "frr.md",
            "frr.tex",
            "comparisons.csv",
            "comparisons.md",
            "report.html",
        )
    }


def test_equal_results_give_equal_bytes(tmp_path: Path) -> None:
    score_run(tmp_path, _paper_records(), Reference(labels=PAPER_LABELS, notes=NOTES))
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    score_run(tmp_path, _paper_records(), Reference(labels=PAPER_LABELS, notes=NOTES))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == first


def test_results_that_cannot_be_read_leave_the_old_tables(tmp_path: Path) -> None:
    directory = write_run(tmp_path, _paper_records())
    score_run(tmp_path, read_records(directory), Reference(labels=PAPER_LABELS))
    before = (tmp_path / "frr.csv").read_bytes()
    (table, *_) = (tmp_path / "answers").rglob("*.parquet")
    table.write_bytes(table.read_bytes()[:-5])
    with pytest.raises(VfoaError, match=r"bandage_2\.parquet: damaged"):
        score_run(tmp_path, read_records(directory), Reference(labels={}))
    assert (tmp_path / "frr.csv").read_bytes() == before


def test_markdown_begins_with_what_it_is_and_what_must_be_known() -> None:
    page = texts_of(score(_paper_records(), Reference(labels=PAPER_LABELS, notes=NOTES)))["frr.md"]
    lines = page.splitlines()
    assert lines[0] == "# Focus recognition rate (FRR) by clip and configuration"
    assert lines[2] == "- bandage_2: the right view is re-projected"
    assert lines[3] == (
        "- bandage_2: the baseline 'constant' is right in 100.0 % of the frames, the best configuration in 76.0 %."
    )


def test_many_clips_share_one_remark_and_their_rows_come_after_those_over_all_clips() -> None:
    names = [f"clip {k}" for k in range(MOST_REMARKS + 1)]

    def page(clips: Sequence[str], configurations: int = 1) -> list[str]:
        records = [
            record
            for clip in clips
            for k in range(configurations)
            for record in answers(["cup", "book"], clip=clip, configuration=f"c{k}")
        ]
        reference = Reference(labels={clip: labels("cup", "cup") for clip in clips})
        return texts_of(score(records, reference))["frr.md"].splitlines()

    few = page(names[:-1])
    assert sum("the baseline 'constant' is right in 100.0 %" in line for line in few) == MOST_REMARKS
    remark = "- In 13 clips a baseline is right as often as the best configuration, or more often: 'constant' in 13 "
    assert f"{remark}(clip 0, clip 1, clip 2, clip 3 and 9 more)." in page(names)

    def first_words(lines: Sequence[str]) -> list[str]:
        """The clips of the rows of the first table."""
        first = lines[: lines.index("## Correct and wrong frames by configuration")]
        return [line.split("|")[1].strip() for line in first if line.startswith("|")][2:]

    assert first_words(few)[:12] == names[:-1]
    assert first_words(page(names, 16))[:16] == ["(all)"] * 16  # 224 rows


def test_the_notes_stand_in_the_latex_table_too() -> None:
    text = texts_of(score(_paper_records(), Reference(labels=PAPER_LABELS, notes=NOTES)))["frr.tex"]
    assert r"bandage\_2: the right view is re-projected" in text
    assert text.count(r"\begin{table}") == text.count(r"\end{table}") == 2


def test_a_latex_table_gives_no_advice() -> None:
    """It is for a paper, not for the person who runs vfoa."""
    texts = texts_of(score(_paper_records(), Reference(labels=PAPER_LABELS)))
    assert ("Next: " in texts["frr.md"], "Next: " in texts["frr.tex"]) == (True, False)


def test_a_latex_table_of_many_clips_has_the_rows_over_all_clips_alone() -> None:
    few, many = (
        printed_table(
            score(
                [record for clip in clips for record in answers(["cup"] * 3, clip=clip)],
                Reference(labels={clip: labels(*["cup"] * 3) for clip in clips}),
            )
        )
        for clips in ([f"clip_{number}" for number in range(count)] for count in (39, 40))
    )
    assert (len(few.rows), few.columns[:2]) == (40, ("Clip", "Configuration"))
    assert (len(many.rows), many.columns[0], many.words) == (1, "Configuration", 1)
    assert many.rows[0][1] == "120"


def test_no_hit_that_is_right_is_correct_but_no_answer() -> None:
    (row, _) = _csv(
        texts_of(score(answers(["none", "cup", "can"]), Reference(labels={"clip": labels("none", "cup", "cup")})))[
            "frr.csv"
        ]
    )
    assert (row["n"], row["correct"], row["wrong"], row["predicted"], row["no_hit"]) == ("3", "2", "1", "2", "1")
    assert (float(row["coverage"]), float(row["frr_predicted"])) == (pytest.approx(2 / 3, abs=1e-6), 0.5)
    assert row["none_true"] == ""


def test_the_numbers_for_programs_add_up() -> None:
    rows = _csv(texts_of(score(_paper_records(), Reference(labels=PAPER_LABELS)))["frr.csv"])
    assert [(row["clip"], row["subject"], row["configuration"]) for row in rows][:5] == [
        *(("bandage_2", "(all)", name) for name in PAPER),
        ("bandage_2", "girl", "BM, 1 cone"),
    ]
    for row in rows:
        assert int(row["correct"]) + int(row["wrong"]) == int(row["n"]) == 50
        assert float(row["frr"]) == int(row["correct"]) / 50
        assert float(row["coverage"]) == int(row["predicted"]) / 50
        assert int(row["predicted"]) + int(row["no_hit"]) == 44  # six frames had no object, so no answer either
        assert float(row["frr_visible"]) == float(row["frr"])
        assert sum(int(row.get(f"error_type_{error_type}", 0)) for error_type in ERROR_TYPES) == int(row["wrong"])
        assert float(row["wilson_low"]) < float(row["frr"]) < float(row["wilson_high"])
        assert (row["looks"], row["clips"]) == ("1", "1")
        assert (row["interval_low"], row["interval_high"]) == ("", "")  # a single look has no interval
        assert row["beats_baselines"] == "no"


def test_comparisons_are_said_in_words() -> None:
    texts = texts_of(score(_paper_records(), Reference(labels=PAPER_LABELS)))
    sentence = (
        "BM, 2 cones vs BM, 1 cone: +6.0 points (no interval), 1 joined look of 1 clip, this clip only, p = 1, "
        "corrected for 6 comparisons: cannot be told apart; with so few units no difference can be significant"
    )
    assert "| BM, 2 cones" in texts["comparisons.md"]
    row = next(row for row in _csv(texts["comparisons.csv"]) if row["sentence"] == sentence)
    assert (row["better"], row["worse"], row["p"]) == ("3", "0", "1")


def test_a_clip_without_labels_is_said_to_be_unscored() -> None:
    scores = score([*answers(["cup"]), *answers(["cup"], clip="street")], Reference(labels={"clip": labels("cup")}))
    assert "street: no frame is labelled, not scored; `vfoa annotate street` labels it." in frr_table(scores).notes


def test_nothing_scored_still_makes_tables() -> None:
    texts = texts_of(score(answers(["cup"]), Reference(labels={})))
    assert texts["frr.md"].startswith("# Answers in clips without labels\n\n- clip: no frame is labelled")
    assert "Nothing to show." in texts_of(score([], Reference(labels={})))["frr.md"]
    assert texts["frr.csv"].count("\n") == 1


def test_answers_in_clips_without_labels_are_shares_of_each_target() -> None:
    records = [
        *answers(["bird", "bird", None, "none", "cup", "bird"], clip="new"),
        *answers(["cup", "cup"], subject="boy", clip="new", configuration="two"),
        *answers(["bird"], clip="labelled"),
    ]
    traits = {"one": AnswerTraits(says_nowhere=True)}
    table = unlabelled_table(score(records, Reference(labels={"labelled": labels("bird")}, traits=traits)))
    assert table.rows == (
        ("new", "one", "girl", "bird 60.0, cup 20.0, none 20.0", "5", "100.0"),
        ("new", "two", "boy", "cup 100.0", "2", "100.0"),
    )
    cones = unlabelled_table(score(answers(["cup", "none"]), Reference(labels={})))
    assert cones.rows == (("clip", "one", "girl", "cup 100.0", "2", "50.0"),), "cones that hit nothing say nothing"
    missed = [frame_record(subjects=[subject_record("girl", missing="no_direction")], frame=frame) for frame in (1, 2)]
    assert unlabelled_table(score(missed, Reference(labels={}))).rows == (("clip", "one", "girl", "–", "2", "0.0"),)


def test_the_terminal_shows_n_rate_and_intervals_in_100_columns() -> None:
    names = [f"sgbm_with_a_long_name,two_cones_{i}" for i in range(2)]
    records = [
        record
        for clip in ("studio_conversation_long", "bandage_2")
        for name in names
        for record in answers(["cup"] * 12 + [None], clip=clip, configuration=name)
    ]
    truth: dict[str, Labels] = {clip: labels(*["cup"] * 13) for clip in ("studio_conversation_long", "bandage_2")}
    console = Console(width=100, file=io.StringIO(), color_system=None)
    console.print(to_rich(terminal_table(score(records, Reference(labels=truth)))))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert max(map(len, text.splitlines())) <= 100
    assert [
        word for word in ("n", "FRR %", "95 %", "Balanced %", "Baseline %", "No hit %", "(all)") if word not in text
    ] == []
    assert re.search(r"\(all\) .* 26 +92\.3 +\d+–\d+ +92\.3 +100\.0 +no +0\.0", text)


def test_the_oracle_ablation_has_a_table_of_its_own_and_is_not_between_the_configurations() -> None:
    names = ("bm", "bm+disparity", "bm+disparity+gaze", "sgbm")
    records = [record for name in names for record in answers(["cup", "can"], configuration=name)]
    scores = score(records, Reference(labels={"clip": labels("cup", "cup")}))
    assert [row[1] for row in terminal_table(scores).rows] == ["bm", "sgbm"]
    assert [row[0] for row in paper_table(scores).rows] == ["bm", "sgbm"]
    texts = texts_of(scores)
    assert [row["configuration"] for row in _csv(texts["oracle_ablation.csv"])] == list(names[:3])
    (pair,) = _csv(texts["comparisons.csv"])
    assert (pair["reference"], pair["configuration"]) == ("bm", "sgbm")
    assert pair["p"] == pair["p_holm"]  # one comparison needs no correction


def _frames(records: list[FrameRecord], reference: Reference) -> list[dict[str, str]]:
    """The rows of ``frames.csv``."""
    return _csv("".join(frames_csv(records, score(records, reference).verdicts, reference.traits)))


def test_frames_csv_has_a_row_per_frame_subject_and_target() -> None:
    cup, can = target_record(1, "cup"), target_record(2, 'can, "old"')
    girl = subject_record("girl", totals={1: 0.25, 2: 0.5}, focus=2)
    records = [
        frame_record([cup, can], [girl, subject_record(None, track_id=7, totals={1: 0.125}, focus=1)], frame=1),
        frame_record([cup], [subject_record("girl", missing="no_eyes_3d")], frame=2),
        frame_record([cup], frame=3),
    ]
    rows = _frames(records, Reference(labels={"clip": labels("cup", "cup", "cup", "cup")}))
    shown = [
        [row[key] for key in ("frame", "subject", "track", "target", "total", "focus", "error_type")] for row in rows
    ]
    assert shown == [
        ["1", "girl", "1", "cup", "0.2500", "0", "outscored"],
        ["1", "girl", "1", 'can, "old"', "0.5000", "1", "outscored"],
        ["1", "", "7", "cup", "0.1250", "1", ""],
        ["2", "girl", "1", "", "", "", "no_eyes_3d"],
        ["3", "girl", "", "", "", "", "no_subject"],
        ["4", "girl", "", "", "", "", "no_subject"],
    ]
    assert (rows[0]["gaze"], rows[0]["head"], rows[0]["time_s"]) == ("0.2500", "", "0.040")
    assert (rows[0]["truth"], rows[0]["predicted"], rows[0]["outcome"]) == ("cup", 'can, "old"', "wrong")


def test_frames_csv_has_the_probability_of_every_answer_of_a_method_with_probabilities() -> None:
    cup, can = target_record(1, "cup"), target_record(2, "can")
    subjects = [
        subject_record("girl", totals={1: 0.75, 2: 0.125}, focus=1),
        subject_record("girl", totals={1: 0.25, 2: 0.125}),  # nowhere has the rest
        subject_record("girl", missing="no_eyes_3d"),
    ]
    records = [
        frame_record([cup, can], [subject], frame=frame, configuration=name)
        for name in ("sure", "cones")
        for frame, subject in enumerate(subjects, start=1)
    ]
    reference = Reference(labels={"clip": labels("cup")}, traits={"sure": AnswerTraits(probabilistic=True)})
    rows = _frames(records, reference)
    shown = [(row["configuration"], row["frame"], row["target"], row["set_90"], row["confidence"]) for row in rows]
    assert shown[:5] == [
        ("sure", "1", "cup", "1", "0.7500"),
        ("sure", "1", "can", "1", "0.7500"),
        ("sure", "2", "cup", "1", "0.6250"),
        ("sure", "2", "can", "1", "0.6250"),
        ("sure", "3", "", "", ""),
    ]
    assert {row[3:] for row in shown[5:]} == {("", "")}
    scores, attention, _ = scored_records(records, reference)
    data, packs = page_data(scores, attention, NO_THUMBNAILS, None, {}, "", {})
    (track,) = json.loads(zlib.decompress(base64.b64decode(packs["clip-0"])))["tracks"]
    found = {
        data["configurations"][each["configuration"]]["name"]: each["confidence"] for each in track["configurations"]
    }
    assert found == {"sure": [75, 1, 62, 1, -1, 1], "cones": [-1, 3]}


def test_frames_csv_judges_one_track_of_a_name() -> None:
    twins = [subject_record("girl", track_id=track, totals={1: 0.5}, focus=1) for track in (1, 2)]
    rows = _frames([frame_record([target_record(1, "cup")], twins)], Reference(labels={"clip": labels("cup")}))
    shown = [(row["track"], row["outcome"]) for row in rows]
    assert shown == [("1", "correct"), ("2", "")]


def test_the_terminal_sums_up_the_configurations_over_all_clips_the_best_one_marked() -> None:
    given = {"bm": ["cup", "can", "can"], "sgbm": ["cup", "cup", "can"], "sgbm+gaze": ["cup"] * 3}
    records = [
        record
        for clip in ("clip", "street")
        for name, words in given.items()
        for record in answers(words, clip=clip, configuration=name)
    ]
    truth = dict.fromkeys(("clip", "street"), labels("cup", "cup", "cup"))
    table, best = summary_table(score(records, Reference(labels=truth)))
    assert [(row[0], row[1], row[2]) for row in table.rows] == [("bm", "6", "33.3"), ("sgbm", "6", "66.7")]
    assert best == 1
