"""The measures of a frame: the errors of each stage against the ground truth, as plain values."""

from __future__ import annotations

from dataclasses import dataclass


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

    The IoUs are those of the masks and of the 3D boxes, along the camera's axes; ``center_error_m`` is between the
    boxes' centres. None: no true box, or none found.
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
