"""A clip of measurements under many configurations: no stage of perception runs, since every frame is a scene."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence

from harness.sources import MeasuredClip
from harness.stages.configuration import Configuration
from harness.stages.sharing import SharedFrame
from harness.stages.stage_runner import Timings, timed


def measured_frames(
    configurations: Sequence[Configuration], clip: MeasuredClip, numbers: Iterable[int]
) -> Generator[SharedFrame]:
    """Read frames in ascending order; every configuration gets the same scene, and no percepts."""
    for number in numbers:
        decoding: Timings = {}
        with timed(decoding, "decode"):
            scene = clip.scene(number)
        found = {configuration.name: (None, scene, dict(decoding)) for configuration in configurations}
        yield SharedFrame(index=number, frame=None, by_configuration=found)
