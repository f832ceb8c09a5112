"""Times and places of a clip that are probably in another unit: ``vfoa clips check`` and every run question them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from harness.sources import AnyClip, DoubtedClip, MeasuredClip
from vfoa.types import Scene

USUAL_M = (0.05, 20.0)
"""Distances from eyes to what may be looked at: a median outside of it is probably in another unit, as centimetres."""
LONGEST_STEP_S = 5.0
"""A median step of frames from which their times are questioned: 200 frames per second in ms, taken for seconds."""
_MOST_FRAMES = 50
"""Most frames of a run whose places are looked at: each one of an hour takes as long as a short run."""


def step_doubts(clip: AnyClip) -> Iterator[str]:
    """Yield a doubt about times of frames that are far apart."""
    step_s = 1 / clip.rate_hz if clip.rate_hz else 0.0
    if step_s >= LONGEST_STEP_S:
        apart = f"the frames are {step_s:.4g} s apart (median) by their times"
        yield f"{apart}: are these in another unit, as milliseconds?"


def own_doubts(clip: AnyClip) -> tuple[str, ...]:
    """What a clip itself says that is in question about its values."""
    return clip.doubts if isinstance(clip, DoubtedClip) else ()


def clip_doubts(clip: AnyClip, numbers: Sequence[int]) -> Iterator[str]:
    """Yield the doubts about a clip: its own, about its times, and about distances in some of these frames."""
    yield from own_doubts(clip)
    yield from step_doubts(clip)
    if isinstance(clip, MeasuredClip):
        scenes = (clip.scene(number) for number in numbers[:: -(-len(numbers) // _MOST_FRAMES) or 1])
        distances_m = [distance_m for scene in scenes for distance_m in _distances_m(scene)]
        if distances_m and not USUAL_M[0] <= (median_m := float(np.median(distances_m))) <= USUAL_M[1]:
            yield (
                f"people are {median_m:.4g} m away from objects and others (median), and heads, points and cones have "
                "sizes in metres: are places in another unit, as millimetres?"
            )


def _distances_m(scene: Scene) -> Iterator[float]:
    """Yield the distance of all eyes from all middles, but for a person's own."""
    for person in scene.people:
        for target in scene.targets:
            if person.eye_origin_left is not None and target.box and target.instance.id != person.instance_id:
                yield float(np.linalg.norm(target.box.center_m - person.eye_origin_left))
