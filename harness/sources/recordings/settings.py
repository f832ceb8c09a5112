"""Settings of a recording: which topics make its frames, and what they do not contain."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from harness.sources.depth_optics import Intrinsics
from harness.sources.stereo_pairs import Packing
from vfoa.settings import Settings

PAIR_TOLERANCE_MS = 2.0
"""The two cameras of a pair are triggered together."""

DEPTH_TOLERANCE_MS = 20.0
"""Colour and depth are often taken by two unsynchronised sensors, at 30 Hz up to 17 ms apart."""


class RecordingSettings(Settings):
    """The recording under the manifest's root, and properties that its topics and types do not contain.

    ``left`` and ``right`` are image topics, ``depth`` is a topic of measured depth, ``left_info``, ``right_info`` and
    ``depth_info`` those of their calibrations. With depth and without ``right``, ``left`` is the colour camera. Instead
    of calibration topics, ``calibration`` is a file of a pair under the root, ``camera`` the numbers of a camera
    without distortion, with a baseline for a pair. ``baseline_m`` is the distance of a pair's cameras, which replaces
    that of the recording's calibrations or of the file, and keeps their K, D and R. ``both`` is a topic whose images
    have both views, beside or above each other (``packing``), the left one first. ``depth_scale`` is the number of
    the sensor's counts per metre (if not given, integers are millimetres). Stamps of a frame are at most
    ``tolerance_ms`` apart (2 for a pair, 20 for depth). ``rectified`` says whether the images are rectified already; if
    not given, those are whose topics are called so (``image_rect``, ``rect/image``, ``rectified``). ``aligned`` says
    whether depth is in the colour image; if not given, names of topics and frames tell it. ``start_s`` and
    ``end_s`` select a part, in seconds after the recording's first message. ``stamps`` are those of the headers (when
    an image was taken), or of the log (when it was recorded), for headers that were not set.
    """

    recording: str = "."
    left: str | None = None
    right: str | None = None
    depth: str | None = None
    both: str | None = None
    packing: Packing = "side_by_side"
    left_info: str | None = None
    right_info: str | None = None
    depth_info: str | None = None
    calibration: str | None = None
    camera: Intrinsics | None = None
    baseline_m: float | None = Field(default=None, gt=0)
    depth_scale: float | None = Field(default=None, gt=0)
    rectified: bool | None = None
    aligned: bool | None = None
    tolerance_ms: float | None = Field(default=None, ge=0)
    start_s: float | None = Field(default=None, ge=0)
    end_s: float | None = Field(default=None, gt=0)
    stamps: Literal["header", "log"] = "header"

    @model_validator(mode="after")
    def _a_part(self) -> Self:
        if self.end_s is not None and self.end_s <= (self.start_s or 0):
            raise ValueError(f"found end_s {self.end_s:g}; expected more than start_s, {self.start_s or 0:g}")
        if self.calibration is not None and self.camera is not None:
            raise ValueError("found calibration and camera; expected one of them")
        if self.both is not None and (self.left or self.right or self.depth):
            raise ValueError("found both beside left, right or depth; expected it alone")
        if self.baseline_m is not None and self.camera is not None:
            raise ValueError("baseline_m: found beside camera; expected camera.baseline_m alone")
        return self

    def tolerance_ns(self, *, of_depth: bool) -> int:
        """Greatest difference of stamps of one frame, nanoseconds."""
        default = DEPTH_TOLERANCE_MS if of_depth else PAIR_TOLERANCE_MS
        return round((default if self.tolerance_ms is None else self.tolerance_ms) * 1e6)
