"""Notes that question the unit of a clip's depth, and whether its people are near enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.run.notes import NoteKind
from harness.score.reference import Reference
from harness.score.score import score as score_columns
from tests.records import columns_by_pair, frame_record, labels, score, subject_record, target_record


@pytest.mark.parametrize(
    ("widths_m", "is_questioned"),
    [
        ((0.16, 0.18, 0.2), False),
        ((0.12, 0.4, 0.2), False),
        ((0.77, 0.8, 0.75), True),  # 4000 counts per metre read as millimetres
        ((0.04, 0.05, 0.05), True),
        ((0.2, 0.21, 5.0), False),  # one box that is cut off or too large
        ((None, None, None), False),
    ],
)
def test_heads_of_no_usual_size_question_the_unit_of_depth(
    widths_m: tuple[float | None, ...], is_questioned: bool
) -> None:
    records = [
        frame_record(subjects=[replace(subject_record("girl"), head_width_m=width_m)], frame=4 * place + number)
        for place, width_m in enumerate(widths_m)
        for number in range(4)
    ]
    doubts = score(records, Reference(labels={})).notes
    assert [(note.kind, "depth_scale" in note.text) for note in doubts] == [(NoteKind.DOUBT, True)] * is_questioned


@pytest.mark.parametrize(
    ("heights_px", "gaze", "is_told"),
    [
        ((70.0, 65.0, 30.0), "adas_0002", False),
        ((40.0, 42.0, 90.0), "adas_0002", True),
        ((40.0, 42.0, 90.0), "of_another_package", True),
        ((40.0, 42.0, 90.0), "simulated", False),
        ((40.0, 42.0, 90.0), None, False),
        ((None, None, None), "adas_0002", False),
    ],
)
def test_faces_too_small_for_a_gaze_network_are_told(
    heights_px: tuple[float | None, ...], gaze: str | None, is_told: bool
) -> None:
    boxes = [None if height is None else (10.0, 20.0, 30.0, 20.0 + height) for height in heights_px]
    records = [
        frame_record(subjects=[replace(subject_record("girl"), head_box_px=box)], frame=4 * place + number)
        for place, box in enumerate(boxes)
        for number in range(4)
    ]
    settings = {"one": {"gaze": None if gaze is None else {"model": gaze}}}
    doubts = [note.text for note in score(records, Reference(labels={}, settings=settings)).notes]
    assert ["42 px high" in text for text in doubts] == [True] * is_told


@pytest.mark.parametrize(
    ("box", "model", "is_told"),
    [
        ((10.0, 20.0, 90.0, 120.0), "adas_0002", False),
        ((-5.0, 20.0, 90.0, 120.0), "adas_0002", True),
        ((10.0, 0.0, 90.0, 120.0), "adas_0002", True),
        ((560.0, 20.0, 639.5, 120.0), "adas_0002", True),
        ((10.0, 380.0, 90.0, 481.0), "adas_0002", True),
        ((-5.0, 20.0, 90.0, 120.0), "truth", False),
        (None, "adas_0002", False),
    ],
)
@pytest.mark.parametrize("stage", ["gaze", "head_pose"])
@pytest.mark.parametrize("cut", [2, 3])
def test_heads_that_the_border_cuts_are_told(
    box: tuple[float, float, float, float] | None, model: str, is_told: bool, stage: str, cut: int
) -> None:
    """In 10 frames of 640 x 480 pixels: 2 of 10 are not too many. People whose head is not found do not count."""
    whole, boy = (100.0, 100.0, 180.0, 200.0), replace(subject_record("boy"), head_box_px=None)
    records = [
        frame_record(
            subjects=[replace(subject_record("girl"), head_box_px=box if n < cut else whole), boy], frame=1 + n
        )
        for n in range(10)
    ]
    (columns,) = columns_by_pair(records, size_px=(640, 480))
    notes = score_columns([columns], Reference(labels={}, settings={"one": {stage: {"model": model}}})).notes
    assert ["border cuts 30 %" in note.text for note in notes] == [True] * (is_told and cut == 3)


@pytest.mark.parametrize(
    ("boxes", "eyes", "told"),
    [
        (0, 0, []),
        (1, 1, []),
        (2, 0, ["20 % of the 3D boxes are"]),
        (0, 3, ["30 % of the eyes are"]),
        (2, 3, ["20 % of the 3D boxes and 30 % of the eyes are"]),
    ],
)
def test_boxes_and_eyes_that_often_have_no_depth_of_their_own_are_told(boxes: int, eyes: int, told: list[str]) -> None:
    without_box = target_record(2, "can", center=None)
    records = [
        frame_record(
            [replace(target_record(1, "cup"), depth_from=0 if frame < boxes else None), without_box],
            [replace(subject_record("girl"), depth_from=0 if frame < eyes else None), subject_record("boy", eyes=None)],
            frame=1 + frame,
        )
        for frame in range(10)
    ]
    doubts = score(records, Reference(labels={})).notes
    assert [(note.kind, text in note.text) for note, text in zip(doubts, told, strict=True)] == [
        (NoteKind.DOUBT, True)
    ] * len(told)


@pytest.mark.parametrize(
    ("depth_m", "matcher", "is_told"),
    [(2.0, "bm", False), (6.0, "bm", True), (6.0, "truth", False), (6.0, "sensor", False), (6.0, None, False)],
)
def test_eyes_too_far_for_the_stereo_pair_are_told(depth_m: float, matcher: str | None, is_told: bool) -> None:
    """A pair of 0.1 m and 600 px: half a pixel is 0.03 m at 2 m, 0.3 m at 6 m."""
    records = [
        frame_record(subjects=[subject_record("girl", eyes=(0.0, 0.0, depth_m))], frame=frame) for frame in range(8)
    ]
    (columns,) = columns_by_pair(records)
    with_rig = replace(columns, scene=replace(columns.scene, pixel_metres=np.full(8, 60.0)))
    settings = {"one": {"stereo": matcher and {"matcher": matcher}}}
    notes = score_columns([with_rig], Reference(labels={}, settings=settings)).notes  # type: ignore[arg-type]
    assert ["6.0 m away (median), where half a pixel of disparity is 0.30 m" in note.text for note in notes] == (
        [True] * is_told
    )


@pytest.mark.parametrize(("names", "is_questioned"), [(("cup", "book"), True), (("cup", "cup"), False)])
def test_labels_of_which_several_objects_are_right_do_not_question_the_axes(
    names: tuple[str, str], is_questioned: bool
) -> None:
    """A person looks at the right one of two objects on both sides: with x negated, that would be the left one."""
    centers = ((-0.8, 0.0, 2.0), (0.8, 0.0, 2.0))
    things = [target_record(n, names[n - 1], center=centers[n - 1]) for n in (1, 2)]
    ahead = target_record(3, "lamp", center=(0.0, 0.3, 2.0))
    ways = ((0.8, 0.0, 1.0), (0.0, 0.3, 1.0))
    girl = subject_record("girl", eyes=(0.0, 0.0, 1.0))
    records = [frame_record([*things, ahead], [replace(girl, gaze=ways[n % 8 > 3])], frame=n) for n in range(1, 161)]
    told = labels(*("lamp" if n % 8 > 3 else "cup" for n in range(1, 161)))
    notes = [note.text for note in score(records, Reference(labels={"clip": told})).notes]
    assert [True for text in notes if "x negated" in text] == [True] * is_questioned
