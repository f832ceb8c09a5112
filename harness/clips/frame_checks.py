"""Checks of a clip's frames: calibration, rectification, images, depth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vfoa.stereo.block_matching_settings import BlockMatchingSettings
from vfoa.types import Float, StereoFrame

MAX_VERTICAL_ERROR_PX = 1.5
"""Median row difference of matched points above which block matching along rows fails."""

MIN_MATCHES = 30
"""Fewer matches do not allow a check of rectification."""

MIN_DEPTH_M, MAX_DEPTH_M = 0.05, 200.0
"""A median measured depth outside of this range is probably in another unit."""

MIN_BASELINE_M, MAX_BASELINE_M = 0.02, 1.0
"""Usual baselines of cameras that watch people; others are probably in another unit."""

DARK = 16
"""Greatest brightness of 12-bit values in 16-bit files, of which only the upper 8 bits are read: 15."""


def calibration_problems(frames: Sequence[StereoFrame], *, says_unit: bool) -> list[str]:
    """Return each problem once, with its frames. ``says_unit``: the manifest gives the unit of the baseline itself."""
    problems: dict[str, list[int]] = {}
    for frame in frames:
        rig = frame.rig
        if frame.right is not None and not says_unit and not MIN_BASELINE_M <= rig.baseline_m <= MAX_BASELINE_M:
            problems.setdefault(baseline_question(rig.baseline_m), []).append(frame.index)
        if not (0 < rig.cx_px < rig.width_px and 0 < rig.cy_px < rig.height_px):
            problem = (
                f"the principal point ({rig.cx_px:g}, {rig.cy_px:g}) lies outside the image of "
                f"{rig.width_px} x {rig.height_px}; expected the calibration of this size"
            )
            problems.setdefault(problem, []).append(frame.index)
    return [f"frame {', '.join(map(str, numbers))}: {problem}" for problem, numbers in problems.items()]


def baseline_question(baseline_m: float) -> str:
    """A question about a baseline that is unusual for cameras that watch people."""
    guess = "" if baseline_m < MIN_BASELINE_M else " (millimetres? squares of the calibration board?)"
    return (
        f"the baseline is {baseline_m:.4g} m; expected {MIN_BASELINE_M:g} to {MAX_BASELINE_M:g} m{guess}: say "
        'calibration_unit = "mm" (or "cm"; "m" if it is right) or baseline_m = in [source], or rescale the file: '
        "vfoa calibrate FILE --square-mm SIDE"
    )


def image_problems(frames: Sequence[StereoFrame]) -> list[str]:
    """Images that decode but cannot be right: the same on both sides, or nearly black."""
    same = [str(frame.index) for frame in frames if frame.right is not None and np.array_equal(frame.left, frame.right)]
    problems = [f"frame {', '.join(same)}: left and right are the same image; expected two views"] if same else []
    brightest = max(int(image.max()) for frame in frames for image in (frame.left, frame.right) if image is not None)
    if brightest <= DARK:
        problems.append(
            f"the brightest value of {len(frames)} frames is {brightest} of 255; expected brighter images "
            "(10 or 12 bits in 16-bit files? scale them to 8 bits)"
        )
    return problems


def rectification_problems(error_px: float | None) -> list[str]:
    """Rows that do not match; ``error_px`` is the median row difference of matched points."""
    if error_px is None or error_px <= MAX_VERTICAL_ERROR_PX:
        return []
    return [
        f"matched points lie {error_px:.1f} rows apart (median); "
        f"expected at most {MAX_VERTICAL_ERROR_PX} in a rectified pair"
    ]


def order_problems(frames: Sequence[StereoFrame], offsets: Sequence[Float]) -> list[str]:
    """Negative disparities: points in front of the cameras must be further right in the left image."""
    shifts = [
        columns + frame.rig.cx_right_px - frame.rig.cx_px
        for frame, (columns, _) in zip(frames, (each.T for each in offsets), strict=True)
    ]
    disparity_px = float(np.median(np.concatenate(shifts)))
    if disparity_px >= 0:
        return []
    return [
        f"matched points have a disparity of {disparity_px:.1f} px (median); expected a positive one "
        "(left and right swapped?)"
    ]


def depth_notes(frames: Sequence[StereoFrame]) -> list[str]:
    """Share of the image with measured depth, and its range."""
    depths = [frame.depth_m for frame in frames if frame.depth_m is not None]
    known = np.concatenate([depth[np.isfinite(depth)] for depth in depths]) if depths else np.zeros(0)
    if known.size == 0:
        return []
    near, middle, far = np.percentile(known, (1, 50, 99))
    share = known.size / sum(depth.size for depth in depths)
    limit_m = BlockMatchingSettings().min_depth_m
    unit = (
        f"nearly all of the measured depth is nearer than {limit_m:g} m (another unit? depth_scale in [source] is the "
        "number of counts per metre)"
    )
    return [
        *([unit] if far < limit_m else []),
        f"measured depth on {share:.0%} of the pixels: {near:.2f} to {far:.2f} m (1st to 99th percentile), "
        f'median {middle:.2f} m; stereo.matcher = "sensor" takes it',
    ]


def depth_problems(frames: Sequence[StereoFrame]) -> list[str]:
    """Measured maps without a value, or with values that suggest another unit."""
    measured = [(frame.index, frame.depth_m) for frame in frames if frame.depth_m is not None]
    empty = [str(index) for index, depth in measured if not np.isfinite(depth).any()]
    medians = [float(np.nanmedian(depth)) for _, depth in measured if np.isfinite(depth).any()]
    problems = [f"frame {', '.join(empty)}: no pixel has a measured depth"] if empty else []
    if medians and not MIN_DEPTH_M <= np.median(medians) <= MAX_DEPTH_M:
        problems.append(
            f"the median measured depth is {np.median(medians):.3g} m; expected {MIN_DEPTH_M:g} to {MAX_DEPTH_M:g} m "
            "(another unit? depth_scale in [source] is the number of counts per metre)"
        )
    return problems


def unmeasured(matches: int | None) -> list[str]:
    """A note if too few points were matched to check rectification."""
    if matches is None or matches >= MIN_MATCHES:
        return []
    return [
        f"{matches} points were matched between left and right; rectification is checked from {MIN_MATCHES} points on"
    ]
