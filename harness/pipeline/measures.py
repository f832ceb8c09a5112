"""Errors of each stage against the ground truth, if the clip has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.pipeline.ground_truth import LEAST_OVERLAP, truth_of
from harness.pipeline.stage_runner import Memo
from harness.sources import Clip, PersonTruth, Truth
from vfoa.geometry import angle_between, box_corners, box_iou
from vfoa.types import Box3D, Disparity, Float, Instances, Percepts, Person, Scene, Target

BAD_PX = 2.0
"""A disparity with a larger error than this is called bad."""

MATCH_IOU = 0.5
"""Masks that overlap more belong to one object: no two disjoint masks can both do so (Kirillov et al. 2019)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DisparityMeasure:
    """A disparity map against the true one, over the pixels with known ground truth.

    ``error_px`` is the median error, ``over_2_px`` the share of errors above 2 px, both over pixels with a disparity;
    None if there are none. ``known`` is the share of pixels with a disparity.
    """

    error_px: float | None
    over_2_px: float | None
    known: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetMeasure:
    """A true object or person against the instance found for it; ``instance_id`` is None if none was found.

    The IoUs are those of the masks and of the 3D boxes, along the camera's axes, 0 if none was found;
    ``center_error_m`` is between the boxes' centres, None if no box was found. None for both: no true box.
    """

    truth_id: int
    label: str
    instance_id: int | None
    mask_iou: float
    box_iou: float | None
    center_error_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PersonMeasure:
    """Errors of one person's head before any filter. None: not measured, or no ground truth.

    ``head_box_iou`` is 0 if no head was found.
    """

    name: str
    head_box_iou: float
    eye_error_m: float | None
    head_error_deg: float | None
    gaze_error_deg: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameMeasures:
    """Errors of each stage in one frame, as far as the clip has ground truth."""

    disparity: DisparityMeasure | None
    targets: tuple[TargetMeasure, ...]
    people: tuple[PersonMeasure, ...]


class Measurer:
    """Measures one clip's frames; outputs that configurations share are measured once."""

    def __init__(self, clip: Clip) -> None:
        self._clip = clip
        self._frame: int | None = None
        self._memo = Memo()

    def measure(self, percepts: Percepts, scene: Scene) -> FrameMeasures | None:
        """Measure one configuration's percepts and scene; None without any ground truth."""
        if percepts.index != self._frame:
            self._frame, self._memo = percepts.index, Memo()
        truth = truth_of(self._clip, percepts.index)
        if truth.disparity is None and truth.instances is None and truth.people is None:
            return None
        call = self._memo.call
        return FrameMeasures(
            disparity=call("disparity", measure_disparity, percepts.disparity, truth.disparity),
            targets=self._targets(percepts.instances, scene.targets, truth),
            people=call("people", measure_people, scene, truth),
        )

    def _targets(self, instances: Instances, targets: tuple[Target, ...], truth: Truth) -> tuple[TargetMeasure, ...]:
        if truth.instances is None:
            return ()
        matches = self._memo.call("masks", match_masks, instances, truth.instances)
        return self._memo.call("targets", measure_targets, matches, targets, truth.instances, truth.boxes)


def measure_disparity(disparity: Disparity, true: Disparity | None) -> DisparityMeasure | None:
    """Measure a disparity map on every second row and column; None without ground truth."""
    if true is None:
        return None
    sampled = true.disparity_px[::2, ::2]
    expected = np.isfinite(sampled)
    if not expected.any():
        return None
    error = np.abs(disparity.disparity_px[::2, ::2] - sampled)[expected]
    error = error[np.isfinite(error)]
    return DisparityMeasure(
        error_px=float(np.median(error)) if len(error) else None,
        over_2_px=float(np.mean(error > BAD_PX)) if len(error) else None,
        known=len(error) / int(expected.sum()),
    )


Matches = Mapping[int, tuple[int, float]]
"""By true id: the id of the instance that was found for it, and the IoU of their masks."""


