from __future__ import annotations

from dataclasses import replace

import pytest

from harness.labels.labels import Label, LabelRange, Labels
from harness.run.columns import Words
from harness.run.records import FrameRecord
from harness.score.verdict_columns import judge_columns
from harness.score.verdicts import ERROR_TYPES, PLAIN, Verdict
from tests.record_tables import columns_of
from tests.records import frame_record, subject_record, target_record
from vfoa.scoring import NO_HIT

CUP, CAN = target_record(1, "cup"), target_record(2, "can")
FLAT_CUP = target_record(1, "cup", center=None)
GIRL, BOY = target_record(8, "girl"), target_record(9, "boy")


def _verdict(record: FrameRecord, label: Label | None, frame: int = 1) -> Verdict:
    """The verdict of a frame of the girl's, of which this record is all that is known."""
    of_girl = [LabelRange(first_frame=frame, last_frame=frame, subject="girl", label=label)] if label else []
    part = judge_columns(columns_of([record], Words()), Labels(of_girl), (record.frame, frame), PLAIN, {})
    (verdict,) = part.by_subject["girl"].verdicts()
    return verdict


def _judge(record: FrameRecord, target: str, point_px: tuple[float, float] | None = None) -> Verdict:
    return _verdict(record, Label(target=target, point_px=point_px))


def _outcome(verdict: Verdict) -> tuple[str | None, str, str | None]:
    return verdict.predicted, verdict.outcome, verdict.error_type


def test_the_true_target_is_correct() -> None:
    verdict = _judge(frame_record([CUP, CAN], [subject_record("girl", totals={1: 0.5, 2: 0.1}, focus=1)]), "cup")
    assert verdict == Verdict(
        clip="clip",
        configuration="one",
        frame=1,
        subject="girl",
        truth="cup",
        predicted="cup",
        outcome="correct",
        error_type=None,
    )


def test_nowhere_is_correct_when_nothing_is_looked_at() -> None:
    verdict = _judge(frame_record([CUP], [subject_record("girl", totals={1: 0.2})]), "none")
    assert _outcome(verdict) == ("none", "correct", None)


def test_nothing_hit_is_right_where_nothing_is_looked_at_and_yet_no_answer() -> None:
    verdict = _judge(frame_record([CUP], [subject_record("girl", totals={1: 0.0})]), "none")
    assert _outcome(verdict) == (NO_HIT, "correct", None)


@pytest.mark.parametrize("label", [None, Label(target="ignore")])
def test_without_a_label_nothing_is_scored(label: Label | None) -> None:
    seen = _verdict(frame_record([CUP], [subject_record("girl", totals={1: 0.5}, focus=1)]), label)
    assert _outcome(seen) == ("cup", "unscored", None)
    if label:
        assert _outcome(_verdict(frame_record([CUP]), label)) == (None, "unscored", None)


TURNED_AWAY = replace(subject_record("girl", missing="no_direction"), no_gaze="face_turned_away")


