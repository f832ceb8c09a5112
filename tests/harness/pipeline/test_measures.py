"""Stages against the truth: what each measure says of results whose error is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from harness.pipeline.measures import (
    Measurer,
    TargetMeasure,
    box_iou_3d,
    match_masks,
    measure_disparity,
    measure_people,
    measure_targets,
)
from harness.sources import PersonTruth, Truth
from tests.scenes import make_box, make_person, make_rig, make_target
from vfoa.geometry import perturb
from vfoa.types import Disparity, Instance, Instances, Percepts, Person, Scene, Target

SHAPE = (40, 60)


def disparity(value: float | np.ndarray) -> Disparity:
    return Disparity(disparity_px=np.broadcast_to(value, SHAPE).astype(np.float32).copy())


def masks(*columns: tuple[int, int, int]) -> Instances:
    """Instances (id, first column, end column) over all rows."""
    ids = np.zeros(SHAPE, np.uint16)
    for number, first, end in columns:
        ids[:, first:end] = number
    listed = (Instance(id=n, label="cup", category_id=1, is_thing=True, score=1.0) for n, _, _ in columns)
    return Instances(ids=ids, instances=tuple(listed))


def scene(people: tuple[Person, ...] = ()) -> Scene:
    return Scene(index=1, time_ns=0, targets=(), people=people)


class TestDisparity:
    def test_error_bad_share_and_known_share(self) -> None:
        """Of a true map that is known on three quarters: half is right, a quarter 3 px off, a quarter unknown."""
        columns = np.arange(SHAPE[1])
        true = disparity(np.where(columns < 44, 20.0, np.nan))
        found = disparity(np.select([columns < 24, columns < 36, columns < 44], [20.25, 23.0, np.nan], 99.0))
        measure = measure_disparity(found, true)
        assert measure is not None
        assert measure.error_px == pytest.approx(0.25)
        assert measure.over_2_px == pytest.approx(12 / 36)
        assert measure.known == pytest.approx(36 / 44)

    def test_a_map_without_any_value_has_no_error(self) -> None:
        measure = measure_disparity(disparity(np.nan), disparity(5.0))
        assert measure is not None
        assert (measure.error_px, measure.over_2_px, measure.known) == (None, None, 0.0)

    def test_the_truth_itself_is_right_everywhere_and_no_truth_measures_nothing(self) -> None:
        true = disparity(np.where(np.arange(SHAPE[1]) < 45, 20.0, np.nan))
        assert measure_disparity(true, true) == measure_disparity(disparity(true.disparity_px), true)
        assert measure_disparity(disparity(5.0), disparity(np.nan)) is None
        assert measure_disparity(disparity(5.0), None) is None


def measured(found: Instances, targets: tuple[Target, ...], truth: Truth) -> tuple[TargetMeasure, ...]:
    assert truth.instances is not None
    return measure_targets(match_masks(found, truth.instances), targets, truth.instances, truth.boxes)


class TestTargets:
    def test_ids_may_be_as_great_as_sixteen_bits_allow(self) -> None:
        true, found = masks((65_535, 0, 20), (40_000, 20, 40)), masks((65_000, 0, 20), (65_535, 20, 40))
        assert match_masks(found, true) == {65_535: (65_000, 1.0), 40_000: (65_535, 1.0)}

    def test_every_mask_has_its_own_and_the_background_none(self) -> None:
        true, found = masks((1, 0, 10), (2, 20, 30), (3, 40, 44)), masks((3, 0, 10), (1, 20, 32))
        assert match_masks(found, true) == {1: (3, 1.0), 2: (1, pytest.approx(10 / 12))}

    def test_a_box_is_measured_only_against_a_box(self) -> None:
        true, found = masks((1, 0, 10), (2, 20, 30), (3, 40, 50)), masks((1, 0, 10), (2, 20, 30), (3, 40, 50))
        box = make_box((0, 0, 2))
        targets = (make_target(1, box), make_target(2, None), make_target(3, box))
        measures = measured(found, targets, Truth(instances=true, boxes={2: box, 3: box}))
        assert [(measure.box_iou, measure.center_error_m) for measure in measures] == [
            (None, None),
            (0, None),
            (1, 0),
        ]

    def test_a_thing_is_measured_against_the_mask_that_is_the_same(self) -> None:
        """Another number, five of twenty columns too few; the box is as large, a quarter of its width aside."""
        true, found = masks((3, 10, 30)), masks((7, 10, 25), (8, 40, 50))
        shifted = make_target(7, make_box((0.1, 0, 2), 0.2))
        truth = Truth(instances=true, boxes={3: make_box((0, 0, 2), 0.2)})
        (measure,) = measured(found, (shifted,), truth)
        assert (measure.truth_id, measure.instance_id, measure.label) == (3, 7, "cup")
        assert measure.mask_iou == pytest.approx(15 / 20)
        assert measure.box_iou == pytest.approx(0.75 / 1.25)
        assert measure.center_error_m == pytest.approx(0.1)

    def test_a_mask_that_is_half_another_thing_is_not_the_same(self) -> None:
        (measure,) = measured(masks((7, 20, 40)), (), Truth(instances=masks((3, 10, 30))))
        assert (measure.instance_id, measure.mask_iou, measure.box_iou) == (None, 0.0, None)
        true = Truth(instances=masks((3, 10, 30)), boxes={3: make_box((0, 0, 2))})
        (measure,) = measured(masks((7, 20, 40)), (), true)
        assert (measure.box_iou, measure.center_error_m) == (0.0, None)

    def test_stuff_is_no_target_and_an_unsegmented_frame_is_missed(self) -> None:
        true = masks((3, 10, 30), (4, 30, 50))
        floor = replace(true.instances[1], is_thing=False)
        truth = Truth(instances=replace(true, instances=(true.instances[0], floor)))
        (measure,) = measured(masks(), (), truth)
        assert (measure.truth_id, measure.instance_id) == (3, None)


class TestPeople:
    TRUE = PersonTruth(
        name="anna",
        instance_id=1,
        head_box_px=np.array([10.0, 10, 30, 30]),
        eye_origin_left=np.array([0.1, 0, 1]),
        head_direction=np.array([0, 0, -1.0]),
        gaze_direction=np.array([0.6, 0, -0.8]),
    )

    def test_each_measurement_against_the_person_whose_head_it_is(self) -> None:
        other = make_person((40, 10, 60, 30))
        near = make_person(
            (10, 10, 30, 25),
            eyes=(0.1, 0.03, 1.04),
            gaze=perturb(self.TRUE.gaze_direction, np.radians(8), 0),
            head=perturb(self.TRUE.head_direction, 0, np.radians(3)),
        )
        (measure,) = measure_people(scene(people=(other, near)), Truth(people=(self.TRUE,)))
        assert measure.name == "anna"
        assert measure.head_box_iou == pytest.approx(0.75)
        assert measure.eye_error_m == pytest.approx(0.05)
        assert measure.head_error_deg == pytest.approx(3)
        assert measure.gaze_error_deg == pytest.approx(8)

    def test_a_head_that_was_not_found_counts_and_has_no_errors(self) -> None:
        (measure,) = measure_people(scene(people=(make_person((40, 10, 60, 30)),)), Truth(people=(self.TRUE,)))
        assert (measure.head_box_iou, measure.eye_error_m, measure.gaze_error_deg) == (0.0, None, None)

    def test_what_was_not_measured_has_no_error(self) -> None:
        blind = make_person((10, 10, 30, 30), eyes=None)
        (measure,) = measure_people(scene(people=(blind,)), Truth(people=(self.TRUE,)))
        assert measure.head_box_iou == 1
        assert (measure.eye_error_m, measure.head_error_deg, measure.gaze_error_deg) == (None, None, None)


numbers = st.floats(-1, 1)
halves = st.tuples(*[st.floats(0.05, 1)] * 3)


@given(st.tuples(numbers, numbers, numbers), halves, st.tuples(numbers, numbers, numbers), halves)
def test_box_iou_is_symmetric_and_one_for_the_same(a, a_half, b, b_half) -> None:
    one, other = make_box(a, a_half), make_box(b, b_half)
    assert box_iou_3d(one, other) == pytest.approx(box_iou_3d(other, one))
    assert 0 <= box_iou_3d(one, other) <= 1 + 1e-12
    assert box_iou_3d(one, one) == pytest.approx(1)


def test_an_oriented_box_counts_by_its_extent_along_the_cameras_axes() -> None:
    turned = make_box((0, 0, 2), 0.1, Rotation.from_euler("y", 45, degrees=True).as_matrix())
    assert box_iou_3d(turned, make_box((0, 0, 2), (0.1 * 2**0.5, 0.1, 0.1 * 2**0.5))) == pytest.approx(1)


class CountingClip:
    """A clip with one truth for all frames."""

    def __init__(self, truth: Truth) -> None:
        self._truth = truth

    def truth(self, number: int) -> Truth:
        return self._truth


def percepts_of(found: Disparity) -> Percepts:
    rig = make_rig(SHAPE[1], SHAPE[0])
    return Percepts(index=1, time_ns=0, rig=rig, disparity=found, instances=masks(), views=())


def test_what_configurations_share_is_measured_once_and_no_truth_gives_nothing() -> None:
    measurer = Measurer(CountingClip(Truth(disparity=disparity(5.0))))  # type: ignore[arg-type]
    shared, other = disparity(6.0), disparity(7.5)
    first, second, third = (measurer.measure(percepts_of(each), scene()) for each in (shared, shared, other))
    assert first is not None
    assert second is not None
    assert third is not None
    assert first.disparity is second.disparity
    assert first.disparity.error_px == pytest.approx(1.0)  # type: ignore[union-attr]
    assert third.disparity.error_px == pytest.approx(2.5)  # type: ignore[union-attr]
    assert Measurer(CountingClip(Truth())).measure(percepts_of(shared), scene()) is None  # type: ignore[arg-type]
