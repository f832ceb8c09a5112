"""The crops that a temporal model is shown: each crop's pixels say which frame and person it is of."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_rig, rendered_boxes
from vfoa.gaze.temporal import HeadWindow, with_gazes
from vfoa.tracking import Tracker, TrackingSettings
from vfoa.types import Gaze, Head, HeadView, Image, Percepts, Person, StereoFrame, StereoRig

EMPTY = rendered_boxes(make_rig(), [])
ANNA, BEN = (10.0, 10.0, 30.0, 40.0), (120.0, 10.0, 140.0, 40.0)


class Listener:
    """A temporal model that keeps what it is shown: (frame, person) of each crop."""

    def __init__(self, stride: int) -> None:
        self._stride = stride
        self.shown: list[list[tuple[int, int]]] = []

    def crop(self, frame: StereoFrame, head: Head) -> Image:
        raise AssertionError("the views here have their crops already")

    def stride(self, rate_hz: float | None) -> int:
        return self._stride

    def estimate_sequence(self, crops: Sequence[Image], head: Head, rig: StereoRig) -> Gaze:
        self.shown.append([(int(crop[0, 0, 0]), int(crop[0, 0, 1])) for crop in crops])
        return Gaze(direction=np.array([0, 0, -1.0]), sigma_rad=float(self.shown[-1][3][1]))


def seen(index: int, heads: Sequence[tuple[float, ...]] = (ANNA,), score: float = 1.0) -> Percepts:
    """A frame with these heads; person 0 is Anna, person 1 Ben."""
    views = tuple(
        HeadView(
            head=Head(box_px=np.array(box), score=score),
            head_pose=None,
            gaze=None,
            crop=np.full((2, 2, 3), (index, int(box == BEN), 0), np.uint8),
        )
        for box in heads
    )
    return replace(EMPTY, index=index, views=views)


def add(window: HeadWindow, percepts: Percepts, tracker: Tracker) -> None:
    people = tuple(Person(view=view, instance_id=None, eye_origin_left=None) for view in percepts.views)
    window.add(percepts, tracker.step(people).ids)


def shown(
    frames: Mapping[int, Sequence[tuple[float, ...]]], stride: int, *, ttl: int = 5, step: int = 1
) -> dict[int, list[list[tuple[int, int]]]]:
    """All crops that the model is shown in each frame, fed and asked as a run does."""
    model = Listener(stride)
    window, tracker = HeadWindow(model, None, step), Tracker(TrackingSettings(ttl=ttl))
    found, waiting = {}, sorted(frames)

    def ask(ready: Iterable[int]) -> None:
        for index in ready:
            model.shown = []
            window.gazes(index)
            found[index] = model.shown
            waiting.remove(index)

    for number in sorted(frames):
        add(window, seen(number, frames[number]), tracker)
        ask([index for index in waiting if index + window.look_ahead <= number])
    ask(list(waiting))
    return found


@given(
    numbers=st.sets(st.integers(0, 60), min_size=1),
    stride=st.integers(1, 6),
)
def test_neighbours_are_a_stride_apart_and_a_missing_one_is_the_frame_itself(numbers: set[int], stride: int) -> None:
    found = shown(dict.fromkeys(numbers, (ANNA,)), stride)
    for index in numbers:
        wanted = [index + place * stride for place in (-3, -2, -1, 0, 1, 2, 3)]
        assert found[index] == [[(number if number in numbers else index, 0) for number in wanted]]


def test_at_the_ends_of_the_clip_the_frame_itself_is_repeated() -> None:
    found = shown(dict.fromkeys(range(1, 11), (ANNA,)), 2)
    assert [number for number, _ in found[1][0]] == [1, 1, 1, 1, 3, 5, 7]
    assert [number for number, _ in found[5][0]] == [5, 1, 3, 5, 7, 9, 5]
    assert [number for number, _ in found[10][0]] == [4, 6, 8, 10, 10, 10, 10]


def test_frames_may_be_numbered_in_tens() -> None:
    found = shown(dict.fromkeys(range(10, 110, 10), (ANNA,)), 2, step=10)
    assert [number for number, _ in found[50][0]] == [50, 10, 30, 50, 70, 90, 50]


def test_where_the_head_was_not_found_the_frame_itself_is_repeated() -> None:
    frames = dict.fromkeys(range(1, 9), (ANNA,)) | {3: (), 4: ()}
    found = shown(frames, 1)
    assert found[3] == []
    assert [number for number, _ in found[5][0]] == [2, 5, 5, 5, 6, 7, 8]


def test_frames_numbered_by_jittering_times_are_neighbours() -> None:
    frames = dict.fromkeys((0, 33, 67, 100, 134, 166, 200, 233), (ANNA,))
    found = shown(frames, 1, step=33)
    assert [[number for number, _ in found[index][0]] for index in (100, 134)] == [
        [0, 33, 67, 100, 134, 166, 200],
        [33, 67, 100, 134, 166, 200, 233],
    ]
    del frames[166]
    assert [number for number, _ in shown(frames, 1, step=33)[100][0]] == [0, 33, 67, 100, 134, 100, 200]


def test_a_track_that_ended_gives_no_crops_to_the_one_that_begins() -> None:
    frames = dict.fromkeys(range(1, 9), (ANNA,)) | {3: (), 4: ()}
    found = shown(frames, 1, ttl=1)
    assert [number for number, _ in found[5][0]] == [5, 5, 5, 5, 6, 7, 8]


def test_each_person_has_its_own_crops_in_whatever_order_heads_are_found() -> None:
    found = shown({number: (ANNA, BEN) if number % 2 else (BEN, ANNA) for number in range(1, 9)}, 1)
    around = [1, 2, 3, 4, 5, 6, 7]
    assert found[4] == [[(number, 1) for number in around], [(number, 0) for number in around]]


def test_gazes_stand_at_the_views_they_were_estimated_for() -> None:
    window, tracker = HeadWindow(Listener(1), None), Tracker(TrackingSettings(sigma_l=0.5))
    both = seen(1, (BEN, ANNA))
    faint = replace(both, views=(*both.views, *seen(1, ((60.0, 60.0, 80.0, 90.0),), score=0.1).views))
    add(window, faint, tracker)
    filled = with_gazes(faint, window.gazes(1))
    assert [view.gaze and view.gaze.sigma_rad for view in filled.views] == [1.0, 0.0, None]
    assert [view.head for view in filled.views] == [view.head for view in faint.views]


@pytest.mark.parametrize("stride", [1, 4])
def test_no_more_frames_are_kept_than_a_gaze_needs(stride: int) -> None:
    window, tracker = HeadWindow(Listener(stride), None), Tracker(TrackingSettings())
    alive: list[weakref.ref[Image]] = []
    for number in range(100):
        crop = np.zeros((2, 2, 3), np.uint8)
        alive.append(weakref.ref(crop))
        percepts = seen(number)
        add(window, replace(percepts, views=(replace(percepts.views[0], crop=crop),)), tracker)
        if number >= window.look_ahead:
            window.gazes(number - window.look_ahead)
    del crop
    assert sum(each() is not None for each in alive) == 6 * stride + 1
