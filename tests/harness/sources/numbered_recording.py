"""A recording whose pictures tell their numbers, 40 ms apart."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.settings import RecordingSettings
from tests.disk import HEIGHT, WIDTH, picture
from tests.recordings import Camera, rectified_camera

LEFT = rectified_camera(WIDTH, HEIGHT, fx=100.0, cx=31.5, cy=23.5)


RIGHT = rectified_camera(WIDTH, HEIGHT, fx=100.0, cx=30.0, cy=23.5, baseline_m=0.12)


START_NS = 1_700_000_000_000_000_007


STEP_NS = 40_000_000


def stamp(number: int) -> int:
    return START_NS + (number - 1) * STEP_NS


def pairs(
    numbers: range = range(1, 6),
) -> Iterator[tuple[int, NDArray[np.uint8], NDArray[np.uint8], Camera, Camera]]:
    for n in numbers:
        yield stamp(n), picture(n), picture(1000 + n), LEFT, RIGHT


def open_clip(path: Path, **settings: object) -> McapClip:
    return McapClip(RecordingSettings.model_validate({"recording": path.name, **settings}), path.parent)
