"""Outputs of a configuration's stages on some frames of a clip, as files for the stages that read files."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from harness.clips.manifest import load_manifest
from harness.pipeline.configuration import Configuration
from scripts.measure.stage_outputs import perceive_frames, write_stage_outputs
from tests.disk import write_bytes


def save_stage_outputs(folder: Path, clip: str, configuration: Configuration, frames: Iterable[int]) -> Path:
    """Perceive frames and write every stage's output below ``folder``; return ``folder``."""
    images = load_manifest(clip).open_images()
    percepts = perceive_frames(configuration.for_clip(clip), images, frames)
    write_stage_outputs(folder, percepts)
    for percept in percepts:
        content = io.BytesIO()
        np.save(content, percept.disparity.disparity_px)
        write_bytes(folder / "disparity" / f"frame_{percept.index:04d}.npy", content.getvalue())
    return folder
