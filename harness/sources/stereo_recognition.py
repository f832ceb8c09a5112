"""Recognise a path for ``stereo_folder``: its layouts, each with the calibration files that fit."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.sources import Recognised
from harness.sources.calibration_files.find import find_calibrations, find_incomplete
from harness.sources.calibration_files.options import Options
from harness.sources.media.frame_files import IMAGE_SUFFIXES
from harness.sources.media.video import VIDEO_SUFFIXES
from harness.sources.stereo_layouts import FoundLayout, find_layouts, images_below, read_layout
from harness.sources.view_files import ViewFiles
from vfoa.errors import VfoaError
from vfoa.validation import parse

_KITTI_GRAY = re.compile(r"(^|/)image_0?0(/|$)")
_CALIBRATIONS = ("calibration", "camera")
_SHOWN = 4


def recognise_stereo(path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
    """Return every layout at a path, once for each file there that calibrates it, or without a calibration.

    Files that ``given`` names (``left`` and ``right``, or ``both`` and ``layout``) are the only layout.

    Raises
    ------
    VfoaError
        If named files cannot be read, or images are there but no pair of them is recognised.
    """
    if path.is_file() and path.suffix.lower() not in IMAGE_SUFFIXES | VIDEO_SUFFIXES:
        return ()
    named = _named_files(given)
    layouts = find_layouts(path) if named is None else (read_layout(path if path.is_dir() else path.parent, named),)
    if not layouts:
        _refuse_unpaired(path)
    return tuple(each for layout in layouts for each in _calibrated(layout, path, given))


def _named_files(given: Mapping[str, Any]) -> ViewFiles | None:
    """The user's settings of the views, if they are sufficient to read them."""
    files = {key: given[key] for key in ("layout", "left", "right", "both", "stamps", "tolerance_ms") if key in given}
    if not ({"left", "right"} <= files.keys() or {"layout", "both"} <= files.keys()):
        return None
    if "layout" not in files and Path(str(files["left"])).suffix.lower() in VIDEO_SUFFIXES:
        files["layout"] = "videos"
    return parse(ViewFiles, files, "--set")


def _refuse_unpaired(path: Path) -> None:
    images = images_below(path) if path.is_dir() else [path.name]
    if not images:
        return
    shown = ", ".join(images[:_SHOWN]) + (" ..." if len(images) > _SHOWN else "")
    raise VfoaError(
        f"{path}: no two views are seen in the names of {len(images)} images ({shown}); expected --set left=FILES "
        "--set right=FILES (a folder, a file, a glob or a pattern such as left_%04d.png; in the manifest: left = and "
        "right = in [source]), or --set layout=images_side_by_side --set both=FILES"
    )


def _calibrated(layout: FoundLayout, path: Path, given: Mapping[str, Any]) -> list[Recognised]:
    options = _options(layout, given)
    calibrations = [] if any(key in given for key in _CALIBRATIONS) else _calibrations(layout, options)
    # A file that cannot be used alone is reported only if no other can.
    incomplete = () if calibrations else find_incomplete(layout.root, lambda: layout.size_px, options)
    return [
        Recognised(
            root=layout.root,
            source=layout.source | calibration,
            layout=str(layout),
            name=path.stem if path.is_file() else path.name,
            calibration=_named(calibration["calibration"]) if calibration else None,
            incomplete=incomplete,
        )
        for calibration in calibrations or [{}]
    ]


def _options(layout: FoundLayout, given: Mapping[str, Any]) -> Options:
    """The user's settings of calibrations, which are needed to find those that fit."""
    cameras = (0, 1) if _KITTI_GRAY.search(layout.source.get("left", "")) else None
    baseline = given.get("baseline_m")
    return Options(
        cameras=cameras,
        fisheye=given.get("fisheye") is True,
        rectified=given.get("rectified") is True,
        baseline_m=float(baseline) if isinstance(baseline, int | float) and baseline > 0 else None,
    )


def _calibrations(layout: FoundLayout, options: Options) -> list[dict[str, Any]]:
    """The settings that name each calibration for images of this size, at most two folders below or one above."""

    def size() -> tuple[int, int]:
        return layout.size_px

    found = find_calibrations(layout.root, size, options)
    if not found:  # KITTI's raw recordings: one file for all drives of a day
        found = find_calibrations(layout.root, size, options, [("../calib_cam_to_cam.txt",)])
    gray = {} if options.cameras is None else {"calibration_cameras": list(options.cameras)}
    return [each.source | (gray if str(each.source["calibration"]).endswith(".txt") else {}) for each in found]


def _named(files: str | list[str]) -> str:
    return files if isinstance(files, str) else " and ".join(files)
