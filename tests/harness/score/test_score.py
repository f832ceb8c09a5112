from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.labels.labels import Label, LabelRange, Labels
from harness.report.tables import phases_table
from harness.run.manifest import AnswerTraits
from harness.run.records import FrameRecord
from harness.score.baselines import BASELINES, SEES_LABELS
from harness.score.comparison import compare
from harness.score.judged_subjects import JudgedSubject
from harness.score.looks import correlation_time_s, number_looks
from harness.score.metrics import LEAST_PROBABILITY
from harness.score.reference import Reference
from harness.score.rows import ScoreRow, _beats
from harness.score.score import Scores
from harness.score.statistics import sign_flip_p, wilson_interval
from harness.score.verdicts import ERROR_TYPES
from tests.records import answers, frame_record, labels, score, subject_record, target_record


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
    assert {error_type: n for error_type, n in row.error_types.items() if n} == {"no_subject": 1, "missed": 1}
    assert list(row.error_types) == list(ERROR_TYPES)


def test_ignored_and_unlabelled_frames_are_not_scored_but_listed() -> None:
    scores = score(answers(["cup", "cup", "cup"]), Reference(labels={"clip": labels("cup", "ignore")}))
    assert _row(scores).n == 1
    assert [verdict.outcome for verdict in scores.verdicts] == ["correct", "unscored", "unscored"]


def test_a_labelled_frame_without_a_record_is_wrong() -> None:
    scores = score(answers(["cup"]), Reference(labels={"clip": labels("cup", "cup", "cup")}))
    assert (_row(scores).n, _row(scores).correct) == (3, 1)
    assert [verdict.error_type for verdict in scores.verdicts] == [None, "no_subject", "no_subject"]


def test_frames_that_were_not_to_be_run_are_not_scored() -> None:
    truth = labels("cup", "cup", "cup")
    row = _row(score(answers(["cup"]), Reference(labels={"clip": truth}, frames={"clip": [1, 3]})))
    assert (row.n, row.correct) == (2, 1)


def test_a_subject_that_is_in_no_record_is_wrong_in_every_frame() -> None:
    both = Labels([*labels("cup").ranges, *labels("cup", subject="boy").ranges])
    scores = score(answers(["cup"]), Reference(labels={"clip": both}))
    assert (_row(scores).n, _row(scores).correct) == (2, 1)
    assert _row(scores, subject="boy").error_types["no_subject"] == 1


def test_pooling_takes_all_pairs_together() -> None:
    records = [*answers(["cup"] * 3, clip="long"), *answers(["can"], clip="short")]
    scores = score(records, Reference(labels={"long": labels("cup", "cup", "cup"), "short": labels("cup")}))
    assert _row(scores, clip=None).frr == 3 / 4
    assert [row.clip for row in scores.rows.by_clip] == ["long", "short", None]


def test_one_clip_is_not_pooled_and_one_without_labels_has_no_rows() -> None:
    scores = score([*answers(["cup"]), *answers(["cup"], clip="free")], Reference(labels={"clip": labels("cup")}))
    assert [row.clip for row in scores.rows.by_clip] == ["clip"]
    assert scores.clips == ("clip", "free")
    assert {verdict.outcome for verdict in scores.verdicts if verdict.clip == "free"} == {"unscored"}


def test_clips_and_configurations_keep_the_order_of_the_results() -> None:
    records = [r for clip in "zy" for name in ("sgbm", "bm") for r in answers(["cup"], clip=clip, configuration=name)]
    scores = score(records, Reference(labels={"z": labels("cup"), "y": labels("cup")}))
    assert (scores.clips, scores.configurations) == (("z", "y"), ("sgbm", "bm"))
    assert [(row.clip, row.configuration) for row in scores.rows.by_clip][:4] == [
        ("z", "sgbm"),
        ("z", "bm"),
        ("y", "sgbm"),
        ("y", "bm"),
    ]


def test_the_order_of_frames_in_the_file_does_not_matter() -> None:
    records = answers(["cup", "can", None, "cup", "none"])
    truth = {"clip": labels("cup", "cup", "cup", "can", "none")}
    backwards, forwards = (score(each, Reference(labels=truth)) for each in (records[::-1], records))
    assert backwards == forwards
    assert [*backwards.rows] == [*forwards.rows]


