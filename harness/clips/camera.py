"""Whether a camera can be that of the images: baseline in metres, focal length and principal point in their pixels."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from harness.clips.manifest import ClipManifest
from vfoa.types import StereoFrame, StereoRig

MIN_BASELINE_M, MAX_BASELINE_M = 0.02, 1.0
"""Usual baselines of cameras that watch people; others are probably in another unit."""
MIN_FIELD_DEG, MAX_FIELD_DEG = 10, 140
"""Usual horizontal fields of view of rectified images."""
MOST_OFF_CENTRE = 0.15
"""Usual distance of the principal point from the middle, as a share of width or height; at most."""


def camera_problems(frames: Sequence[StereoFrame], manifest: ClipManifest) -> Iterator[str]:
    """Problems of each camera, with its first frame. A baseline is in question unless the manifest gives its unit."""
    says_unit = "calibration_unit" in manifest.source
    for rig, frame in {frame.rig: frame for frame in reversed(frames)}.items():
        if frame.right is not None and not says_unit and not MIN_BASELINE_M <= rig.baseline_m <= MAX_BASELINE_M:
            yield (
                f"frame {frame.index}: the baseline is {rig.baseline_m:.4g} m; expected {MIN_BASELINE_M:g} to "
                f"{MAX_BASELINE_M:g} m: {_how_to_correct(manifest)} in [source]"
            )
        if not (0 < rig.cx_px < rig.width_px and 0 < rig.cy_px < rig.height_px):
            yield (
                f"frame {frame.index}: the principal point ({rig.cx_px:g}, {rig.cy_px:g}) lies outside the image of "
                f"{rig.width_px} x {rig.height_px}; expected the calibration of this size"
            )


def _how_to_correct(manifest: ClipManifest) -> str:
    """The keys of ``[source]`` that correct a baseline: only pairs in files have a unit, and numbers are in metres."""
    has_unit = manifest.adapter == "stereo_folder"
    if "camera" in manifest.source:
        is_right = '; if it is right, say calibration_unit = "m"' if has_unit else ""
        return f"correct camera.baseline_m, which is in metres{is_right}"
    unit = 'calibration_unit = "mm" (or "cm"; "m" if it is right) or ' if has_unit else ""
    return f"say {unit}baseline_m ="


def camera_notes(rig: StereoRig) -> Iterator[str]:
    """A focal length or a principal point that is unusual for the size of the images: it may be that of others."""
    width, height = rig.width_px, rig.height_px
    field_deg = math.degrees(2 * math.atan(width / 2 / rig.fx_px))
    if not MIN_FIELD_DEG <= field_deg <= MAX_FIELD_DEG:
        causes = "images of another size?"
        if field_deg > MAX_FIELD_DEG:
            causes = f"a fisheye lens? millimetres? {causes}"
        yield (
            f"the focal length of {rig.fx_px:g} px is a horizontal field of view of {field_deg:.0f} degrees in images "
            f"{width} wide; expected {MIN_FIELD_DEG} to {MAX_FIELD_DEG} ({causes})"
        )
    off = max(abs(rig.cx_px / width - 0.5), abs(rig.cy_px / height - 0.5))
    if off > MOST_OFF_CENTRE:
        yield (
            f"the principal point ({rig.cx_px:g}, {rig.cy_px:g}) is {off:.0%} of the size away from the middle of "
            f"images of {width} x {height}: if the calibration is of images of another size, scale fx, fy, cx and cy"
        )
