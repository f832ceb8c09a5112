"""Check a clip without images: names that do not occur, places that are not in metres, directions that are wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness.clips.axes import other_axes, other_forward
from harness.clips.manifest import ClipManifest
from harness.labels.labels import RESERVED, Label, Labels
from harness.sources import MeasuredClip, WornBodies
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
                yield f"{table}.{name}.category: no {rule.category!r}; {did_you_mean(rule.category, kinds.values())}"
            elif rule.instance is not None and kinds.get(rule.instance) != rule.category:
                yield f"{table}.{name}.instance: no {rule.category} has the number {rule.instance}; numbers: {ids}"
            elif rule.instance is None and not rule.is_shared:
                yield f"{table}.{name}: without images, expected instance, or the category alone"
    yield from nameless_subjects(manifest, clip)
    if (farthest := clip.farthest()) is not None and farthest[2] > MAX_DISTANCE_M:
        name, number, distance_m = farthest
        yield f"frame {number}: {name} is {distance_m:g} m away; expected metres (millimetres?)"


def nameless_subjects(manifest: ClipManifest, clip: MeasuredClip) -> Iterator[str]:
    """Subjects that may be any of several people: the source has no person of the name, and no number tells which."""
    taken = {*manifest.subjects, *(rule.instance for rule in manifest.subjects.values())}
    others = {name: number for name, number in clip.people.items() if not {name, number} & taken}
    for name, rule in manifest.subjects.items():
        if name not in clip.people and rule.is_shared and len(others) > 1:
            yield (
                f"subjects.{name}: no person of this name; expected one of {', '.join(others)}, or instance, the "
                f"number: {others}"
            )


MOST_AIMS = 400
"""Most labelled frames of a clip in which directions are compared with the labels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Aim:
    """A person's direction (3,) in a frame, and the vector (3,) from the eyes to the labelled target."""

    number: int
    person: int
    target: str
    direction: Float
    to_target: Float


def direction_notes(manifest: ClipManifest, clip: MeasuredClip, labels: Labels | None) -> list[str]:
    """Notes if labels say that the directions are wrong: gazes, or heads where no gaze was measured.

    Either the face points in another direction on worn bodies, or the directions are in another program's axes.
    """
    looks = [look for look in labels.labelled(clip.frames) if look[2].target not in RESERVED] if labels else []
    aims = [aim for look in looks[:: -(-len(looks) // MOST_AIMS) or 1] if (aim := _aim(manifest, clip, *look))]
    if isinstance(clip, WornBodies) and (notes := list(_forward_notes(clip, clip.people, aims))):
        return notes
    directions = np.array([aim.direction for aim in aims]).reshape(-1, 3)
    found = other_axes(directions, np.array([aim.to_target for aim in aims]).reshape(-1, 3))
    return [] if found is None else [str(found)]


def _forward_notes(clip: WornBodies, people: Mapping[str, int], aims: Sequence[_Aim]) -> Iterator[str]:
    """A note for each person whose face points in another direction than the settings of the worn body say."""
    for name, person in people.items():
        own = [aim for aim in aims if aim.person == person]
        if len({aim.target for aim in own}) < 2:
            continue
        in_body = np.array([aim.to_target @ clip.left_from_body(name, aim.number) for aim in own])
        if (forward := other_forward(in_body, clip.forward(name))) is not None:
            found, expected = ((np.round(each, 2) + 0.0).tolist() for each in (forward, clip.forward(name)))
            yield (
                f"{name}: with the labels, the face points along {found} in the axes of the body; "
                f"heads.{name}.forward in [source] says {expected}"
            )


def _aim(manifest: ClipManifest, clip: MeasuredClip, number: int, subject: str, label: Label) -> _Aim | None:
    """A look of the labels; None if its eyes, direction or target are not known, or several may be meant."""
    scene = clip.scene(number)
    own, aimed_at = _ids(manifest, clip, subject), _ids(manifest, clip, label.target)
    people = [person for person in scene.people if person.instance_id in own]
    boxes = [target.box for target in scene.targets if target.instance.id in aimed_at]
    if len(people) != 1 or len(boxes) != 1:
        return None
    person, box = people[0], boxes[0]
    if box is None or person.eye_origin_left is None:
        return None
    measured = person.view.gaze or person.view.head_pose
    if measured is None or person.instance_id is None:
        return None
    return _Aim(
        number=number,
        person=person.instance_id,
        target=label.target,
        direction=measured.direction,
        to_target=box.center_m - person.eye_origin_left,
    )


def _ids(manifest: ClipManifest, clip: MeasuredClip, name: str) -> set[int]:
    """The instances that a name of the manifest may be."""
    rule = {**manifest.subjects, **manifest.targets}[name]
    ids = {**clip.people, **clip.objects}
    of_kind = {ids[own] for own, category in clip.categories.items() if category == rule.category}
    return of_kind if rule.instance is None else {rule.instance}
