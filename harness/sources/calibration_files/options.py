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
"""(width, height) of the clip's images, asked for only where a file depends on it or does not hold it."""

Cameras = RawCalibration | Calibration
"""A pair before rectification, or one that is rectified already."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """``cameras``: which two of the file's, left and right; unsaid, KITTI's are 2 and 3, Kalibr's 0 and 1.

    ``unit``: of the translation. ``fisheye``: OpenCV's matrices are of ``cv2.fisheye``. ``rectified``: the images are
    rectified already, although the file also tells how to do it. ``baseline_m``: the distance of the two cameras, in
    place of the file's or for a file that holds none.
    """

    cameras: tuple[int, int] | None = None
    unit: Unit = "m"
    fisheye: bool = False
    rectified: bool = False
    baseline_m: float | None = None
