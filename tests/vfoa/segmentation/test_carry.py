"""Masks carried by optical flow, on textured pictures whose motion is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.scenes import make_rig
from vfoa.segmentation.key_frames import KeyFrameSegmenter, carry, motion_between, no_motion, path_to, shrunk
from vfoa.types import Image, Instance, Instances, Mask, StereoFrame

WIDTH, HEIGHT = 320, 240
CUP = Instance(id=3, label="cup", category_id=47, is_thing=True, score=0.9)
BALL = Instance(id=5, label="sports ball", category_id=37, is_thing=True, score=0.8)


def texture(seed: int) -> Image:
    """Blurred noise: gradients in every direction, at a scale that optical flow can follow."""
    noise = np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), 3)
    return np.asarray(cv2.normalize(blurred, None, 0, 255, cv2.NORM_MINMAX), dtype=np.uint8)


def frame(image: Image, index: int) -> StereoFrame:
    rig = make_rig(image.shape[1], image.shape[0])
    return StereoFrame(index=index, time_ns=0, left=image, right=image, rig=rig)


def box(u0: int, v0: int, width: int = 100, height: int = 80) -> Mask:
    mask = np.zeros((HEIGHT, WIDTH), np.bool_)
    mask[v0 : v0 + height, u0 : u0 + width] = True
    return mask


def scene(mask: Mask, du: int = 0, dv: int = 0) -> Image:
    """A textured object over a still background; the object's texture moves with it."""
    image = texture(0).copy()
    image[mask] = np.roll(texture(1), (dv, du), axis=(0, 1))[mask]
    return image


def cup(mask: Mask) -> Instances:
    return Instances(ids=mask.astype(np.uint16) * CUP.id, instances=(CUP,))


def carried(masks: Instances, *frames: StereoFrame) -> Instances | None:
    """The masks of the first frame, carried through all of them to the last one."""
    images = [shrunk(each.left) for each in frames]
    motion = no_motion(images[0])
    for before, after in pairwise(images):
        motion = motion.then(motion_between(before, after))
    return carry(masks, frames[0], frames[-1], motion)


def overlap(one: Mask, other: Mask) -> float:
    return float((one & other).sum() / (one | other).sum())


@settings(max_examples=15)
@given(du=st.integers(-12, 12), dv=st.integers(-12, 12))
def test_a_mask_follows_its_object(du: int, dv: int) -> None:
    key, now = frame(scene(box(110, 80)), 7), frame(scene(box(110 + du, 80 + dv), du, dv), 9)
    found = carried(cup(box(110, 80)), key, now)
    assert found is not None
    assert (found.carried_from, found.instances) == (7, (CUP,))
    # what the object uncovers has no place in the key frame: some of it stays with the object
    assert overlap(found.mask(CUP.id), box(110 + du, 80 + dv)) > 0.79


def test_masks_say_how_old_they_are() -> None:
    key, now = (replace(frame(scene(box(40, 30)), index), time_ns=index * 40_000_000) for index in (3, 8))
    found = carried(cup(box(40, 30)), key, now)
    assert found is not None
    assert found.carried_s == pytest.approx(0.2)


def test_an_object_too_fast_for_one_step_is_followed_over_several() -> None:
    moved = [frame(scene(box(20 + 8 * n, 80), 8 * n), n) for n in range(9)]
    assert carried(cup(box(20, 80)), moved[0], moved[-1]) is None
    found = carried(cup(box(20, 80)), *moved)
    assert found is not None
    assert overlap(found.mask(CUP.id), box(84, 80)) > 0.5


class OnFirst:
    """A segmenter that finds the cup where it is in the first frame."""

    def segment(self, frame: StereoFrame) -> Instances:
        return cup(box(20, 80))


@pytest.mark.parametrize("asked", [range(9), [8]], ids=["in order", "the last one alone"])
def test_a_segmenter_on_key_frames_follows_an_object_from_frame_to_frame(asked: Sequence[int]) -> None:
    moved = [frame(scene(box(20 + 8 * n, 80), 8 * n), n) for n in range(9)]
    segmenter = KeyFrameSegmenter(OnFirst(), lambda number: path_to(number, range(9), 9), moved.__getitem__)
    *_, found = [segmenter.segment(moved[number]) for number in asked]
    expected = carried(cup(box(20, 80)), *moved)
    assert expected is not None
    assert found.carried_from == 0
    assert np.array_equal(found.ids, expected.ids)


def test_what_was_lost_once_stays_lost() -> None:
    seen, cut = frame(scene(box(110, 80)), 1), frame(texture(9), 2)
    assert carried(cup(box(110, 80)), seen, cut, seen) is None
    small = frame(texture(0)[:200], 2)
    assert carried(cup(box(110, 80)), seen, small, seen) is None


def test_masks_of_a_still_picture_stay_as_they_are() -> None:
    masks = cup(box(40, 30))
    found = carried(masks, frame(scene(box(40, 30)), 1), frame(scene(box(40, 30)), 2))
    assert found is not None
    np.testing.assert_array_equal(found.ids, masks.ids)


def test_a_large_picture_is_followed_at_its_own_scale() -> None:
    size = (4 * WIDTH, 4 * HEIGHT)
    before, after, mask = (
        np.asarray(cv2.resize(each, size, interpolation=cv2.INTER_NEAREST))
        for each in (scene(box(110, 80)), scene(box(116, 76), 6, -4), box(110, 80).astype(np.uint16))
    )
    found = carried(Instances(ids=mask * CUP.id, instances=(CUP,)), frame(before, 1), frame(after, 2))
    assert found is not None
    expected = np.roll(mask, (-16, 24), axis=(0, 1)) > 0
    assert overlap(found.mask(CUP.id), expected) > 0.9


def test_an_object_that_has_left_the_picture_is_dropped() -> None:
    masks = np.zeros((HEIGHT, WIDTH), np.uint16)
    masks[box(120, 80)], masks[box(0, 100, 10, 10)] = CUP.id, BALL.id
    picture = texture(2)
    moved = np.roll(picture, -14, axis=1)
    found = carried(Instances(ids=masks, instances=(CUP, BALL)), frame(picture, 1), frame(moved, 2))
    assert found is not None
    assert found.instances == (CUP,)


@pytest.mark.parametrize("other", [texture(9), np.zeros((HEIGHT, WIDTH, 3), np.uint8), texture(0)[:200]])
def test_masks_are_not_carried_over_a_cut_or_to_another_size(other: Image) -> None:
    assert carried(cup(box(110, 80)), frame(scene(box(110, 80)), 1), frame(other, 2)) is None


def test_one_object_that_cannot_be_followed_is_enough() -> None:
    masks = np.zeros((HEIGHT, WIDTH), np.uint16)
    masks[box(20, 20)], masks[box(180, 120)] = CUP.id, BALL.id
    gone = texture(0).copy()
    gone[box(180, 120)] = texture(8)[box(180, 120)]
    assert carried(Instances(ids=masks, instances=(CUP, BALL)), frame(texture(0), 1), frame(gone, 2)) is None


def test_threads_change_nothing() -> None:
    key, now = frame(scene(box(110, 80)), 1), frame(scene(box(118, 75), 8, -5), 2)
    before = cv2.getNumThreads()
    try:
        found = []
        for threads in (1, 2, 5):
            cv2.setNumThreads(threads)
            found.append(carried(cup(box(110, 80)), key, now))
    finally:
        cv2.setNumThreads(before)
    for each in found:
        np.testing.assert_array_equal(each.ids, found[0].ids)
