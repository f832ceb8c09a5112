from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from sklearn.metrics import cohen_kappa_score, f1_score

from harness.annotations.files import Label, LabelRange, Labels
from harness.scores.reference import Reference
from harness.scores.score import CAUSES, ScoreRow, Scores, score
from harness.scores.statistics import wilson_interval
from tests.records import answers, frame_record, labels, subject_record, target_record


def _row(scores: Scores, clip: str | None = "clip", subject: str | None = None, configuration: str = "one") -> ScoreRow:
    found = [
        each for each in scores.rows if (each.clip, each.subject, each.configuration) == (clip, subject, configuration)
    ]
    (row,) = found
    return row


def test_a_frame_without_a_prediction_is_in_the_denominator() -> None:
    row = _row(
        score(answers(["cup", None, "can", "cup"]), Reference(labels={"clip": labels("cup", "cup", "cup", "cup")}))
    )
    assert (row.n, row.correct, row.predicted) == (4, 2, 3)
    assert row.frr == 2 / 4
    assert row.coverage == 3 / 4
    assert row.frr_predicted == pytest.approx(2 / 3)
    assert row.wilson == wilson_interval(2, 4)
    assert {cause: n for cause, n in row.causes.items() if n} == {"no_subject": 1, "missed": 1}
    assert list(row.causes) == list(CAUSES)


def test_ignored_and_unlabelled_frames_are_not_scored_but_listed() -> None:
    scores = score(answers(["cup", "cup", "cup"]), Reference(labels={"clip": labels("cup", "ignore")}))
    assert _row(scores).n == 1
    assert [each.outcome for each in scores.verdicts] == ["correct", "unscored", "unscored"]


def test_a_labelled_frame_without_a_record_is_wrong() -> None:
    scores = score(answers(["cup"]), Reference(labels={"clip": labels("cup", "cup", "cup")}))
    assert (_row(scores).n, _row(scores).correct) == (3, 1)
    assert [each.cause for each in scores.verdicts] == [None, "no_subject", "no_subject"]


def test_frames_that_were_not_to_be_run_are_not_scored() -> None:
    truth = labels("cup", "cup", "cup")
    row = _row(score(answers(["cup"]), Reference(labels={"clip": truth}, frames={"clip": [1, 3]})))
    assert (row.n, row.correct) == (2, 1)


def test_a_subject_that_is_in_no_record_is_wrong_in_every_frame() -> None:
    both = Labels([*labels("cup").ranges, *labels("cup", subject="boy").ranges])
    scores = score(answers(["cup"]), Reference(labels={"clip": both}))
    assert (_row(scores).n, _row(scores).correct) == (2, 1)
    assert _row(scores, subject="boy").causes["no_subject"] == 1


def test_pooling_takes_all_pairs_together() -> None:
    records = [*answers(["cup"] * 3, clip="long"), *answers(["can"], clip="short")]
    scores = score(records, Reference(labels={"long": labels("cup", "cup", "cup"), "short": labels("cup")}))
    assert _row(scores, clip=None).frr == 3 / 4
    assert [row.clip for row in scores.by_clip()] == ["long", "short", None]


def test_one_clip_is_not_pooled_and_one_without_labels_has_no_rows() -> None:
    scores = score([*answers(["cup"]), *answers(["cup"], clip="free")], Reference(labels={"clip": labels("cup")}))
    assert [row.clip for row in scores.by_clip()] == ["clip"]
    assert scores.clips == ("clip", "free")
    assert {each.outcome for each in scores.verdicts if each.clip == "free"} == {"unscored"}


def test_clips_and_configurations_keep_the_order_of_the_results() -> None:
    records = [r for clip in "zy" for name in ("sgbm", "bm") for r in answers(["cup"], clip=clip, configuration=name)]
    scores = score(records, Reference(labels={"z": labels("cup"), "y": labels("cup")}))
    assert (scores.clips, scores.configurations) == (("z", "y"), ("sgbm", "bm"))
    assert [(row.clip, row.configuration) for row in scores.by_clip()][:4] == [
        ("z", "sgbm"),
        ("z", "bm"),
        ("y", "sgbm"),
        ("y", "bm"),
    ]


