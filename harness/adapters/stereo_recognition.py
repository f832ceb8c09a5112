"""What a path is to ``stereo_folder``: its layouts, each with the calibration files that fit."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from harness.adapters import Recognised
from harness.adapters.stereo_folder import StereoFolderClip, StereoFolderSettings
from harness.adapters.stereo_layouts import FoundLayout, find_layouts
from harness.config_errors import parse
from harness.frame_files import IMAGE_SUFFIXES
from harness.video import VIDEO_SUFFIXES
from vfoa.errors import VfoaError

_CALIBRATION_SUFFIXES = (".yml", ".yaml", ".xml", ".txt", ".conf")
_LARGEST_BYTES = 1_000_000
_KITTI_GRAY = re.compile(r"(^|/)image_0?0(/|$)")


def recognise_stereo(path: Path) -> tuple[Recognised, ...]:
    """Every layout at a path, once for each file there that calibrates it, or without a calibration."""
    if path.is_file() and path.suffix.lower() not in IMAGE_SUFFIXES | VIDEO_SUFFIXES:
        return ()
    return tuple(
        Recognised(
            root=layout.root,
            source=layout.source | calibration,
            layout=str(layout),
            name=path.stem if path.is_file() else path.name,
            calibration=str(calibration["calibration"]) if calibration else None,
        )
        for layout in find_layouts(path)
        for calibration in _calibrations(layout) or [{}]
    )


def _calibrations(layout: FoundLayout) -> list[dict[str, Any]]:
    """The settings that name each file beside the images, or one folder below or above, that is a calibration."""
    places = (layout.root, *sorted(each for each in layout.root.iterdir() if each.is_dir()))
    files = [file for place in places for file in sorted(place.iterdir()) if _may_calibrate(file)]
    found = [settings for file in files if (settings := _settings(layout, str(file.relative_to(layout.root))))]
    above = layout.root.parent / "calib_cam_to_cam.txt"  # KITTI's raw recordings: one for all drives of a day
    if not found and above.is_file():
        found = [settings for settings in [_settings(layout, "../calib_cam_to_cam.txt")] if settings]
    return found


def _may_calibrate(file: Path) -> bool:
    return file.suffix.lower() in _CALIBRATION_SUFFIXES and file.is_file() and file.stat().st_size <= _LARGEST_BYTES


def _settings(layout: FoundLayout, file: str) -> dict[str, Any] | None:
    """The settings by which a file calibrates the layout; None where it does not."""
    settings: dict[str, Any] = {"calibration": file}
    if file.endswith(".txt") and _KITTI_GRAY.search(layout.source.get("left", "")):
        settings["kitti_cameras"] = [0, 1]
    try:
        StereoFolderClip(parse(StereoFolderSettings, layout.source | settings, file), layout.root)
    except VfoaError:
        return None
    return settings
