"""A clip of small pictures in folders, with its camera."""

from __future__ import annotations

from pathlib import Path

from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from tests.disk import stereo_pair_folder


def open_pairs(folder: Path, frames: tuple[int, ...]) -> StereoFolderClip:
    """Write pairs of these frames, and open them."""
    camera = {"fx_px": 50, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
    settings = StereoFolderSettings.model_validate({"left": "left", "right": "right", "camera": camera})
    return StereoFolderClip(settings, stereo_pair_folder(folder, frames))