def test_the_order_of_frames_in_the_file_does_not_matter() -> None:
    records = answers(["cup", "can", None, "cup", "none"])
    truth = {"clip": labels("cup", "cup", "cup", "can", "none")}
    assert score(records[::-1], Reference(labels=truth)) == score(records, Reference(labels=truth))


def test_agreement_is_that_of_scikit_learn_on_the_names() -> None:
    rng = np.random.default_rng(5)
    truth = rng.choice(["cup", "can", "none"], 300).tolist()
    said = [t if rng.random() < 0.4 else rng.choice(["cup", "can", "none", "jar", "pen", None]) for t in truth]
    row = _row(score(answers(said), Reference(labels={"clip": labels(*truth)})))
    names = ["?" if name is None else name for name in said]
    assert row.kappa == pytest.approx(cohen_kappa_score(truth, names), abs=1e-12)
    f1 = f1_score(truth, names, labels=["cup", "can", "none"], average="macro", zero_division=0)
    assert row.macro_f1 == pytest.approx(f1, abs=1e-12)
    assert row.frr == np.mean([t == s for t, s in zip(truth, said, strict=True)])


def test_another_instance_of_the_name_is_no_agreement() -> None:
    cups = [target_record(1, "cup", box_px=(0, 0, 9, 9)), target_record(2, "cup", box_px=(50, 0, 59, 9))]
    records = [frame_record(cups, [subject_record("girl", totals={1: 1.0}, focus=1)], frame=frame) for frame in (1, 2)]
    points = [
        LabelRange(first_frame=frame, last_frame=frame, subject="girl", label=Label(target="cup", point_px=(u, 5.0)))
        for frame, u in ((1, 5.0), (2, 55.0))
    ]
    row = _row(score(records, Reference(labels={"clip": Labels(points)})))
    assert row.frr == 0.5
    assert row.macro_f1 == pytest.approx(2 / 3)  # recall 1 / 2, precision 1
    assert row.events.found == 2


def test_events_run_over_scored_frames_of_a_subject() -> None:
    truth = labels("cup", "cup", "ignore", "cup", "can")
    row = _row(score(answers(["cup", "can", "cup", "cup", None]), Reference(labels={"clip": truth})))
    assert (row.events.true, row.events.found, row.events.matched) == (3, 3, 2)


def test_a_clip_that_a_trivial_rule_solves_shows_it() -> None:
    row = _row(score(answers(["cup", "can", None]), Reference(labels={"clip": labels("can", "can", "can")})))
    assert row.baselines["commonest"] == 1.0
    # both things lie at the same place, so every rule takes the first, the can, wherever there is a girl to ask
    assert (row.baselines["nearest"], row.baselines["largest"], row.baselines["central"]) == (2 / 3, 2 / 3, 2 / 3)


def test_the_commonest_label_is_each_subjects_own() -> None:
    both = Labels([*labels("cup", "cup").ranges, *labels("can", "can", subject="boy").ranges])
    assert _row(score(answers(["cup", "cup"]), Reference(labels={"clip": both}))).baselines["commonest"] == 1.0


def test_what_was_never_predicted_has_no_rate_given_a_prediction() -> None:
    row = _row(score(answers([None, None]), Reference(labels={"clip": labels("cup", "none")})))
    assert (row.frr, row.coverage) == (0, 0)
    assert math.isnan(row.frr_predicted)


