"""Segmenters that run on key frames only: which frames those are, and what frames in between reuse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_rig
from vfoa.segmentation.key_frames import KeyFrameSegmenter, path_to
from vfoa.types import Image, Instance, Instances, StereoFrame

RIG = make_rig(64, 48)
PICTURE = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
NUMBERS = (10, 11, 13, 20, 21, 22, 30)
KEYS = (10, 10, 10, 20, 20, 20, 30)
EXPECTED = [(None if key == number else key, key) for key, number in zip(KEYS, NUMBERS, strict=True)]


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


class Fails(Segmenter):
    """Fails at its first attempt on frame 20."""

    def segment(self, frame: StereoFrame) -> Instances:
        if frame.index == 20 and 20 not in self.asked:
            self.asked.append(20)
            raise ValueError("once")
        return super().segment(frame)


def on_key_frames(segmenter: Segmenter, *, reads: bool = True) -> KeyFrameSegmenter:
    return KeyFrameSegmenter(segmenter, lambda number: path_to(number, NUMBERS, 3), frame if reads else None)


def whose(found: Instances) -> tuple[int | None, int]:
    return found.carried_from, found.instances[0].category_id


def test_a_path_begins_at_the_key_frame() -> None:
    paths = [path_to(number, NUMBERS, 3) for number in NUMBERS]
    assert [path[0] for path in paths] == list(KEYS)
    assert [path[-1] for path in paths] == list(NUMBERS)
    assert path_to(22, NUMBERS, 3) == (20, 21, 22)
    assert [path_to(number, NUMBERS, 1) for number in NUMBERS] == [(number,) for number in NUMBERS]
    assert [path_to(number, NUMBERS, 3) for number in (9, 12, 31)] == [(9,), (12,), (31,)]


def test_the_segmenter_runs_on_key_frames_and_the_others_say_whose_masks_they_have() -> None:
    segmenter = Segmenter()
    on = on_key_frames(segmenter, reads=False)
    assert [whose(on.segment(frame(number))) for number in NUMBERS] == EXPECTED
    assert segmenter.asked == [10, 20, 30]


@given(order=st.permutations(NUMBERS))
def test_masks_do_not_depend_on_the_order_of_the_frames(order: list[int]) -> None:
    segmenter = on_key_frames(Segmenter())
    found = {number: whose(segmenter.segment(frame(number))) for number in order}
    assert [found[number] for number in NUMBERS] == EXPECTED


def test_a_frame_to_which_masks_cannot_be_carried_is_segmented() -> None:
    segmenter = Segmenter()
    carried = on_key_frames(segmenter)
    carried.segment(frame(10))
    assert whose(carried.segment(frame(11, np.zeros_like(PICTURE)))) == (None, 11)
    assert segmenter.asked == [10, 11]


def test_after_a_cut_each_frame_is_segmented_until_the_next_key_frame() -> None:
    cut = {number: np.zeros_like(PICTURE) if number >= 13 else PICTURE for number in NUMBERS}
    segmenter = Segmenter()
    carried = on_key_frames(segmenter)
    found = [whose(carried.segment(frame(number, image))) for number, image in cut.items()]
    assert found == [(None, 10), (10, 10), (None, 13), (None, 20), (20, 20), (20, 20), (None, 30)]
    assert segmenter.asked == [10, 13, 20, 30]


def test_a_key_frame_that_failed_is_not_remembered() -> None:
    carried = on_key_frames(Fails(), reads=False)
    for number in (10, 11, 13):
        carried.segment(frame(number))
    with pytest.raises(ValueError, match="once"):
        carried.segment(frame(20))
    assert whose(carried.segment(frame(20))) == (None, 20)
