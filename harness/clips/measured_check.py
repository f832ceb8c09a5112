"""Checks of a clip of measurements: names of the manifest, positions in metres, and the axes of directions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.clips.axes import other_axes
from harness.clips.manifest import ClipManifest
from harness.labels.labels import RESERVED, Label, Labels
from harness.sources import MeasuredClip
from vfoa.errors import did_you_mean
from vfoa.types import Float

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


MOST_AIMS = 400
"""Most labelled frames of a clip in which directions are compared with the labels."""


def axis_notes(manifest: ClipManifest, clip: MeasuredClip, labels: Labels | None) -> Iterator[str]:
    """A note if the directions seem to be in another program's axes: gazes, or heads where no gaze was measured."""
    looks = [look for look in labels.labelled(clip.frames) if look[2].target not in RESERVED] if labels else []
    aims = [aim for look in looks[:: -(-len(looks) // MOST_AIMS) or 1] if (aim := _aim(manifest, clip, *look))]
    directions, to_targets = np.array(aims, np.float64).reshape(-1, 2, 3).swapaxes(0, 1)
    if (found := other_axes(directions, to_targets)) is not None:
        yield str(found)


def _aim(
    manifest: ClipManifest, clip: MeasuredClip, number: int, subject: str, label: Label
) -> tuple[Float, Float] | None:
    """A person's direction in a frame, and the vector from the eyes to the labelled target; None if not known."""
    scene = clip.scene(number)
    own, aimed_at = _ids(manifest, clip, subject), _ids(manifest, clip, label.target)
    person = next((person for person in scene.people if person.instance_id in own), None)
    boxes = (target.box for target in scene.targets if target.instance.id in aimed_at)
    box = next((box for box in boxes if box is not None), None)
    if person is None or box is None or person.eye_origin_left is None:
        return None
    measured = person.view.gaze or person.view.head_pose
    return None if measured is None else (measured.direction, box.center_m - person.eye_origin_left)


def _ids(manifest: ClipManifest, clip: MeasuredClip, name: str) -> set[int]:
    """The instances that a name of the manifest may be."""
    rule = {**manifest.subjects, **manifest.targets}[name]
    ids = {**clip.people, **clip.objects}
    of_kind = {ids[own] for own, category in clip.categories.items() if category == rule.category}
    return of_kind if rule.instance is None else {rule.instance}


def _distances_m(clip: MeasuredClip, number: int) -> Iterator[float]:
    scene = clip.scene(number)
    yield from (float(np.linalg.norm(target.box.center_m)) for target in scene.targets if target.box is not None)
    yield from (float(np.linalg.norm(p.eye_origin_left)) for p in scene.people if p.eye_origin_left is not None)
