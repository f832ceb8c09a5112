from __future__ import annotations

from dataclasses import replace
from math import acos, inf, nan, sqrt

import numpy as np
import pytest

from harness.run.columns import UNKNOWN, Words
from harness.run.records import FrameRecord, SubjectRecord
from harness.score.baselines import best_limit_rad, commonest, picks_of, view_of
from tests import frame_by_frame
from tests.frame_by_frame import Choices
from tests.record_tables import columns_of
from tests.records import frame_record, subject_record, target_record

NEAR = target_record(1, "near", center=(1.0, 0.0, 1.2), box_px=(0, 0, 10, 10))
LARGE = target_record(2, "large", center=(2.0, 0.0, 3.0), box_px=(0, 0, 50, 50))
CENTRAL = target_record(3, "central", center=(0.1, 0.0, 6.0), box_px=(0, 0, 20, 20))
FLAT = target_record(4, "flat", center=None, box_px=(0, 0, 40, 40))
RECORD = frame_record([NEAR, LARGE, CENTRAL, FLAT])
GIRL = subject_record("girl", eyes=(1.0, 0.0, 1.0))


def choose(record: FrameRecord, subject: SubjectRecord | None) -> Choices:
    """What each baseline picks for one person of a frame, in columns and alone."""
    alone = frame_by_frame.choose(record, subject)
    if subject is not None and record.targets:
        columns = columns_of([replace(record, subjects=(subject,))], Words())
        picks, ids = picks_of(columns.scene, columns.looks), view_of(columns.scene).ids[0]
        found = [None if place == UNKNOWN else int(ids[place]) for place in picks.picks[0].tolist()]
        assert Choices(*found, picks.angles_rad[0]) == pytest.approx(alone, nan_ok=True)
    return alone


def test_each_baseline_picks_what_it_is_called_after() -> None:
    assert choose(RECORD, GIRL)[:3] == (1, 2, 3)


def test_a_subject_never_picks_its_own_body() -> None:
    picked = [choose(RECORD, replace(GIRL, instance_id=own))[:3] for own in (1, 2, 3)]
    assert picked == [
        (2, 2, 3),
        (1, 4, 3),
        (1, 2, 2),  # 2 m aside at 3 m is nearer the axis than 1 m at 1.2 m
    ]


def test_what_is_behind_the_camera_is_not_central() -> None:
    behind = target_record(5, "behind", center=(0.0, 0.0, -1.0))
    assert choose(frame_record([NEAR, behind]), GIRL).central == 1


def test_without_eyes_nothing_is_nearest() -> None:
    assert choose(RECORD, replace(GIRL, eye_origin_m=None)) == Choices(nearest=None, largest=2, central=3)


def test_of_what_is_equal_but_for_rounding_the_lower_number_is_picked() -> None:
    one, other = (target_record(n, "box", center=(x, 0.0, 1.0)) for n, x in ((1, 0.1 + 0.2), (2, -0.3)))
    girl = replace(subject_record("girl", eyes=(0.0, 0.0, 0.0)), gaze=(0.0, 0.0, 1.0))
    assert choose(frame_record([one, other]), girl)[:4:2] == (1, 1)
    assert choose(frame_record([one, other]), girl).in_angle == 1


def test_without_a_subject_or_targets_nothing_is_picked() -> None:
    nothing = Choices(nearest=None, largest=None, central=None)
    assert choose(RECORD, None) == nothing
    assert choose(frame_record(), GIRL) == nothing


def test_the_commonest_label_is_the_first_by_name_of_equals() -> None:
    assert commonest({"can": 1, "cup": 2}) == "cup"
    assert commonest({"cup": 1, "can": 1}) == "can"
    assert commonest({}) is None


def test_the_largest_is_so_by_its_area_wherever_it_lies() -> None:
    small = target_record(1, "small", box_px=(500, 10, 520, 30))
    tall = target_record(2, "tall", box_px=(10, 500, 20, 530))
    large = target_record(3, "large", box_px=(0, 0, 25, 20))
    assert choose(frame_record([small, tall, large]), GIRL).largest == 3


def test_the_central_is_so_by_its_angle_whatever_its_distance() -> None:
    far, near = target_record(1, "far", center=(5.0, 0.0, 9.0)), target_record(2, "near", center=(0.1, 0.0, 0.5))
    assert choose(frame_record([far, near]), GIRL).central == 2


def test_a_box_about_the_camera_has_no_angle_and_counts_as_a_right_one() -> None:
    around, ahead, behind = (
        target_record(each, "box", center=(0.0, 0.0, z)) for each, z in ((1, 0.0), (2, 1), (3, -1))
    )
    picked = [choose(frame_record(each), GIRL).central for each in ([around, ahead], [around, behind])]
    assert picked == [2, 1]


def test_the_nearest_in_angle_is_so_to_the_gaze_whatever_its_distance() -> None:
    beside = target_record(1, "beside", center=(0.3, 0.0, 1.5))
    behind_it = target_record(2, "behind it", center=(0.5, 0.0, 5.0))
    record = frame_record([beside, behind_it])
    girl = replace(subject_record("girl", eyes=(0.0, 0.0, 1.0)), gaze=(0.0, 0.0, 2.0))
    found = choose(record, girl)
    assert found.in_angle == 2
    assert found.angle_rad == pytest.approx(acos(4 / sqrt(0.25 + 16)))
    headed = replace(girl, gaze=None, head=(1.0, 0.0, 0.0))  # without gaze, where the head points
    assert choose(record, headed).in_angle == 1
    assert choose(record, replace(headed, head=None)).in_angle is None


@pytest.mark.parametrize(
    ("angles", "hits", "nowhere", "limit"),
    [
        ([0.3, 0.1], [False, True], [True, False], 0.2),  # midway
        ([0.1, 0.2, 0.4], [True, False, False], [False, False, True], 0.3),  # the largest of equally good ones
        ([0.1, 0.3], [True, False], [False, False], inf),
        ([0.1, 0.3], [True, False], [False, True], 0.2),
        ([0.1, 0.3], [False, False], [True, False], -1),
        ([nan, 0.3], [True, False], [False, True], -1),  # an unknown angle hits nothing
        ([], [], [], inf),
    ],
)
def test_the_limit_is_midway_between_two_angles_and_the_largest_of_the_best(
    angles: list[float], hits: list[bool], nowhere: list[bool], limit: float
) -> None:
    assert best_limit_rad(np.array(angles), np.array(hits, bool), np.array(nowhere, bool)) == pytest.approx(limit)


def test_the_limit_is_best_among_all_limits() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        angles = np.round(rng.random(20), 1)
        nowhere = rng.random(20) < 0.4
        hits = (rng.random(20) < 0.6) & ~nowhere
        angles[rng.random(20) < 0.1] = nan
        limit = best_limit_rad(angles, hits, nowhere)

        def right(limit: float, angles=angles, hits=hits, nowhere=nowhere) -> int:  # type: ignore[no-untyped-def]
            return int(np.sum((angles <= limit) & hits) + np.sum((angles > limit) & nowhere))

        assert right(limit) == max(right(each) for each in (-1, *np.arange(0, 1.05, 0.05), inf))
