"""Checks of a clip of measurements beyond those of its reader."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.clips.manifest import ClipManifest
from harness.sources import MeasuredClip
from vfoa.errors import did_you_mean

MAX_DISTANCE_M = 100.0
"""A position further from the origin than this is probably in millimetres."""


def measurement_problems(manifest: ClipManifest, clip: MeasuredClip) -> Iterator[str]:
    """Names of the manifest that do not occur, and positions that cannot be in metres."""
    ids = {**clip.people, **clip.objects}
    kinds = {number: clip.categories[name] for name, number in ids.items()}
    for table, rules in (("subjects", manifest.subjects), ("targets", manifest.targets)):
        for name, rule in rules.items():
            if rule.category not in kinds.values():
                yield f"{table}.{name}.category: {did_you_mean(rule.category, kinds.values())}"
            elif rule.instance is not None and kinds.get(rule.instance) != rule.category:
                yield f"{table}.{name}.instance: no {rule.category} has the number {rule.instance}; numbers: {ids}"
            elif rule.instance is None and not rule.is_shared:
                yield f"{table}.{name}: without images, expected instance, or the category alone"
    farthest_m = max((distance for number in clip.frames for distance in _distances_m(clip, number)), default=0.0)
    if farthest_m > MAX_DISTANCE_M:
        yield f"a person or object is {farthest_m:g} m away; expected metres (millimetres?)"


def _distances_m(clip: MeasuredClip, number: int) -> Iterator[float]:
    scene = clip.scene(number)
    yield from (float(np.linalg.norm(each.box.center_m)) for each in scene.targets if each.box is not None)
    yield from (float(np.linalg.norm(p.eye_origin_left)) for p in scene.people if p.eye_origin_left is not None)
