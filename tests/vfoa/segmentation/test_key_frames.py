"""Segmenters that run on key frames only: which frames those are, and what the frames between get."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_rig
from vfoa.segmentation.key_frames import KeyFrameSegmenter, key_number
from vfoa.types import Image, Instance, Instances, StereoFrame

RIG = make_rig(64, 48)
PICTURE = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
NUMBERS = (10, 11, 13, 20, 21, 22, 30)


def frame(number: int, image: Image = PICTURE) -> StereoFrame:
    return StereoFrame(index=number, time_ns=0, left=image, right=image, rig=RIG)


class Segmenter:
    """Finds one thing whose category is the number of the frame, and keeps the numbers that it was asked for."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def segment(self, frame: StereoFrame) -> Instances:
        self.asked.append(frame.index)
        thing = Instance(id=1, label="thing", category_id=frame.index, is_thing=True, score=1.0)
        return Instances(ids=np.ones((48, 64), np.uint16), instances=(thing,))


def on_key_frames(segmenter: Segmenter, every: int = 3) -> KeyFrameSegmenter:
    return KeyFrameSegmenter(segmenter, lambda number: key_number(number, NUMBERS, every), frame)


def test_key_frames_are_counted_among_the_frames_of_the_clip() -> None:
    assert [key_number(number, NUMBERS, 3) for number in NUMBERS] == [10, 10, 10, 20, 20, 20, 30]
    assert [key_number(number, NUMBERS, 1) for number in NUMBERS] == list(NUMBERS)
    assert [key_number(number, NUMBERS, 3) for number in (9, 12, 31)] == [9, 12, 31]


def test_the_segmenter_runs_on_key_frames_and_the_others_say_whose_masks_they_have() -> None:
    segmenter = Segmenter()
    found = [on.segment(frame(number)) for on in [on_key_frames(segmenter)] for number in NUMBERS]
    assert segmenter.asked == [10, 20, 30]
    assert [each.carried_from for each in found] == [None, 10, 10, None, 20, 20, None]
    assert [each.instances[0].category_id for each in found] == [10, 10, 10, 20, 20, 20, 30]


@given(order=st.permutations(NUMBERS))
def test_masks_do_not_depend_on_the_order_of_the_frames(order: list[int]) -> None:
    segmenter = on_key_frames(Segmenter())
    for number in order:
        found = segmenter.segment(frame(number))
        key = key_number(number, NUMBERS, 3)
        assert (found.carried_from, found.instances[0].category_id) == (None if key == number else key, key)


def test_a_frame_to_which_masks_cannot_be_carried_is_segmented() -> None:
    segmenter = Segmenter()
    carried = on_key_frames(segmenter)
    carried.segment(frame(10))
    found = carried.segment(frame(11, np.zeros_like(PICTURE)))
    assert (found.carried_from, found.instances[0].category_id) == (None, 11)
    assert carried.segment(frame(13)).carried_from == 10
    assert segmenter.asked == [10, 11]


def test_a_key_frame_that_failed_is_not_remembered() -> None:
    class Fails(Segmenter):
        def segment(self, frame: StereoFrame) -> Instances:
            if frame.index == 20 and 20 not in self.asked:
                self.asked.append(20)
                raise ValueError("once")
            return super().segment(frame)

    carried = on_key_frames(Fails())
    carried.segment(frame(10))
    with pytest.raises(ValueError, match="once"):
        carried.segment(frame(20))
    assert carried.segment(frame(21)).carried_from == 20