@pytest.mark.parametrize(
    ("record", "truth", "predicted", "error_type"),
    [
        (frame_record([CUP]), "cup", None, "no_subject"),
        (frame_record([CUP], [subject_record(None, totals={1: 0.5}, focus=1)]), "cup", None, "no_subject"),
        (frame_record([CUP], [subject_record("girl", missing="no_eyes_3d")]), "cup", None, "no_eyes_3d"),
        (frame_record([CUP], [subject_record("girl", missing="no_direction")]), "cup", None, "no_direction"),
        (frame_record([CUP], [TURNED_AWAY]), "cup", None, "face_turned_away"),
        (frame_record([CAN], [subject_record("girl", totals={2: 0.5}, focus=2)]), "cup", "can", "target_not_segmented"),
        (frame_record([FLAT_CUP], [subject_record("girl")]), "cup", NO_HIT, "target_without_box"),
        (frame_record([CUP], [subject_record("girl", totals={1: 0.5}, focus=1)]), "none", "cup", "false_attention"),
        (frame_record([CUP], [subject_record("girl", totals={1: 0.0})]), "cup", NO_HIT, "no_hit"),
        (frame_record([CUP, CAN], [subject_record("girl", totals={2: 0.5}, focus=2)]), "cup", "can", "missed"),
        (frame_record([CUP, CAN], [subject_record("girl", totals={2: 0.2})]), "cup", "none", "missed"),
        (frame_record([CUP], [subject_record("girl", totals={1: 0.2})]), "cup", "none", "outscored"),
        (
            frame_record([CUP, CAN], [subject_record("girl", totals={1: 0.4, 2: 0.5}, focus=2)]),
            "cup",
            "can",
            "outscored",
        ),
        # the name's head was joined to the boy's body, though the girl's own is there
        (
            frame_record([CUP, GIRL, BOY], [subject_record("girl", totals={8: 0.5}, focus=8, instance_id=9)]),
            "cup",
            "girl",
            "wrong_subject",
        ),
        # the same, with something else looked at
        (
            frame_record([CUP, CAN, GIRL, BOY], [subject_record("girl", totals={2: 0.5}, focus=2, instance_id=9)]),
            "cup",
            "can",
            "wrong_subject",
        ),
        # nobody looks at themselves: the head was joined to no body, and its own box was hit
        (frame_record([CUP, GIRL], [subject_record("girl", totals={8: 0.5}, focus=8)]), "cup", "girl", "wrong_subject"),
    ],
)
def test_a_wrong_frame_has_the_error_type(
    record: FrameRecord, truth: str, predicted: str | None, error_type: str
) -> None:
    assert _outcome(_judge(record, truth)) == (predicted, "wrong", error_type)
    assert error_type in ERROR_TYPES


@pytest.mark.parametrize("missing", ["no_eyes_3d", "no_direction"])
def test_no_prediction_is_wrong_even_where_nothing_is_looked_at(missing: str) -> None:
    assert _outcome(_judge(frame_record([], [subject_record("girl", missing=missing)]), "none")) == (
        None,
        "wrong",
        missing,
    )
    assert _outcome(_judge(frame_record(), "none")) == (None, "wrong", "no_subject")


@pytest.mark.parametrize(
    ("record", "truth", "error_type"),
    [
        (frame_record([], [subject_record("girl", missing="no_eyes_3d")]), "cup", "no_eyes_3d"),
        (frame_record([GIRL], [subject_record("girl", totals={8: 1.0}, focus=8)]), "cup", "target_not_segmented"),
        (
            frame_record([FLAT_CUP, GIRL], [subject_record("girl", totals={8: 1.0}, focus=8)]),
            "cup",
            "target_without_box",
        ),
        (frame_record([GIRL], [subject_record("girl", totals={8: 1.0}, focus=8)]), "none", "false_attention"),
        (
            frame_record([CUP, GIRL], [subject_record("girl", totals={1: 0.1, 8: 1.0}, focus=8)]),
            "cup",
            "wrong_subject",
        ),
    ],
)
def test_of_several_error_types_the_first_in_the_order_counts(record: FrameRecord, truth: str, error_type: str) -> None:
    assert _judge(record, truth).error_type == error_type


def test_a_frame_without_a_record_is_wrong() -> None:
    verdict = _verdict(frame_record([CUP]), Label(target="none"), frame=7)
    assert (verdict.frame, *_outcome(verdict)) == (7, None, "wrong", "no_subject")


LEFT = target_record(1, "cup", box_px=(0, 0, 10, 10))
RIGHT = target_record(2, "cup", box_px=(20, 0, 40, 10))
LOOKS_LEFT = frame_record([LEFT, RIGHT], [subject_record("girl", totals={1: 0.5, 2: 0.2}, focus=1)])


@pytest.mark.parametrize(
    ("point_px", "outcome", "error_type"),
    [
        (None, "correct", None),  # two bear the name: any of them is right
        ((5.0, 5.0), "correct", None),
        ((30.0, 5.0), "wrong", "outscored"),
        ((14.0, 5.0), "correct", None),  # in neither: the nearer one
        ((16.0, 5.0), "wrong", "outscored"),
    ],
)
def test_a_point_tells_targets_of_one_name_apart(
    point_px: tuple[float, float] | None, outcome: str, error_type: str | None
) -> None:
    assert _outcome(_judge(LOOKS_LEFT, "cup", point_px)) == ("cup", outcome, error_type)