def test_agreement_is_that_of_scikit_learn_on_the_names() -> None:
    from sklearn.metrics import cohen_kappa_score, f1_score

    rng = np.random.default_rng(5)
    truth = rng.choice(["cup", "can", "none"], 300).tolist()
    said = [t if rng.random() < 0.4 else rng.choice(["cup", "can", "none", "jar", "pen", None]) for t in truth]
    row = _row(score(answers(said), Reference(labels={"clip": labels(*truth)})))
    names = [
        "?" if name is None or (name == "none" and true != "none") else name  # nothing hit is no answer
        for name, true in zip(said, truth, strict=True)
    ]
    assert row.metrics["kappa"] == pytest.approx(cohen_kappa_score(truth, names), abs=1e-12)
    f1 = f1_score(truth, names, labels=["cup", "can", "none"], average="macro", zero_division=0)
    assert row.metrics["macro_f1"] == pytest.approx(f1, abs=1e-12)
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
    assert row.metrics["macro_f1"] == pytest.approx(2 / 3)  # recall 1 / 2, precision 1
    assert row.events.predicted == 2


def test_events_run_over_scored_frames_of_a_subject() -> None:
    truth = labels("cup", "cup", "ignore", "cup", "can")
    row = _row(score(answers(["cup", "can", "cup", "cup", None]), Reference(labels={"clip": truth})))
    assert (row.events.true, row.events.predicted, row.events.matched) == (3, 3, 2)


def test_a_clip_that_a_baseline_solves_shows_it() -> None:
    row = _row(score(answers(["cup", "can", None]), Reference(labels={"clip": labels("can", "can", "can")})))
    assert row.baselines["constant"] == 1.0
    # both things lie at the same place, so every baseline takes the first, the can, wherever there is a girl to ask
    assert (row.baselines["nearest"], row.baselines["largest"], row.baselines["central"]) == (2 / 3, 2 / 3, 2 / 3)


def test_the_best_constant_answer_is_each_subjects_own() -> None:
    both = Labels([*labels("cup", "cup").ranges, *labels("can", "can", subject="boy").ranges])
    assert _row(score(answers(["cup", "cup"]), Reference(labels={"clip": both}))).baselines["constant"] == 1.0


def test_the_commonest_label_is_that_of_the_other_clips_and_never_that_of_the_clip_itself() -> None:
    said = {"one": "cup", "two": "can", "three": "can"}
    truth = {
        "one": labels("cup", "cup", "cup", "cup"),
        "two": labels("can", "none", "none", "cup"),
        "three": labels("can", "can", "none", "none"),
    }
    records = [record for clip, name in said.items() for record in answers([name] * 4, clip=clip)]
    scores = score(records, Reference(labels=truth))
    rates = {clip: _row(scores, clip=clip).baselines for clip in said}
    # "one" has a cup, and its others say none 4 times; "two" and "three" have a can: 2 (before none) and 1 (none 2)
    assert {clip: row["commonest"] for clip, row in rates.items()} == {"one": 0.0, "two": 0.25, "three": 0.5}
    assert {clip: row["constant"] for clip, row in rates.items()} == {"one": 1.0, "two": 0.5, "three": 0.5}
    assert _row(score(records[:4], Reference(labels={"one": truth["one"]})), clip="one").baselines["commonest"] == 0.0


def test_the_commonest_label_is_one_that_the_clip_has() -> None:
    records = [*answers(["cup", "cup"], clip="one"), *answers(["boy"] * 3, clip="two")]
    truth = {"one": labels("cup", "none"), "two": labels("boy", "boy", "boy")}
    rate = _row(score(records, Reference(labels=truth)), clip="one").baselines["commonest"]
    assert rate == 0.0  # "boy", whom this clip does not have, is no answer, and nothing else was looked at


@pytest.mark.parametrize("count", [2, 40])
def test_no_method_is_judged_by_a_rule_that_has_seen_the_labels(count: int) -> None:
    truth = labels(*["cup"] * count)  # every rule takes the can, the first of two things at the same place
    row = _row(score(answers(["can", *["cup"] * (count - 1)]), Reference(labels={"clip": truth})))
    assert row.baselines["constant"] == 1.0 > row.frr
    assert row.best_baseline != "constant"
    assert row.baselines[row.best_baseline] == max(
        rate for name, rate in row.baselines.items() if name not in SEES_LABELS
    )


