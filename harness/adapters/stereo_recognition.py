"""What a path is to ``stereo_folder``: its layouts, each with the calibration files that fit."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from harness.adapters import Recognised
from harness.adapters.calibration_files.find import find_calibrations
from harness.adapters.calibration_files.options import Options
from harness.adapters.stereo_layouts import FoundLayout, find_layouts
from harness.media.frame_files import IMAGE_SUFFIXES
from harness.media.video import VIDEO_SUFFIXES

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
            calibration=_named(calibration["calibration"]) if calibration else None,
        )
        for layout in find_layouts(path)
        for calibration in _calibrations(layout) or [{}]
    )


def _calibrations(layout: FoundLayout) -> list[dict[str, Any]]:
    """The settings that name each calibration for images of this size, beside them or one folder below or above."""
    cameras = (0, 1) if _KITTI_GRAY.search(layout.source.get("left", "")) else None

    def size() -> tuple[int, int]:
        return layout.size_px

    options = Options(cameras=cameras)
    found = find_calibrations(layout.root, size, options)
    if not found:  # KITTI's raw recordings: one for all drives of a day
        found = find_calibrations(layout.root, size, options, [("../calib_cam_to_cam.txt",)])
    gray = {} if cameras is None else {"calibration_cameras": list(cameras)}
    return [each.source | (gray if str(each.source["calibration"]).endswith(".txt") else {}) for each in found]


def _named(files: str | list[str]) -> str:
    return files if isinstance(files, str) else " and ".join(files)
