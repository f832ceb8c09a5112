"""Settings that a calibration file does not contain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from harness.sources.calibration import Calibration
from harness.sources.rectification import RawCalibration

Unit = Literal["m", "cm", "mm"]
METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}

ImageSize = Callable[[], tuple[int, int]]
"""Returns (width, height) of the clip's images; called only if a file depends on the size or lacks it."""

Cameras = RawCalibration | Calibration
"""A pair before rectification, or one that is rectified already."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """``cameras``: the left and the right one of the file's cameras; by default (2, 3) for KITTI, (0, 1) for Kalibr.

    ``unit``: of the translation. ``fisheye``: OpenCV's matrices are of ``cv2.fisheye``. ``rectified``: the images are
    rectified already, although the file also says how to rectify. ``baseline_m``: the distance of the two cameras,
    which replaces the file's or completes a file without one.
    """

    cameras: tuple[int, int] | None = None
    unit: Unit = "m"
    fisheye: bool = False
    rectified: bool = False
    baseline_m: float | None = None
