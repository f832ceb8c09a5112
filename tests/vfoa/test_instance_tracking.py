"""An object keeps its number whatever the segmenter numbers it, and the numbers of a long sequence stay small."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.true_stages import renamed, true_percepts
from vfoa.instance_tracking import PATIENCE, SAME_OBJECT, SAME_UNDER_ANOTHER_LABEL, InstanceTracker, _overlaps
from vfoa.types import Instance, Instances

SIZE = 60, 200


def frame(
    boxes: Mapping[int, tuple[int, int]],
    labels: Mapping[int, str] | None = None,
    names: Mapping[int, str] | None = None,
    *,
    keeps: bool = False,
) -> Instances:
    """Instances by id: a square of 20 px at (column, row), with a label, "cup" by default, and a name or none."""
    ids = np.zeros(SIZE, np.uint16)
    for number, (column, row) in boxes.items():
        ids[row : row + 20, column : column + 20] = number
    instances = tuple(
        Instance(
            id=number,
            label=(labels or {}).get(number, "cup"),
            category_id=47,
            is_thing=True,
            score=0.9,
            name=(names or {}).get(number),
            keeps_id=keeps,
        )
        for number in boxes
    )
    return Instances(ids=ids, instances=instances)


def numbers(frames: Sequence[Instances]) -> list[dict[int, int]]:
    """The number of each id, frame by frame."""
    tracker = InstanceTracker()
    return [dict(tracker.step(each).numbers) for each in frames]


PLACES = [(5, 5), (60, 30), (110, 10), (170, 35)]


@given(data=st.data(), count=st.integers(1, 4), steps=st.integers(2, 6))
def test_objects_that_move_a_little_keep_the_numbers_of_the_first_frame(
    data: st.DataObject, count: int, steps: int
) -> None:
    tracker, places = InstanceTracker(), PLACES[:count]
    for step in range(steps):
        order = data.draw(st.permutations(range(1, count + 1)))
        labels = {number: ("cup", "bowl")[place % 2] for place, number in enumerate(order)}
        if step == 0:
            first = order
        seen = frame(dict(zip(order, places, strict=True)), labels)
        numbered = tracker.step(seen)
        assert numbered.numbers == dict(zip(order, first, strict=True))
        expected = np.zeros(SIZE, np.uint16)
        for number, (column, row) in zip(first, places, strict=True):
            expected[row : row + 20, column : column + 20] = number
        assert np.array_equal(numbered.instances.ids, expected)
        assert [each.label for each in numbered.instances.instances] == [each.label for each in seen.instances]
        moves = [data.draw(st.tuples(st.integers(-4, 4), st.integers(-4, 4))) for _ in places]
        places = [
            (min(max(column + by, 0), 180), min(max(row + down, 0), 40))
            for (column, row), (by, down) in zip(places, moves, strict=True)
        ]


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 5), width=st.integers(1, 8))
def test_overlaps_are_those_of_the_masks_pixel_by_pixel(seed: int, count: int, width: int) -> None:
    last, ids = np.random.default_rng(seed).integers(0, count + 1, (2, 6, width)).astype(np.uint16)
    expected = {
        (before, now): np.count_nonzero((last == before) & (ids == now))
        / np.count_nonzero((last == before) | (ids == now))
        for before in range(1, count + 1)
        for now in range(1, count + 1)
        if ((last == before) & (ids == now)).any()
    }
    assert _overlaps(last, ids) == expected


def test_an_object_is_the_one_that_it_overlaps_most() -> None:
    before, after = frame({1: (50, 20), 2: (75, 20)}), frame({1: (70, 20), 2: (48, 20)})
    assert numbers([before, after]) == [{1: 1, 2: 2}, {2: 1, 1: 2}]


def test_of_the_parts_of_an_object_the_larger_one_is_it() -> None:
    """Twelve of its twenty columns, and eight: both overlap it enough."""
    whole, ids = frame({1: (50, 20), 2: (150, 30)}), frame({5: (50, 20), 2: (150, 30)}).ids.copy()
    ids[:, 62:70][ids[:, 62:70] == 5] = 3
    parts = Instances(ids=ids, instances=tuple(replace(whole.instances[0], id=number) for number in (2, 3, 5)))
    assert numbers([whole, parts])[1] == {2: 2, 3: 3, 5: 1}


@pytest.mark.parametrize("missed", [0, 1, PATIENCE])
@pytest.mark.parametrize(("by", "is_same"), [(10, True), (11, False)])
def test_masks_of_two_frames_are_one_object_if_they_overlap_enough(by: int, is_same: bool, missed: int) -> None:
    share = (20 - by) / (20 + by)
    assert (share >= SAME_OBJECT) == is_same
    another = {2: (150, 30)}  # two cups: neither is alone with its label
    between = [frame(another)] * missed
    *_, last = numbers([frame({1: (50, 20), **another}), *between, frame({1: (50 + by, 20), **another})])
    assert (last[1] == 1) == is_same


@pytest.mark.parametrize("named", [0, 1])
def test_an_object_of_a_name_of_its_own_is_none_that_has_another_label_in_its_place(named: int) -> None:
    """The shape of a robot, drawn in one of two frames, and what a model calls a bowl there."""
    shape, bowl = frame({1: (50, 20)}, {1: "robot"}, {1: "robo"}), frame({1: (50, 20)}, {1: "bowl"})
    assert numbers([shape, bowl] if named == 0 else [bowl, shape]) == [{1: 1}, {1: 2}]


def test_an_object_of_a_name_of_its_own_is_not_any_other_of_its_label() -> None:
    drawn, found = frame({1: (50, 20), 2: (150, 30)}, names={1: "mug"}), frame({1: (100, 20), 2: (150, 30)})
    assert numbers([drawn, found]) == [{1: 1, 2: 2}, {1: 3, 2: 2}]


def test_an_object_that_is_alone_with_its_label_is_the_same_wherever_it_is() -> None:
    labels = {1: "cup", 2: "ball", 3: "cup"}
    jumped = {2: "cup", 1: "ball", 3: "cup"}
    frames = [
        frame({1: (5, 5), 2: (40, 30), 3: (100, 5)}, labels),
        frame({2: (5, 5), 1: (170, 30), 3: (100, 5)}, jumped),
    ]
    assert numbers(frames)[1] == {2: 1, 1: 2, 3: 3}


def labels(frames: Sequence[Instances]) -> list[dict[int, str]]:
    """The label of each number, frame by frame."""
    tracker = InstanceTracker()
    return [{each.id: each.label for each in tracker.step(seen).instances.instances} for seen in frames]


@pytest.mark.parametrize(("by", "is_same"), [(5, True), (6, False)])
def test_another_label_is_the_same_object_only_under_about_the_same_mask(by: int, is_same: bool) -> None:
    share = (20 - by) / (20 + by)
    assert (share >= SAME_UNDER_ANOTHER_LABEL) == is_same
    frames = [frame({1: (50, 20)}, {1: "cup"}), frame({1: (50 + by, 20)}, {1: "bowl"})]
    assert numbers(frames)[1] == ({1: 1} if is_same else {1: 2})
    assert labels(frames)[1] == ({1: "cup"} if is_same else {2: "bowl"})


def test_an_object_has_the_label_that_it_had_most() -> None:
    """Two things, numbered anew in each frame, that are now and then taken for each other, or for something else."""
    lefts, rights = ["cup", "cup", "bowl", "cup", "vase", "cup", "bowl"], ["bowl"] * 2 + ["cup"] * 2 + ["bowl"] * 3
    frames = []
    for step, (left, right) in enumerate(zip(lefts, rights, strict=True)):
        first, second = (1, 2) if step % 2 == 0 else (2, 1)
        frames.append(frame({first: (50, 20), second: (110, 20)}, {first: left, second: right}))
    assert labels(frames) == [{1: "cup", 2: "bowl"}] * len(frames)


def test_a_lasting_change_of_the_label_is_taken_over() -> None:
    frames = [frame({1: (50, 20)}, {1: "cup"})] * 30 + [frame({1: (50, 20)}, {1: "bowl"})] * 11
    found = [each[1] for each in labels(frames)]
    assert found[30:34] == ["cup"] * 4
    assert found[-1] == "bowl"
    assert found == sorted(found, reverse=True)  # once


def test_the_label_of_an_object_with_a_name_is_the_last_one() -> None:
    """Somebody drew it."""
    names = {1: "anna's"}
    frames = [frame({1: (50, 20)}, {1: "cup"}, names)] * 3 + [frame({1: (50, 20)}, {1: "bowl"}, names)]
    assert [each.label for each in InstanceTracker().step(frames[-1]).instances.instances] == ["bowl"]
    assert [*labels(frames)[-1].values()] == ["bowl"]


@pytest.mark.parametrize(("gap", "is_same"), [(PATIENCE, True), (PATIENCE + 1, False)])
def test_an_object_may_be_missed_for_some_frames(gap: int, is_same: bool) -> None:
    there, gone = frame({2: (50, 20), 1: (150, 30)}), frame({1: (150, 30)})
    *_, last = numbers([there, *[gone] * gap, frame({7: (50, 20), 1: (150, 30)})])
    assert (last[7] == 2) == is_same


@pytest.mark.parametrize(("rate_hz", "patience"), [(10, PATIENCE), (25, PATIENCE), (50, 10), (100, 20)])
def test_a_fast_camera_may_miss_an_object_for_as_long_as_one_of_25_frames_a_second(rate_hz: int, patience: int) -> None:
    there, gone = frame({2: (50, 20), 1: (150, 30)}), frame({1: (150, 30)})
    for gap, is_same in ((patience, True), (patience + 1, False)):
        tracker = InstanceTracker()
        for number, each in enumerate([there, *[gone] * gap, frame({7: (50, 20), 1: (150, 30)})]):
            last = tracker.step(each, number * 1_000_000_000 // rate_hz)
        assert (last.numbers[7] == 2) == is_same


def test_a_few_short_intervals_do_not_lengthen_the_gap() -> None:
    """Of a tracker of 10 frames a second whose clock stutters."""
    times_ms, there, gone = [0, 100, 111, 200, 300, 400, 411, 500], frame({2: (50, 20)}), frame({})
    for gap, is_same in ((PATIENCE, True), (PATIENCE + 1, False)):
        tracker = InstanceTracker()
        for each, time_ms in zip([there, *[gone] * gap, frame({7: (50, 20)})], times_ms, strict=False):
            last = tracker.step(each, time_ms * 1_000_000)
        assert (last.numbers[7] == 2) == is_same


def test_an_object_that_is_missed_takes_no_other_that_comes_to_its_place() -> None:
    """One of two cups is pushed past the other, which is missed."""
    frames = [frame({1: (50, 20), 2: (80, 20)}), *[frame({9: (80 - 6 * step, 20)}) for step in range(1, PATIENCE + 5)]]
    assert [*numbers(frames)[1:]] == [{9: 2}] * (PATIENCE + 4)


def carried(instances: Instances, count: int) -> list[Instances]:
    """A key frame and the frames that reuse its masks, the key frame included."""
    return [instances, *[replace(instances, carried_from=1, carried_s=0.04)] * (count - 1)]


@pytest.mark.parametrize("every", [2, 6, 30])
@pytest.mark.parametrize(("gap", "is_same"), [(1, True), (PATIENCE, True), (PATIENCE + 1, False)])
def test_only_frames_that_were_segmented_miss_an_object(every: int, gap: int, is_same: bool) -> None:
    there, gone = frame({2: (50, 20), 1: (150, 30)}), frame({1: (150, 30)})
    key_frames = [there, *[gone] * gap, frame({7: (50, 20), 1: (150, 30)})]
    *_, last = numbers([each for key_frame in key_frames for each in carried(key_frame, every)])
    assert (last[7] == 2) == is_same


@pytest.mark.parametrize("every", [2, 12, 30])
def test_a_wrong_label_that_frames_reuse_counts_once(every: int) -> None:
    key_frames = [frame({1: (50, 20)}, {1: label}) for label in ("cup", "cup", "bowl", "cup")]
    found = labels([each for key_frame in key_frames for each in carried(key_frame, every)])
    assert found == [{1: "cup"}] * (4 * every)


def test_an_object_that_something_else_covered_is_the_same() -> None:
    """An arm reaches over a cup, which is not the only one: the cup is missed, and something else is in its place."""
    two, covered = {1: (50, 20), 2: (150, 30)}, {1: (150, 30), 9: (50, 20)}
    arm = frame(covered, {9: "person"})
    arm = Instances(ids=np.where(np.arange(200) < 80, np.uint16(9), arm.ids), instances=arm.instances)
    *_, last = numbers([frame(two), arm, arm, frame({7: (50, 20), 1: (150, 30)})])
    assert last == {7: 1, 1: 2}


def test_numbers_of_objects_that_are_gone_are_given_again() -> None:
    """There are 65,535: a segmenter that sees things for a frame each would have used them up after an hour."""
    tracker = InstanceTracker()
    used = {
        number
        for step in range(200)
        for number in tracker.step(frame({1: (5, 5), 2: (60 + 20 * (step % 7), 40)})).numbers.values()
    }
    assert max(used) <= 3 + PATIENCE


def test_an_object_with_a_name_is_known_by_it() -> None:
    frames = [
        frame({1: (50, 20), 2: (75, 20)}, names={1: "anna's", 2: "ben's"}),
        frame({1: (50, 20), 2: (75, 20)}, names={1: "ben's", 2: "anna's"}),
    ]
    assert numbers(frames)[1] == {1: 2, 2: 1}


def test_an_object_that_gets_a_name_keeps_its_number_and_is_known_by_it_wherever_it_is() -> None:
    there = {1: (50, 20), 2: (150, 30)}
    moved = frame({7: (100, 20), 8: (50, 20), 2: (150, 30)}, names={7: "mug"})
    assert numbers([frame(there), frame(there, names={1: "mug"}), moved])[1:] == [{1: 1, 2: 2}, {7: 1, 8: 8, 2: 2}]


def test_an_object_of_another_name_in_the_same_place_is_another_one() -> None:
    assert numbers([frame({1: (50, 20)}, names={1: name}) for name in ("anna's", "ben's")]) == [{1: 1}, {1: 2}]


def test_ids_that_the_source_keeps_stay_and_are_taken_by_nothing_else() -> None:
    objects = frame({1: (50, 20), 2: (75, 20)}, keeps=True)
    swapped = frame({1: (75, 20), 2: (50, 20)}, keeps=True)
    assert numbers([objects, swapped]) == [{1: 1, 2: 2}] * 2
    tracker = InstanceTracker()
    tracker.step(frame({1: (5, 5)}))
    together = Instances(
        ids=objects.ids + frame({9: (5, 5)}).ids, instances=(*objects.instances, *frame({9: (5, 5)}).instances)
    )
    found = tracker.step(together).numbers
    assert (found[1], found[2]) == (1, 2)
    assert found[9] not in {1, 2}


def test_another_size_begins_anew() -> None:
    tracker = InstanceTracker()
    tracker.step(frame({1: (50, 20), 2: (75, 20)}))
    cut = frame({1: (75, 20), 2: (50, 20)})
    assert tracker.step(Instances(ids=cut.ids[:, :150], instances=cut.instances)).numbers == {1: 1, 2: 2}


def test_heads_have_the_numbers_of_their_people() -> None:
    percepts = true_percepts()
    ids = [instance.id for instance in percepts.instances.instances]
    tracker = InstanceTracker()
    assert tracker.step(percepts.instances).renumber(percepts) is percepts

    other = dict(zip(ids, ids[1:] + ids[:1], strict=True))
    numbered = tracker.step(renamed(percepts.instances, other))
    assert numbered.numbers == {new: old for old, new in other.items()}
    assert np.array_equal(numbered.instances.ids, percepts.instances.ids)
