"""Segmenters that run on key frames only: which frames those are, and what frames in between reuse."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from threading import Event

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.scenes import make_rig
from vfoa.segmentation.key_frames import KeyFrameSegmenter, KeyFrameSettings, path_to
from vfoa.types import Image, Instance, Instances, StereoFrame

RIG = make_rig(64, 48)
PICTURE = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
NUMBERS = (10, 11, 13, 20, 21, 22, 30)
AT_ONCE, LATE = KeyFrameSettings(every=3), KeyFrameSettings(every=3, delay=2)
KEYS = {AT_ONCE: [10, 10, 10, 20, 20, 20, 30], LATE: [10, 10, 10, 10, 10, 20, 20]}


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


@pytest.fixture
def thread() -> Iterator[Executor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


def on_key_frames(
    segmenter: Segmenter, settings: KeyFrameSettings = AT_ONCE, beside: Executor | None = None, *, reads: bool = True
) -> KeyFrameSegmenter:
    read = frame if reads else None
    return KeyFrameSegmenter(
        segmenter, settings, lambda number: path_to(number, NUMBERS, settings), read, beside=beside
    )


def whose(found: Instances) -> tuple[int | None, int]:
    return found.carried_from, found.instances[0].category_id


def test_a_path_begins_at_the_key_frame_whose_masks_are_due() -> None:
    for settings, keys in KEYS.items():
        paths = [path_to(number, NUMBERS, settings) for number in NUMBERS]
        assert [path[0] for path in paths] == keys
        assert [path[-1] for path in paths] == list(NUMBERS)
    assert path_to(30, NUMBERS, LATE) == (20, 21, 22, 30)
    assert [path_to(number, NUMBERS, KeyFrameSettings()) for number in NUMBERS] == [(number,) for number in NUMBERS]
    assert [path_to(number, NUMBERS, LATE) for number in (9, 12, 31)] == [(9,), (12,), (31,)]


@pytest.mark.parametrize("settings", [AT_ONCE, LATE], ids=["at once", "late"])
def test_the_segmenter_runs_on_key_frames_and_the_others_say_whose_masks_they_have(
    settings: KeyFrameSettings, thread: Executor
) -> None:
    segmenter = Segmenter()
    on = on_key_frames(segmenter, settings, thread, reads=False)
    found = [whose(on.segment(frame(number))) for number in NUMBERS]
    assert found == [(None if key == number else key, key) for key, number in zip(KEYS[settings], NUMBERS, strict=True)]
    thread.shutdown()
    assert segmenter.asked == [10, 20, 30]


@given(order=st.permutations(NUMBERS), settings=st.sampled_from([AT_ONCE, LATE]))
def test_masks_do_not_depend_on_the_order_of_the_frames(order: list[int], settings: KeyFrameSettings) -> None:
    segmenter = on_key_frames(Segmenter(), settings)
    for number in order:
        key = dict(zip(NUMBERS, KEYS[settings], strict=True))[number]
        assert whose(segmenter.segment(frame(number))) == (None if key == number else key, key)


def test_a_frame_waits_for_masks_that_are_due_and_not_before(thread: Executor) -> None:
    held = Event()

    class Slow(Segmenter):
        def segment(self, frame: StereoFrame) -> Instances:
            assert frame.index != 20 or held.wait(20)
            return super().segment(frame)

    on = on_key_frames(Slow(), LATE, thread)
    assert [whose(on.segment(frame(number))) for number in (10, 11, 13, 20, 21)][-1] == (10, 10)
    with ThreadPoolExecutor(1) as other:
        due = other.submit(on.segment, frame(22))
        assert not due.done()
        held.set()
        assert whose(due.result(20)) == (20, 20)


def test_a_frame_to_which_masks_cannot_be_carried_is_segmented() -> None:
    segmenter = Segmenter()
    carried = on_key_frames(segmenter)
    carried.segment(frame(10))
    assert whose(carried.segment(frame(11, np.zeros_like(PICTURE)))) == (None, 11)
    assert segmenter.asked == [10, 11]


def test_after_a_cut_a_frame_gets_the_masks_of_the_first_key_frame_behind_it() -> None:
    cut = {number: np.zeros_like(PICTURE) if number >= 13 else PICTURE for number in NUMBERS}
    segmenter = Segmenter()
    carried = on_key_frames(segmenter, LATE)
    found = [whose(carried.segment(frame(number, image))) for number, image in cut.items()]
    assert found == [(None, 10), (10, 10), (None, 13), (None, 20), (20, 20), (20, 20), (20, 20)]
    assert segmenter.asked == [10, 13, 20]


@pytest.mark.parametrize("settings", [AT_ONCE, LATE], ids=["at once", "late"])
def test_a_key_frame_that_failed_is_not_remembered(settings: KeyFrameSettings, thread: Executor) -> None:
    carried = on_key_frames(Fails(), settings, thread, reads=False)
    before = NUMBERS[: KEYS[settings].index(20)]
    for number in before:
        carried.segment(frame(number))
    now = NUMBERS[len(before)]
    with pytest.raises(ValueError, match="once"):
        carried.segment(frame(now))
    assert whose(carried.segment(frame(now))) == (None if now == 20 else 20, 20)
