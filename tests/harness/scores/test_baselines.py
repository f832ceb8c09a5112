from __future__ import annotations

from dataclasses import replace

from harness.scores.baselines import Choices, Rules, commonest
from tests.records import frame_record, subject_record, target_record

NEAR = target_record(1, "near", center=(1.0, 0.0, 1.2), box_px=(0, 0, 10, 10))
LARGE = target_record(2, "large", center=(2.0, 0.0, 3.0), box_px=(0, 0, 50, 50))
CENTRAL = target_record(3, "central", center=(0.1, 0.0, 6.0), box_px=(0, 0, 20, 20))
FLAT = target_record(4, "flat", center=None, box_px=(0, 0, 40, 40))
RECORD = frame_record([NEAR, LARGE, CENTRAL, FLAT])
GIRL = subject_record("girl", eyes=(1.0, 0.0, 1.0))


def test_each_rule_picks_what_it_is_called_after() -> None:
    assert Rules(RECORD).choose(GIRL) == Choices(nearest=1, largest=2, central=3)


def test_a_subject_never_picks_its_own_body() -> None:
    picked = [Rules(RECORD).choose(replace(GIRL, instance_id=own)) for own in (1, 2, 3)]
    assert picked == [
        Choices(nearest=2, largest=2, central=3),
        Choices(nearest=1, largest=4, central=3),
        Choices(nearest=1, largest=2, central=2),  # 2 m aside at 3 m is nearer the axis than 1 m at 1.2 m
    ]


def test_what_is_behind_the_camera_is_not_central() -> None:
    behind = target_record(5, "behind", center=(0.0, 0.0, -1.0))
    assert Rules(frame_record([NEAR, behind])).choose(GIRL).central == 1


def test_without_eyes_nothing_is_nearest() -> None:
    assert Rules(RECORD).choose(replace(GIRL, eye_origin_m=None)) == Choices(nearest=None, largest=2, central=3)


def test_without_a_subject_or_targets_nothing_is_picked() -> None:
    nothing = Choices(nearest=None, largest=None, central=None)
    assert Rules(RECORD).choose(None) == nothing
    assert Rules(frame_record()).choose(GIRL) == nothing


def test_the_commonest_label_is_the_first_by_name_of_equals() -> None:
    assert commonest(["cup", "can", "cup"]) == "cup"
    assert commonest(["cup", "can"]) == "can"
    assert commonest([]) is None


def test_the_largest_is_so_by_its_area_wherever_it_lies() -> None:
    small = target_record(1, "small", box_px=(500, 10, 520, 30))
    tall = target_record(2, "tall", box_px=(10, 500, 20, 530))
    large = target_record(3, "large", box_px=(0, 0, 25, 20))
    assert Rules(frame_record([small, tall, large])).choose(GIRL).largest == 3


def test_the_central_is_so_by_its_angle_whatever_its_distance() -> None:
    far, near = target_record(1, "far", center=(5.0, 0.0, 9.0)), target_record(2, "near", center=(0.1, 0.0, 0.5))
    assert Rules(frame_record([far, near])).choose(GIRL).central == 2


def test_a_box_about_the_camera_has_no_angle_and_counts_as_a_right_one() -> None:
    around, ahead, behind = (
        target_record(each, "box", center=(0.0, 0.0, z)) for each, z in ((1, 0.0), (2, 1), (3, -1))
    )
    picked = [Rules(frame_record(each)).choose(GIRL).central for each in ([around, ahead], [around, behind])]
    assert picked == [2, 1]