def _outcome(looks: list[int], gains: list[int]) -> JudgedSubject:
    """Looks of ten frames of one subject. A method alone is right in those of gain 1, a baseline in the others."""
    alone = score(answers(["cup"] * 10 * len(looks)), Reference(labels={"clip": labels(*["cup"] * 10 * len(looks))}))
    correct = np.repeat(np.array(gains) > 0, 10)
    baselines = np.zeros((len(correct), len(BASELINES)), bool)
    baselines[:, list(BASELINES).index("nearest")] = ~correct
    return replace(alone.judged_subjects[0], looks=np.repeat(looks, 10), correct=correct, baselines=baselines)


def test_a_baseline_is_beaten_only_if_stretches_of_looks_show_it() -> None:
    """Four looks in a row are right or wrong together: 64 looks are 16 observations, of which 11 are better."""
    gains = [1 if block % 16 < 11 else -1 for block in range(16) for _ in range(4)]
    together = _outcome(list(range(64)), gains)
    assert sign_flip_p(np.array(gains) * 10.0) < 0.01 < 0.05 < sign_flip_p(np.array(gains[::4]) * 40.0)
    assert _beats([together], "nearest") == "not shown"
    better = _outcome(list(range(64)), [1] * 60 + [-1] * 4)
    assert _beats([better], "nearest") == "yes"


