"""Outputs of a configuration's stages on some frames of a clip, as files for the stages that read files."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from harness.bench.stage_outputs import write_stage_outputs
from harness.clips.manifest import load_manifest
from harness.pipeline.configuration import STAGES, Configuration
from tests.disk import write_bytes
from vfoa.pipeline import Stages, perceive


def save_stage_outputs(folder: Path, clip: str, configuration: Configuration, frames: Iterable[int]) -> Path:
    """Perceive frames and write every stage's output below ``folder``; return ``folder``."""
    images = load_manifest(clip).open_images()
    chosen = configuration.for_clip(clip).choices
    built = {slot: STAGES[slot].build(choice, images) if choice else None for slot, choice in chosen.items()}
    stages = Stages(
        matcher=built["stereo"],
        segmenter=built["segmentation"],
        heads=built["heads"],
        head_pose=built["head_pose"],
        gaze=built["gaze"],
    )
    percepts = [perceive(images.frame(number), stages) for number in frames]
    write_stage_outputs(folder, percepts)
    for percept in percepts:
        content = io.BytesIO()
        np.save(content, percept.disparity.disparity_px)
        write_bytes(folder / "disparity" / f"frame_{percept.index:04d}.npy", content.getvalue())
    return folder
