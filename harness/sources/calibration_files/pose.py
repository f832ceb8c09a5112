"""Rectify a pair from two cameras and the pose between them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from harness.sources.rectification import Model, RawCalibration, RawCamera, check_lens, check_rotation
from vfoa.errors import VfoaError
from vfoa.types import Float


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """``k`` (3, 3) in pixels, ``d`` OpenCV's coefficients of the model (none: no distortion)."""

    k: Float
    d: Float
    model: Model = "plumb_bob"


def rectify_pose(
    left: Lens, right: Lens, rotation: Float, translation: Float, size_px: tuple[int, int], where: str
) -> RawCalibration:
    """Return the pair with Bouguet's rectification, cropped to common pixels (OpenCV's alpha or balance 0).

    x_right = rotation x_left + translation, in any unit; the fourth column of P2 has the same unit.

    Raises
    ------
    VfoaError
        If the models differ, a matrix is wrong, or the cameras do not stand side by side, left before right.
    """
    for side, lens in (("left", left), ("right", right)):
        check_lens(lens.k, lens.d, lens.model, f"{where}: {side}")
    check_rotation(rotation, where)
    if left.model != right.model:
        raise VfoaError(f"{where}: left is {left.model}, right {right.model}; expected one distortion model")
    if translation.shape != (3,) or not np.isfinite(translation).all() or not translation.any():
        raise VfoaError(f"{where}: T: found {translation.tolist()}; expected three finite numbers that are not all 0")
    try:
        r1, r2, p1, p2 = _rectification(left, right, rotation, translation, size_px)
    except cv2.error as error:
        raise VfoaError(f"{where}: OpenCV finds no rectification for these cameras: {str(error).strip()}") from None
    if abs(p2[1, 3]) > abs(p2[0, 3]):
        raise VfoaError(
            f"{where}: T: {translation.tolist()}: the cameras stand above each other; expected side by side"
        )
    first = RawCamera(size_px=size_px, k=left.k, d=left.d, r=r1, p=p1, model=left.model)
    second = RawCamera(size_px=size_px, k=right.k, d=right.d, r=r2, p=p2, model=right.model)
    return RawCalibration(left=first, right=second, where=where)


def _rectification(
    left: Lens, right: Lens, rotation: Float, translation: Float, size_px: tuple[int, int]
) -> tuple[Float, Float, Float, Float]:
    d_left, d_right = (lens.d if lens.d.size else np.zeros(4) for lens in (left, right))
    # cv2.fisheye refuses views of larger matrices
    pose = np.ascontiguousarray(rotation), np.ascontiguousarray(translation).reshape(3, 1)
    lenses = left.k, d_left, right.k, d_right, size_px
    flag = cv2.CALIB_ZERO_DISPARITY
    found = (
        cv2.fisheye.stereoRectify(*lenses, *pose, flag, newImageSize=size_px, balance=0)[:4]
        if left.model == "equidistant"
        else cv2.stereoRectify(*lenses, *pose, flags=flag, alpha=0)[:4]
    )
    r1, r2, p1, p2 = (np.asarray(matrix, dtype=np.float64) for matrix in found)
    return r1, r2, p1, p2
