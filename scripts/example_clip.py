"""Render the clip that ``vfoa init`` leaves, with what the demo finds in it: ``python -m scripts.example_clip``."""

from __future__ import annotations

from pathlib import Path

import cv2

from harness.clips.manifest import load_manifest
from harness.files.io import atomic_write
from harness.run.experiment import load_experiment
from scripts.measure.stage_outputs import perceive_frames, write_stage_outputs

FOLDER = Path(__file__).parent.parent / "harness" / "cli" / "example" / "data" / "example"
FRAMES = (1, 2)
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 85]


def main() -> None:
    """Write the pairs as JPEG, and the outputs as the files that the stages ``files`` and ``coco_panoptic`` read."""
    clip = load_manifest("studio_talk").open_images()
    write_stage_outputs(FOLDER, perceive_frames(load_experiment("demo").configurations[0], clip, FRAMES))
    for frame in map(clip.frame, FRAMES):
        for side, image in (("left", frame.left), ("right", frame.right)):
            content = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), _JPEG)[1].tobytes()
            atomic_write(FOLDER / side / f"{frame.index:04d}.jpg", content)


if __name__ == "__main__":
    main()