def test_a_point_in_two_boxes_means_the_one_it_is_more_central_in() -> None:
    around = target_record(2, "cup", box_px=(0, 0, 100, 100))
    record = frame_record([LEFT, around], [subject_record("girl", totals={2: 0.5}, focus=2)])
    assert _judge(record, "cup", (4.0, 4.0)).error_type == "missed"
    assert _judge(record, "cup", (9.0, 9.0)).error_type == "missed"
    assert _judge(record, "cup", (45.0, 45.0)).outcome == "correct"


def test_a_point_does_not_tell_targets_without_images_apart() -> None:
    """Measured ones have no box in an image: any of them is right, not the first one alone."""
    cups = [target_record(each, "cup", box_px=None) for each in (1, 2)]
    for focus in (1, 2):
        record = frame_record(cups, [subject_record("girl", totals={focus: 0.5}, focus=focus)])
        assert _outcome(_judge(record, "cup", (5.0, 5.0))) == ("cup", "correct", None)
    beside = [cups[0], target_record(2, "cup", box_px=(0, 0, 10, 10))]
    record = frame_record(beside, [subject_record("girl", totals={1: 0.5}, focus=1)])
    assert _judge(record, "cup", (5.0, 5.0)).outcome == "wrong"


def test_a_target_with_a_box_is_not_without_because_another_of_its_name_is() -> None:
    record = frame_record(
        [target_record(1, "cup", center=None), target_record(2, "cup")], [subject_record("girl", totals={2: 0.0})]
    )
    assert _judge(record, "cup").error_type == "no_hit"


def _answered(boxes: list[tuple[float, float, float, float]], point_px: tuple[float, float]) -> list[int]:
    """The right answers (cups counted from 1, with these boxes) to a label with a point."""
    cups = [target_record(each, "cup", box_px=box) for each, box in enumerate(boxes, start=1)]
    return [
        cup.instance_id
        for cup in cups
        if _judge(frame_record(cups, [subject_record("girl", focus=cup.instance_id)]), "cup", point_px).outcome
        == "correct"
    ]


@pytest.mark.parametrize(
    ("point_px", "answer"),
    [
        ((18, 12), 1),  # in both, by Pythagoras: 32, 2 from the one's centre, 8, 38 from the other's
        ((12, 18), 2),
        ((104, 23), 1),  # 5 px from the one's corner, 84 from the other's side
        ((23, 104), 2),
    ],
)
def test_a_point_is_nearest_by_straight_distance(point_px: tuple[float, float], answer: int) -> None:
    assert _answered([(0, 0, 100, 20), (0, 0, 20, 100)], point_px) == [answer]


@pytest.mark.parametrize("swapped", [False, True])
def test_a_point_across_a_corner_is_not_as_far_as_the_way_along_the_sides(swapped: bool) -> None:
    """3 and 4 px from one box are 5, less than 6 from the other, but 7 along the sides."""
    boxes: list[tuple[float, float, float, float]] = [(0, 0, 10, 10), (0, 20, 40, 40)]
    point = (13.0, 14.0)
    if swapped:
        boxes, point = [(v0, u0, v1, u1) for u0, v0, u1, v1 in boxes], (14.0, 13.0)
    assert _answered(boxes, point) == [1]


@pytest.mark.parametrize("beside", [(50.5, 45, 60, 55), (45, 50.5, 55, 60)])
def test_a_box_that_holds_the_point_is_nearer_than_one_half_a_pixel_away(
    beside: tuple[float, float, float, float],
) -> None:
    assert _answered([(0, 0, 1000, 1000), beside], (50.0, 50.0)) == [1]


def test_a_point_on_a_target_that_was_not_segmented_changes_nothing() -> None:
    record = frame_record([CAN], [subject_record("girl", totals={2: 0.5}, focus=2)])
    assert _judge(record, "cup", (3.0, 4.0)).error_type == "target_not_segmented"


def test_of_two_people_of_one_name_the_first_is_judged() -> None:
    looks = {
        name: subject_record("girl", totals={1: 0.5, 2: 0.4}, focus=number) for number, name in ((1, "cup"), (2, "can"))
    }
    for first, second in (("cup", "can"), ("can", "cup")):
        record = frame_record([CUP, CAN], [looks[first], looks[second]])
        assert _judge(record, first).outcome == "correct"
        assert _judge(record, second).outcome == "wrong"
