from __future__ import annotations

from dataclasses import replace

import pytest

from harness.record.appearance import Colours, attention_by_name, subject_names
from harness.record.verdict_content import summary
from harness.run.manifest import AnswerTraits
from tests.frame_by_frame import judge
from tests.harness.record.conftest import LABEL
from tests.harness.record.conftest import verdict as judged


def test_the_summary_says_truth_prediction_cause_and_attention(frames):
    shown = frames[3]
    page = summary(shown.record, [judged(shown)])
    verdict = judged(shown)
    row = next(line for line in page.splitlines() if "Ann" in line and "WRONG" in line)
    assert "red cup" in row
    assert "book\\#4" in row or "book#4" in row
    assert verdict.error_type in row.replace("\\", "")
    (subject,) = shown.record.subjects
    best = max(value.total for value in subject.attention)
    assert f"{best:.2f}" in page


def test_the_summary_says_how_probable_a_prediction_is(frames):
    record = frames[3].record
    (subject,) = record.subjects
    values = tuple(replace(value, total=0.1) for value in subject.attention)
    unsure = replace(record, subjects=(replace(subject, attention=values, focus=None),))
    chance = round(100 * (1 - 0.1 * len(values)))
    page = summary(unsure, [judge(unsure, subject.name, LABEL, AnswerTraits(probabilistic=True))])
    assert f"| none ({chance} %) |" in page
    assert "90 % set: none, " in page
    plain = summary(unsure, [judge(unsure, subject.name, LABEL)])
    assert "| none |" in plain
    assert "90 % set" not in plain


def test_the_summary_says_that_another_object_of_the_true_name_is_predicted(frames):
    wrong = replace(judged(frames[3]), truth="red cup", predicted="red cup", outcome="wrong", confidence=0.6)
    assert "| red cup | red cup (another of this name) (60 %) | **WRONG** |" in summary(frames[3].record, [wrong])
    assert "| red cup | red cup (60 %) |" in summary(frames[3].record, [replace(wrong, outcome="correct")])


def test_the_summary_says_which_depths_are_of_an_earlier_frame(frames):
    record = frames[3].record
    assert "Depth" not in summary(record, [])
    (subject,), target = record.subjects, next(each for each in record.targets if each.name == "red cup")
    held = replace(
        record,
        targets=tuple(replace(each, depth_from=11) if each is target else each for each in record.targets),
        subjects=(replace(subject, depth_from=12),),
    )
    page = summary(held, [])
    line = f"Depth of earlier frames: red cup ({target.instance_id}) from 11, the eyes of {subject.name} from 12"
    assert line in page.splitlines()


def test_a_name_cannot_break_the_table(frames):
    shown = frames[0]
    verdict = replace(judged(shown), subject="a|b\nc", truth="*x*")
    row = next(line for line in summary(shown.record, (verdict,)).splitlines() if "a\\|b c" in line)
    assert row.replace("\\|", "").count("|") == 6
    assert "\\*x\\*" in row


def test_of_instances_that_share_a_name_the_one_with_most_attention_speaks_and_probabilities_are_added(frames):
    record = frames[0].record
    subject = record.subjects[0]
    low, high = (replace(subject.attention[0], instance_id=number, total=t) for number, t in ((2, 0.2), (3, 0.7)))
    both = replace(subject, attention=(low, high))
    assert attention_by_name(record, both, probabilistic=False) == {"red cup": high}
    added = attention_by_name(record, both, probabilistic=True)["red cup"]
    assert (added.gaze, added.head) == (2 * low.gaze, 2 * low.head)
    assert added.total == pytest.approx(0.9)
    unmeasured = replace(both, attention=(replace(low, gaze=None), replace(high, gaze=None)))
    assert attention_by_name(record, unmeasured, probabilistic=True)["red cup"].gaze is None


def test_the_summary_has_a_row_for_each_object_of_a_name(frames):
    record = frames[0].record
    (subject,) = record.subjects
    values = tuple(replace(value, gaze=0.0, head=0.0, total=value.instance_id / 10) for value in subject.attention)
    targets = tuple(replace(each, name="red cup") if each.instance_id == 4 else each for each in record.targets)
    page = summary(replace(record, targets=targets, subjects=(replace(subject, attention=values),)), [])
    table = page.split("|---|---|\n")[-1].splitlines()
    assert table == ["| red cup (4) | 0.40 (0.00, 0.00) |", "| red cup (2) | 0.20 (0.00, 0.00) |"]


def test_two_people_of_one_name_are_told_apart(frames):
    record = frames[0].record
    twice = replace(record, subjects=(record.subjects[0], replace(record.subjects[0], track_id=9)))
    assert len(set(subject_names(twice).values())) == 2


def test_colours_do_not_depend_on_what_comes_later():
    first, second = Colours(["cup", "book"]), Colours(["cup", "book"])
    second.of("lamp")
    assert first.of("cup") == second.of("cup") != second.of("lamp")


def test_the_summary_has_the_probability_of_looking_at_nothing_beside_the_others(frames):
    record = frames[3].record
    (subject,) = record.subjects
    chances = {2: 0.15, 3: 0.15, 4: 0.3}
    values = tuple(replace(value, total=chances.get(value.instance_id - 300, 0.0)) for value in subject.attention)
    unsure = replace(record, subjects=(replace(subject, attention=values, focus=None),))
    nowhere = 1 - sum(value.total for value in values)
    page = summary(unsure, [judge(unsure, subject.name, LABEL, AnswerTraits(probabilistic=True))])
    table = page.split("|---|---|\n")[-1].splitlines()
    assert table[0] == f"| none | {nowhere:.2f} |"
    plain = summary(unsure, [judge(unsure, subject.name, LABEL)])
    assert not any(line.startswith("| none |") for line in plain.splitlines())