def test_a_block_of_the_bootstrap_is_a_second_of_the_clip() -> None:
    looks = np.repeat(np.random.default_rng(6).random(30) < 0.5, 25)  # right or wrong for 25 frames on end
    records = answers(["cup" if right else "can" for right in looks])
    truth = {"clip": labels(*["cup"] * 750)}
    slow = [replace(record, time_ns=record.frame * 10**9) for record in records]  # a frame a second: blocks of one
    wilson, at_25_hz, at_1_hz = (
        each.high - each.low
        for each in (
            _row(score(records, Reference(labels=truth))).wilson,
            _row(score(records, Reference(labels=truth))).bootstrap,
            _row(score(slow, Reference(labels=truth))).bootstrap,
        )
    )
    assert at_25_hz > 3 * wilson
    assert at_1_hz == pytest.approx(wilson, rel=0.1)


def test_labels_on_every_tenth_frame_make_blocks_of_fewer_frames() -> None:
    rng = np.random.default_rng(7)
    records = answers(["cup" if right else "can" for right in rng.random(1000) < 0.5])
    sparse = Labels(
        LabelRange(first_frame=frame, last_frame=frame, subject="girl", label=Label(target="cup"))
        for frame in range(1, 1001, 10)
    )
    slow = [replace(record, time_ns=record.frame * 10**8) for record in records]  # labels a second apart: blocks of one
    row = _row(score(slow, Reference(labels={"clip": sparse})))
    assert row.n == 100
    assert row.bootstrap.high - row.bootstrap.low == pytest.approx(row.wilson.high - row.wilson.low, rel=0.15)


def test_no_records_have_no_scores() -> None:
    assert score([], Reference(labels={})) == Scores(clips=(), configurations=(), verdicts=(), rows=())


@pytest.mark.parametrize(("correct", "frr"), [(28, 0.56), (35, 0.70), (31, 0.62), (38, 0.76)])
def test_the_papers_own_table(correct: int, frr: float) -> None:
    said = ["bird"] * correct + ["none"] * (44 - correct) + [None] * 6  # six frames had no object at all
    row = _row(score(answers(said), Reference(labels={"clip": labels(*["bird"] * 50)})))
    assert (row.n, row.correct, row.frr) == (50, correct, frr)
    assert row.coverage == 44 / 50
    assert row.baselines["commonest"] == 1.0


def test_events_run_over_the_frames_that_a_source_has_whatever_their_numbers() -> None:
    """One frame of 31 was kept: neighbours in the clip, though not by number."""
    frames = (1, 32, 63, 94)
    records = [replace(record, frame=frame) for frame, record in zip(frames, answers(["cup"] * 4), strict=True)]
    looks = [LabelRange(first_frame=f, last_frame=f, subject="girl", label=Label(target="cup")) for f in frames]
    row = _row(score(records, Reference(labels={"clip": Labels(looks)})))
    assert (row.events.true, row.events.found, row.events.matched) == (1, 1, 1)


def test_verdicts_are_by_clip_then_configuration_then_subject_then_frame() -> None:
    records = [
        record
        for name in ("sgbm", "bm")
        for clip in "zy"
        for record in answers(["cup", "cup"], clip=clip, configuration=name)[::-1]
    ]
    both = Labels([*labels("cup", "cup").ranges, *labels("cup", subject="boy").ranges])
    scores = score(records, Reference(labels=dict.fromkeys("zy", both)))
    found = [(each.clip, each.configuration, each.subject, each.frame) for each in scores.verdicts]
    looks = [("boy", 1), ("girl", 1), ("girl", 2)]
    assert found == [(clip, name, *look) for clip in "zy" for name in ("sgbm", "bm") for look in looks]
    assert [each.configuration for each in scores.verdicts_of("bm")] == ["bm"] * 6
    assert [row.subject for row in scores.by_subject()] == ["boy", "boy", "girl", "girl"] * 2


def test_no_rule_is_right_in_a_frame_of_which_there_is_no_record() -> None:
    row = _row(score(answers(["cup"]), Reference(labels={"clip": labels("cup", "cup")})))
    assert row.baselines == {"commonest": 1.0, "nearest": 0.5, "largest": 0.5, "central": 0.5}