def test_looks_last_twice_as_long_as_verdicts_stay_alike() -> None:
    rng = np.random.default_rng(3)
    right = np.repeat(rng.random(60) < 0.6, 100)  # at 25 Hz verdicts change about every four seconds
    truth = ["cup" if frame // 60 % 2 else "can" for frame in range(len(right))]
    said = [name if is_right else "mug" for name, is_right in zip(truth, right, strict=True)]
    (outcome,) = score(answers(said), Reference(labels={"clip": labels(*truth)})).judged_subjects
    alike_s = correlation_time_s([(outcome.correct, outcome.positions, outcome.rate_hz)])
    assert alike_s > 1
    expected = number_looks(outcome.truth, outcome.positions, outcome.rate_hz, 2 * alike_s)
    assert np.array_equal(outcome.looks, expected)
    assert expected.max() < number_looks(outcome.truth, outcome.positions, outcome.rate_hz, alike_s).max()


def test_what_was_never_predicted_has_no_rate_given_a_prediction() -> None:
    row = _row(score(answers([None, None]), Reference(labels={"clip": labels("cup", "none")})))
    assert (row.frr, row.coverage) == (0, 0)
    assert math.isnan(row.frr_predicted)


def test_an_interval_takes_a_look_as_one_observation() -> None:
    right = np.random.default_rng(6).random(30) < 0.5  # thirty looks of 75 frames, right or wrong as a whole
    truth = [("cup", "can")[k // 75 % 2] for k in range(30 * 75)]
    said = [name if right[k // 75] else "jar" for k, name in enumerate(truth)]
    row = _row(score(answers(said), Reference(labels={"clip": labels(*truth)})))
    assert (row.clips, row.interval.unit) == (1, "look")
    assert 6 <= row.looks <= 16  # joined
    assert row.interval.high - row.interval.low > 4 * (row.wilson.high - row.wilson.low)


def test_from_six_clips_on_an_interval_speaks_of_clips() -> None:
    def rows(clips: int) -> ScoreRow:
        names = [f"clip {k}" for k in range(clips)]
        records = [r for k, name in enumerate(names) for r in answers(["cup"] * (4 + k) + ["can"], clip=name)]
        truth = {name: labels(*["cup"] * (5 + k)) for k, name in enumerate(names)}
        return _row(score(records, Reference(labels=truth)), clip=None)

    assert (rows(5).interval.unit, rows(6).interval.unit) == ("look", "clip")


def test_the_interval_of_the_balanced_rate_needs_units_of_both_kinds() -> None:
    def row(clips_with_none: int) -> ScoreRow:
        names = [f"clip {k}" for k in range(9)]
        said = {name: ["cup"] * (6 + k % 3) + ["can"] * (k % 4) for k, name in enumerate(names)}
        true = {name: ["cup"] * len(each) for name, each in said.items()}
        for k, name in enumerate(names[:clips_with_none]):
            said[name] += ["none"] * 5 + ["cup"] * (k % 3)
            true[name] += ["none"] * (5 + k % 3)
        records = [record for name in names for record in answers(said[name], clip=name)]
        truth = {name: labels(*each) for name, each in true.items()}
        return _row(score(records, Reference(labels=truth)), clip=None)

    both = row(9)
    assert both.balanced_interval.low < both.metrics["balanced_frr"] < both.balanced_interval.high
    assert both.balanced_interval.unit == "clip"
    assert both.balanced_interval != both.interval
    assert math.isnan(row(5).balanced_interval.low)
    assert row(0).balanced_interval == row(0).interval


def test_nothing_hit_is_counted_apart_from_answers() -> None:
    said = ["cup", "none", "none", None]
    row = _row(score(answers(said), Reference(labels={"clip": labels("cup", "cup", "none", "cup")})))
    assert (row.n, row.correct, row.predicted, row.predicted_correct, row.no_hit) == (4, 2, 1, 1, 2)
    assert (row.coverage, row.frr_predicted) == (1 / 4, 1.0)
    assert row.error_types["no_hit"] == 1
    assert row.nowhere is None  # a method that cannot say so


def test_a_method_that_says_nothing_is_looked_at_is_scored_on_it() -> None:
    cup = target_record(1, "cup")
    unsure = subject_record("girl", totals={1: 0.3})  # the rest of the probability is on nowhere
    sure = subject_record("girl", totals={1: 0.8}, focus=1)
    records = [frame_record([cup], [each], frame=k) for k, each in enumerate([unsure, unsure, sure, sure], start=1)]
    row = _row(score(records, Reference(labels={"clip": labels("none", "cup", "cup", "none")})))
    assert row.nowhere is not None
    assert (row.nowhere.true, row.nowhere.predicted, row.nowhere.matched) == (2, 2, 1)
    assert (row.nowhere.precision, row.nowhere.recall) == (0.5, 0.5)
    assert (row.coverage, row.no_hit) == (1.0, 0)


def test_a_method_that_says_so_by_giving_no_attention_has_answered() -> None:
    reference = Reference(labels={"clip": labels("cup", "none")}, traits={"one": AnswerTraits(says_nowhere=True)})
    row = _row(score(answers(["none", "none"]), reference))
    assert row.nowhere is not None
    assert (row.nowhere.predicted, row.nowhere.matched, row.no_hit, row.coverage) == (2, 1, 0, 1.0)
    assert row.error_types["no_hit"] == 0


def test_blocked_lines_of_sight_are_scored_with_and_without() -> None:
    truth = Labels(
        LabelRange(first_frame=k, last_frame=k, subject="girl", label=Label(target="cup", note=note))
        for k, note in enumerate(["", "blocked by the vase", "blocked", "unblocked"], start=1)
    )
    row = _row(score(answers(["cup", "can", "cup", "cup"]), Reference(labels={"clip": truth})))
    assert (row.frr, row.visible, row.frr_visible) == (3 / 4, 2, 1.0)


def test_the_limit_of_the_angle_is_tuned_on_the_other_clips() -> None:
    """On the one clip every answer within 0.2 rad is right; on the other that limit leaves one frame of two."""

    def records(clip: str, angles: list[float]) -> list[FrameRecord]:
        cups = [target_record(1, "cup", center=(np.tan(angle), 0.0, 2.0)) for angle in angles]
        return [
            frame_record([cup], [subject_record("girl")], frame=k, clip=clip) for k, cup in enumerate(cups, start=1)
        ]

    found = [*records("one", [0.1, 0.3]), *records("other", [0.1, 0.4])]
    truth = {"one": labels("cup", "none"), "other": labels("cup", "cup")}
    scores = score(found, Reference(labels=truth))
    assert _row(scores, clip="other").baselines["nearest_in_angle"] == 0.5  # tuned on one: 0.4 is beyond the limit
    assert _row(scores, clip="one").baselines["nearest_in_angle"] == 0.5  # tuned on the other: no limit
    alone = score(found[:2], Reference(labels={"one": truth["one"]}))
    assert _row(alone, clip="one").baselines["nearest_in_angle"] == 0.5


def test_phases_are_scored_apart_with_baselines_of_their_own() -> None:
    """Two things in the frames of a search, one in those of an answer; a frame with none is in no phase."""
    things = [target_record(1, "cup", center=(0.2, 0.0, 2.0)), target_record(2, "can", center=(5.0, 0.0, 2.0))]
    body = target_record(9, "girl")

    def records(clip: str, counts: list[int], foci: list[int | None]) -> list[FrameRecord]:
        return [
            frame_record(
                [*things[:count], body],
                [subject_record("girl", instance_id=9, totals={focus: 0.8} if focus else {}, focus=focus)],
                frame=frame,
                clip=clip,
            )
            for frame, (count, focus) in enumerate(zip(counts, foci, strict=True), start=1)
        ]

    found = [*records("one", [2, 2, 1, 1, 0], [1, 2, 1, None, None]), *records("two", [2, 1, 1], [1, 1, 1])]
    truth = {"one": labels("cup", "cup", "none", "none", "none"), "two": labels("cup", "none", "none")}
    phases = {clip: {2: "search", 1: "answer"} for clip in truth}
    scores = score(found, Reference(labels=truth, phases=phases))
    rows = {name: _row(of_phase, clip=None) for name, of_phase in scores.phases.items()}
    assert {name: (row.n, row.correct) for name, row in rows.items()} == {"search": (3, 2), "answer": (4, 1)}
    nearest = {name: row.baselines["nearest_in_angle"] for name, row in rows.items()}
    assert nearest == {"search": 1.0, "answer": 1.0}  # no limit in a search, and never a target in an answer
    assert {name: row.baselines_balanced["commonest"] for name, row in rows.items()} == {"search": 1.0, "answer": 1.0}
    whole = _row(scores, clip=None)
    assert (whole.n, whole.baselines["nearest_in_angle"]) == (8, 3 / 8)
    table = phases_table(scores)
    assert [row[:4] for row in table.rows] == [("search", "one", "3", "66.7"), ("answer", "one", "4", "25.0")]
    assert not phases_table(score(found, Reference(labels=truth))).rows


def test_a_phase_that_one_clip_alone_has_is_that_clips() -> None:
    scores = score(
        [*answers(["cup", "cup"], clip="one"), *answers(["cup"], clip="two")],
        Reference(labels={"one": labels("cup", "can"), "two": labels("cup")}, phases={"one": {1: "search"}}),
    )
    assert [(row.clip, row.n, row.correct) for row in scores.phases["search"].rows.overall] == [("one", 2, 1)]


def test_a_configuration_that_a_baseline_beats_is_marked() -> None:
    looks = ["cup" if k // 50 % 2 else "can" for k in range(600)]
    other = {"cup": "can", "can": "cup"}
    said = {"good": looks, "poor": [other[name] if k % 100 < 60 else name for k, name in enumerate(looks)]}
    records = [r for name, each in said.items() for r in answers(each, configuration=name)]
    scores = score(records, Reference(labels={"clip": labels(*looks)}))
    good, poor = (_row(scores, configuration=name) for name in said)
    assert good.baselines["constant"] == 0.5
    assert (good.beats, poor.beats) == ("yes", "no")


def test_no_records_have_no_scores() -> None:
    scores = score([], Reference(labels={}))
    assert (scores.clips, scores.configurations, [*scores.rows], bool(scores.rows)) == ((), (), [], False)


@pytest.mark.parametrize(("correct", "frr"), [(28, 0.56), (35, 0.70), (31, 0.62), (38, 0.76)])
def test_the_papers_own_table(correct: int, frr: float) -> None:
    said = ["bird"] * correct + ["none"] * (44 - correct) + [None] * 6  # six frames had no object at all
    row = _row(score(answers(said), Reference(labels={"clip": labels(*["bird"] * 50)})))
    assert (row.n, row.correct, row.frr) == (50, correct, frr)
    assert row.coverage == correct / 50
    assert row.no_hit == 44 - correct
    assert row.baselines["constant"] == 1.0


def test_events_run_over_the_frames_that_a_source_has_whatever_their_numbers() -> None:
    """One frame of 31 was kept: neighbours in the clip, though not by number."""
    frames = (1, 32, 63, 94)
    records = [replace(record, frame=frame) for frame, record in zip(frames, answers(["cup"] * 4), strict=True)]
    looks = [LabelRange(first_frame=f, last_frame=f, subject="girl", label=Label(target="cup")) for f in frames]
    row = _row(score(records, Reference(labels={"clip": Labels(looks)})))
    assert (row.events.true, row.events.predicted, row.events.matched) == (1, 1, 1)


def test_verdicts_are_by_clip_then_configuration_then_subject_then_frame() -> None:
    records = [
        record
        for name in ("sgbm", "bm")
        for clip in "zy"
        for record in answers(["cup", "cup"], clip=clip, configuration=name)[::-1]
    ]
    both = Labels([*labels("cup", "cup").ranges, *labels("cup", subject="boy").ranges])
    scores = score(records, Reference(labels=dict.fromkeys("zy", both)))
    found = [(verdict.clip, verdict.configuration, verdict.subject, verdict.frame) for verdict in scores.verdicts]
    looks = [("boy", 1), ("girl", 1), ("girl", 2)]
    assert found == [(clip, name, *look) for clip in "zy" for name in ("sgbm", "bm") for look in looks]
    assert [row.subject for row in scores.rows.by_subject] == ["boy", "boy", "girl", "girl"] * 2


def test_no_rule_is_right_in_a_frame_of_which_there_is_no_record() -> None:
    row = _row(score(answers(["cup"]), Reference(labels={"clip": labels("cup", "cup")})))
    picked = dict.fromkeys(("nearest", "largest", "central", "nearest_in_angle"), 0.5)
    assert row.baselines == {"commonest": 0.0, **picked, "constant": 1.0}


def test_always_none_has_the_frr_of_nowhere_and_half_the_balanced_one() -> None:
    truth = labels("none", "none", "none", "bird")
    reference = Reference(labels={"clip": truth}, traits={"one": AnswerTraits(says_nowhere=True)})
    row = score(answers(["none"] * 4), reference).rows.by_clip[0]
    assert (row.frr, row.metrics["balanced_frr"]) == (0.75, 0.5)
    assert (row.metrics["recall_targets"], row.metrics["recall_nowhere"]) == (0.0, 1.0)
    assert math.isnan(row.metrics["log_loss"])
    assert math.isnan(row.metrics["brier"])
    (alone,) = score(answers(["bird"]), Reference(labels={"clip": labels("bird")})).rows.by_clip
    assert alone.metrics["balanced_frr"] == 1.0
    assert math.isnan(alone.metrics["recall_nowhere"])


def test_losses_are_those_of_scikit_learn_and_no_answer_is_the_worst() -> None:
    """Of bird, cup and nowhere: (.5, .3, .2), (0, .25, .75), then no answer, and a truth of probability 0."""
    from sklearn.metrics import log_loss

    shown = ({1: 0.5, 2: 0.3}, {1: 0.0, 2: 0.25}, None, {1: 0.0, 2: 0.25})
    targets = (target_record(1, "bird"), target_record(2, "cup"))
    records = [
        frame_record(targets, [] if totals is None else [subject_record("girl", totals=totals, focus=1)], frame=frame)
        for frame, totals in enumerate(shown, start=1)
    ]
    truth = labels("bird", "none", "cup", "bird")
    reference = Reference(labels={"clip": truth}, traits={"one": AnswerTraits(probabilistic=True)})
    (row,) = score(records, reference).rows.by_clip
    of_first_two = 2 * log_loss([0, 2], [[0.5, 0.3, 0.2], [0.0, 0.25, 0.75]], labels=[0, 1, 2])
    assert row.metrics["log_loss"] == pytest.approx((of_first_two - 2 * math.log(LEAST_PROBABILITY)) / 4)
    assert row.metrics["brier"] == pytest.approx((0.25 + 0.09 + 0.04 + 0.0625 + 0.0625 + 1 + 1 + 0.0625 + 0.5625) / 4)


@pytest.mark.parametrize("clips", [3, 14])
def test_no_interval_or_test_depends_on_the_order_of_the_clips(clips: int) -> None:
    rng = np.random.default_rng(clips)
    truth = ["cup"] * 60 + ["can"] * 60 + ["cup"] * 60
    records = {
        (f"clip {k}", name): answers([*rng.choice(truth, 180)], configuration=name, clip=f"clip {k}")
        for k in range(clips)
        for name in ("one", "two")
    }
    reference = Reference(labels={f"clip {k}": labels(*truth) for k in range(clips)})
    found = []
    for order in ([*records], [*records][::-1]):
        scores = score([record for pair in order for record in records[pair]], reference)
        rates = {row.configuration: row.interval for row in scores.rows.overall}
        found.append((rates, compare({name: scores.frames_of(name) for name in ("one", "two")})))
    assert found[0] == found[1]
