"""Notes that question the unit of a clip's depth, the time of its labels, and the names of its people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from harness.labels.labels import Labels
from harness.run.notes import NoteKind
from harness.run.records import FrameRecord
from harness.score.doubts import _by_shift
from harness.score.reference import Reference
from harness.score.score import score as score_columns
from tests.records import answers, columns_by_pair, frame_record, labels, score, subject_record


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


RATE_HZ, MINUTE = 25, 1500
"""Frames per second of the records, and the frames of a minute."""


def _looks(seed: int, names: Sequence[str] = ("bird", "cup", "mug", "none")) -> list[str]:
    """Two minutes of looks of 0.5 to 3 s."""
    random, found = np.random.default_rng(seed), list[str]()
    while len(found) < 2 * MINUTE:
        found += [str(random.choice(names))] * int(random.integers(RATE_HZ // 2, 3 * RATE_HZ))
    return found[: 2 * MINUTE]


def _answered(truth: Sequence[str], seed: int) -> list[str]:
    """Answers of which one look in five is wrong."""
    wrong, random = _looks(seed + 1000), np.random.default_rng(seed)
    is_wrong = np.repeat(random.random(len(truth) // RATE_HZ + 1) < 0.2, RATE_HZ)
    return [other if bad else name for name, other, bad in zip(truth, wrong, is_wrong, strict=False)]


def _said(records: Sequence[FrameRecord], labelled: Labels) -> list[str]:
    """The notes on labels and names."""
    notes = score(records, Reference(labels={"clip": labelled})).notes
    return [note.text for note in notes if note.kind == NoteKind.DOUBT]


@pytest.mark.parametrize("late", [-1000, -50, -20, 20, 50, 1000])
def test_labels_of_another_time_are_told_by_how_much(late: int) -> None:
    """Labels on a film that begins at another time are all as early, or late."""
    film = [*_looks(2), *_looks(1), *_looks(3)]
    begin = 2 * MINUTE
    shown, labelled = (film[at : at + 2 * MINUTE] for at in (begin, begin - late))
    (said,) = _said(answers(_answered(shown, 1)), labels(*labelled))
    assert f" {abs(late) / RATE_HZ:.1f} s too {'late' if late > 0 else 'early'}" in said
    assert "--offset" in said


@pytest.mark.parametrize("seed", range(4))
def test_labels_that_fit_or_never_fit_are_not_doubted(seed: int) -> None:
    truth = _looks(seed)
    assert _said(answers(_answered(truth, seed)), labels(*truth)) == []
    assert _said(answers(_looks(seed + 50)), labels(*truth)) == []


def _two(girl: Sequence[str], boy: Sequence[str]) -> list[FrameRecord]:
    """Frames of two people, of whom each can be looked at."""
    frames = zip(answers(girl), answers(boy, subject="boy"), strict=True)
    return [replace(one, subjects=(*one.subjects, *other.subjects), targets=one.targets) for one, other in frames]


@pytest.mark.parametrize("is_exchanged", [True, False])
def test_people_who_have_each_others_names_are_named(is_exchanged: bool) -> None:
    things = ("bird", "cup", "mug")
    girl, boy = _looks(7, things), _looks(8, things)
    given = (boy, girl) if is_exchanged else (girl, boy)
    labelled = Labels([*labels(*given[0]).ranges, *labels(*given[1], subject="boy").ranges])
    said = _said(_two(_answered(girl, 7), _answered(boy, 8)), labelled)
    assert len(said) == is_exchanged
    assert all("girl and boy" in text or "boy and girl" in text for text in said)


@pytest.mark.parametrize("is_exchanged", [True, False])
def test_things_that_have_each_others_names_are_named(is_exchanged: bool) -> None:
    """Two cups that are counted from the other side."""
    truth = _looks(9)
    names = {"cup": "mug", "mug": "cup"} if is_exchanged else {}
    said = _said(answers([names.get(name, name) for name in _answered(truth, 9)]), labels(*truth))
    assert len(said) == is_exchanged
    assert all("if cup and mug had" in text or "if mug and cup had" in text for text in said)


def test_a_thing_that_is_always_taken_for_its_neighbour_is_not_doubted() -> None:
    """A bias to one side moves each look on to the next thing."""
    neighbours = {"bird": "cup", "cup": "mug", "mug": "none"}
    truth = _looks(10)
    assert _said(answers([neighbours.get(name, name) for name in truth]), labels(*truth)) == []


@given(
    rows=st.integers(1, 30).flatmap(
        lambda size: st.tuples(*[arrays(np.float64, size, elements=st.integers(0, 1))] * 2)
    ),
    most=st.integers(1, 40),
)
def test_sums_by_shift_are_those_of_every_pair(rows: tuple[np.ndarray, np.ndarray], most: int) -> None:
    now, later = rows
    size = len(now)
    expected = [
        sum(now[place] * later[place + by] for place in range(size) if 0 <= place + by < size)
        for by in range(-most, most + 1)
    ]
    assert _by_shift(now, later, most).tolist() == expected
