"""The calibration of a rectified pair."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from vfoa.errors import VfoaError
from vfoa.types import Float, Image, StereoRig

Item = TypeVar("Item")

SIDE_PX = (4, 16_383)
"""Smallest and largest side of a clip's images: recordings and thumbnails are WebP, which has no larger ones."""
FOCAL_PX = (0.1, 1e6)
PLACE_PX = 1e6
BASELINE_M = (1e-6, 1e4)
"""Bounds of a camera's numbers, far beyond those of real cameras: products of them stay finite."""


def check_camera(size_px: tuple[int, int], focal_px: tuple[float, float], place_px: tuple[float, ...]) -> None:
    """Reject sizes and numbers that no camera has: later steps cannot compute with them.

    Raises
    ------
    VfoaError
        With the numbers.
    """
    if not all(SIDE_PX[0] <= side <= SIDE_PX[1] for side in size_px):
        width, height = size_px
        raise VfoaError(
            f"found images of {width} x {height} pixels; expected {SIDE_PX[0]} to {SIDE_PX[1]} on each side"
        )
    if not all(FOCAL_PX[0] <= focal <= FOCAL_PX[1] for focal in focal_px):
        raise VfoaError(f"fx, fy: found {_listed(focal_px)}; expected {FOCAL_PX[0]:g} to {FOCAL_PX[1]:g} pixels")
    if not all(abs(place) <= PLACE_PX for place in place_px):
        raise VfoaError(f"cx, cy: found {_listed(place_px)}; expected at most {PLACE_PX:g} pixels")


_MOST_SKEW_PX = 0.5


def check_skew(k: Float, where: str) -> None:
    """Raise a :class:`VfoaError` if the axes of a camera matrix (3, 3) are oblique: OpenCV ignores that in silence."""
    if abs(k[0, 1]) > _MOST_SKEW_PX:
        raise VfoaError(
            f"{where}: K: found a skew of {k[0, 1]:g} px; expected none: calibrate again without estimating it"
        )


_CALIBRATED = "the size that the calibration is for"
_FIRST = "as in the first frame: its calibration is for one size, so make a clip of each"


def check_size(size_px: tuple[int, int], expected_px: tuple[int, int], what: str, why: str = _CALIBRATED) -> None:
    """Raise a :class:`VfoaError` if images (``what``) have another (width, height) than the calibration is for."""
    if size_px != expected_px:
        found, expected = (f"{width} x {height}" for width, height in (size_px, expected_px))
        raise VfoaError(f"{what} of {found} pixels; expected {expected}, {why}")


def check_first_size(size_px: tuple[int, int], first_px: tuple[int, int]) -> None:
    """Raise a :class:`VfoaError` if an image has another (width, height) than the clip's first one."""
    check_size(size_px, first_px, "found an image", _FIRST)


def first_size(read: Callable[[Item], Image], frames: Sequence[Item]) -> tuple[int, int]:
    """The (width, height) of the first of a clip's frames that can be read; raises as the first one if none can."""
    for frame in frames:
        with suppress(VfoaError):
            return _size_of(read(frame))
    return _size_of(read(frames[0]))


def _size_of(image: Image) -> tuple[int, int]:
    return image.shape[1], image.shape[0]


def _listed(numbers: tuple[float, ...]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


class ProjectionError(VfoaError):
    """Two projection matrices are not those of a rectified pair; a baseline that the user gives can replace theirs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """A rectified pair: intrinsics in pixels, baseline in metres.

    ``size_px`` is the (width, height) that it is valid for, if the file gives it.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    cx_right_px: float
    baseline_m: float
    size_px: tuple[int, int] | None = None

    @classmethod
    def of_equal_cameras(cls, k: Float, baseline_m: float) -> Calibration:
        """Return the calibration of two cameras with the same matrix (3, 3)."""
        fx, fy, cx, cy = (float(k[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return cls(fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, cx_right_px=cx, baseline_m=baseline_m)

    def rig(self, width_px: int, height_px: int) -> StereoRig:
        """Return the rig for images of this size.

        Raises
        ------
        VfoaError
            If the calibration is for another size, or its numbers are not those of a camera.
        """
        if self.size_px is not None:
            check_size((width_px, height_px), self.size_px, "images")
        places_px = self.cx_px, self.cy_px, self.cx_right_px
        check_camera((width_px, height_px), (self.fx_px, self.fy_px), places_px)
        if not BASELINE_M[0] <= self.baseline_m <= BASELINE_M[1]:
            raise VfoaError(
                f"baseline: found {self.baseline_m:g} m; expected {BASELINE_M[0]:g} to {BASELINE_M[1]:g} (metres)"
            )
        numbers = asdict(self)
        del numbers["size_px"]
        return StereoRig(width_px=width_px, height_px=height_px, **numbers)


def from_projections(
    p_left: ArrayLike, p_right: ArrayLike, where: str, size_px: tuple[int, int] | None = None
) -> Calibration:
    """Return the calibration in two projection matrices (3, 4) of a rectified pair, fourth columns in pixel metres.

    B is the distance to the right of two cameras at -K^-1 p, p the fourth column: (P_left[0, 3] - P_right[0, 3]) / fx
    where P[2, 3] = 0. In KITTI's files neither camera is the origin, and on some days they are 3 mm apart along z.

    Raises
    ------
    ProjectionError
        If the two do not share focal lengths and rows, or the right camera is not to the right of the left one.
    """
    left, right = np.asarray(p_left, dtype=np.float64), np.asarray(p_right, dtype=np.float64)
    if not (np.isfinite(left).all() and np.isfinite(right).all() and left[0, 0] > 0 and left[1, 1] > 0):
        raise ProjectionError(f"{where}: expected finite matrices with positive focal lengths")
    for name, row, column in (("fx", 0, 0), ("fy", 1, 1), ("cy", 1, 2)):
        if not np.isclose(left[row, column], right[row, column], rtol=1e-6, atol=1e-3):
            raise ProjectionError(
                f"{where}: {name} is {left[row, column]:g} left and {right[row, column]:g} right; "
                "expected the same in a rectified pair"
            )
    column_left, column_right = (p[:2, 3] - p[:2, 2] * p[2, 3] for p in (left, right))
    baseline, height = (column_left - column_right) / left[[0, 1], [0, 1]]
    if baseline == 0 and height:
        raise ProjectionError(
            f"{where}: the cameras stand above each other, {abs(height):g} m apart; expected side by side: turn the "
            "images of both by 90 degrees, and calibrate them again"
        )
    if not baseline > 0:
        raise ProjectionError(
            f"{where}: the baseline is {baseline:g} m (calibrations of left and right exchanged?); expected a positive "
            "one, (P_left[0, 3] - P_right[0, 3]) / fx"
        )
    return Calibration(
        fx_px=float(left[0, 0]),
        fy_px=float(left[1, 1]),
        cx_px=float(left[0, 2]),
        cy_px=float(left[1, 2]),
        cx_right_px=float(right[0, 2]),
        baseline_m=float(baseline),
        size_px=size_px,
    )