def match_masks(instances: Instances, true: Instances) -> Matches:
    """Pair the masks that overlap by more than :data:`MATCH_IOU`."""
    (true_ids, rows), (own_ids, columns) = _places(true), _places(instances)
    size = len(true_ids), len(own_ids)
    pairs = (rows.astype(np.intp) * size[1] + columns).ravel()
    common = np.bincount(pairs, minlength=size[0] * size[1]).reshape(size)
    iou = common / np.maximum(common.sum(axis=1, keepdims=True) + common.sum(axis=0) - common, 1)
    return {true_ids[i]: (own_ids[j], float(iou[i, j])) for i, j in np.argwhere(iou > MATCH_IOU) if i > 0 and j > 0}


def _places(instances: Instances) -> tuple[list[int], NDArray[np.uint16]]:
    """The ids that occur, 0 first, and the index (H, W) of each pixel's id among them.

    Ids can be as large as 65,535: a table over all numbers would take too much memory.
    """
    ids = [0, *(instance.id for instance in instances.instances)]
    place = np.zeros(2**16, np.uint16)
    place[ids] = np.arange(len(ids))
    return ids, place.take(instances.ids)


def measure_targets(
    matches: Matches, targets: tuple[Target, ...], true: Instances, true_boxes: Mapping[int, Box3D] | None
) -> tuple[TargetMeasure, ...]:
    """Measure every visible true object and person against the instance with the matching mask."""
    boxes = {target.instance.id: target.box for target in targets}
    measures = []
    for instance in true.instances:
        if not instance.is_thing:
            continue
        found_id, mask_iou = matches.get(instance.id, (None, 0.0))
        box = boxes.get(found_id) if found_id is not None else None
        true_box = (true_boxes or {}).get(instance.id)
        missed = None if true_box is None else 0.0
        measures.append(
            TargetMeasure(
                truth_id=instance.id,
                label=instance.label,
                instance_id=found_id,
                mask_iou=mask_iou,
                box_iou=box_iou_3d(box, true_box) if box and true_box else missed,
                center_error_m=_distance_m(box.center_m, true_box.center_m) if box and true_box else None,
            )
        )
    return tuple(measures)


def measure_people(scene: Scene, truth: Truth) -> tuple[PersonMeasure, ...]:
    """Measure every true person against the head that overlaps theirs most; () if the people are not known."""
    return tuple(_measure_person(person, scene) for person in truth.people or ())


def _measure_person(true: PersonTruth, scene: Scene) -> PersonMeasure:
    overlaps = [box_iou(true.head_box_px, person.head.box_px) if person.head else 0.0 for person in scene.people]
    best = int(np.argmax(overlaps)) if overlaps else 0
    if not overlaps or overlaps[best] < LEAST_OVERLAP:
        return PersonMeasure(
            name=true.name, head_box_iou=0.0, eye_error_m=None, head_error_deg=None, gaze_error_deg=None
        )
    person: Person = scene.people[best]
    pose, gaze = person.view.head_pose, person.view.gaze
    return PersonMeasure(
        name=true.name,
        head_box_iou=overlaps[best],
        eye_error_m=_distance_m(person.eye_origin_left, true.eye_origin_left),
        head_error_deg=_angle_deg(pose.direction if pose else None, true.head_direction),
        gaze_error_deg=_angle_deg(gaze.direction if gaze else None, true.gaze_direction),
    )


def box_iou_3d(a: Box3D, b: Box3D) -> float:
    """Intersection over union, in [0, 1], of two boxes' extents along the camera's axes."""
    corners = box_corners((a, b))
    low, high = corners.min(axis=1), corners.max(axis=1)
    common = float(np.prod(np.maximum(high.min(axis=0) - low.max(axis=0), 0)))
    return common / (float(np.prod(high - low, axis=1).sum()) - common)


def _distance_m(estimated: Float | None, true: Float | None) -> float | None:
    return None if estimated is None or true is None else float(np.linalg.norm(estimated - true))


def _angle_deg(estimated: Float | None, true: Float | None) -> float | None:
    return None if estimated is None or true is None else float(np.degrees(angle_between(estimated, true)))
