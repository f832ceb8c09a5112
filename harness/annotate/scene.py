"""The overlay of a frame's left image: outlines with names, and the subjects' heads.

With a run, outlines are its boxes; without one, they come from the clip's own masks, if it has any.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np

from harness.annotate.suggestions import Predictions
from harness.clips.manifest import ClipManifest
from harness.clips.naming import SubjectNames, name_targets
from harness.run.records import BoxPx, FrameRecord
from harness.sources import Clip
from vfoa.types import FrameResult, Instance, Instances, Mask, Scene, Target

_SMOOTHING_PX = 0.8
"""Greatest distance of an outline from the mask's own edge."""

Outline = list[list[list[int]]]
"""Polygons of points (u, v)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneObject:
    """One instance: its name (``label#id`` if no rule of the manifest names it), its outline and its box."""

    instance_id: int
    name: str
    label: str
    score: float
    box_px: BoxPx
    outline: Outline


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneView:
    """The objects of a frame, the smallest last so that they can be clicked, and the subjects' head boxes by name."""

    objects: tuple[SceneObject, ...]
    heads_px: dict[str, BoxPx]

    def plain(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self)


class Scenes:
    """The scene of each frame of a clip, from a run if there is one."""

    def __init__(self, clip: Clip, predictions: Predictions | None) -> None:
        self._clip, self.predictions = clip, predictions

    def at(self, number: int, manifest: ClipManifest) -> SceneView:
        """Return a frame's scene; ``manifest`` has the current names."""
        if self.predictions is not None:
            record = self.predictions.records.get(number)
            return SceneView(objects=(), heads_px={}) if record is None else self._of_run(record, manifest)
        return self._of_truth(number, manifest)

    def _of_run(self, record: FrameRecord, manifest: ClipManifest) -> SceneView:
        names = _names_of_run(record, manifest)
        objects = [
            SceneObject(
                instance_id=each.instance_id,
                name=names[each.instance_id],
                label=each.label,
                score=each.score,
                box_px=box,
                outline=_rectangle(box),
            )
            for each in record.targets
            if (box := each.box_px) is not None
        ]
        heads = {each.name: box for each in record.subjects if each.name is not None and (box := each.head_box_px)}
        return SceneView(objects=small_last(objects), heads_px=heads)

    def _of_truth(self, number: int, manifest: ClipManifest) -> SceneView:
        truth = self._clip.truth(number)
        heads = {each.name: _box(each.head_box_px) for each in truth.people or () if each.name in manifest.subjects}
        objects = [] if truth.instances is None else _named(number, truth.instances, manifest)
        return SceneView(objects=small_last(objects), heads_px=heads)


def outline(mask: Mask) -> Outline:
    """The outer edges of a mask (H, W), as polygons in pixels."""
    edges, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [cv2.approxPolyDP(each, _SMOOTHING_PX, True)[:, 0].tolist() for each in edges]


def _named(number: int, instances: Instances, manifest: ClipManifest) -> list[SceneObject]:
    """Instances with their names by the manifest's rules, as in a run; stuff is left out."""
    things = [each for each in instances.instances if each.is_thing and (instances.ids == each.id).any()]
    boxes = {each.id: _extent(instances.mask(each.id)) for each in things}
    names = _by_rules(number, [(each, boxes[each.id]) for each in things], manifest)
    return [
        SceneObject(
            instance_id=each.id,
            name=names[each.id],
            label=each.label,
            score=float(each.score),
            box_px=boxes[each.id],
            outline=outline(instances.mask(each.id)),
        )
        for each in things
    ]


def _names_of_run(record: FrameRecord, manifest: ClipManifest) -> dict[int, str]:
    """The run's names, and those of targets that the manifest has gained since."""
    found = [
        (Instance(id=each.instance_id, label=each.label, category_id=0, is_thing=True, score=each.score), each.box_px)
        for each in record.targets
    ]
    fresh = _by_rules(record.frame, found, manifest)
    known = {*manifest.targets, *manifest.subjects}
    return {
        each.instance_id: fresh[each.instance_id]
        if each.name not in known and fresh[each.instance_id] in manifest.targets
        else each.name
        for each in record.targets
    }


def _by_rules(number: int, found: Sequence[tuple[Instance, BoxPx | None]], manifest: ClipManifest) -> Mapping[int, str]:
    """Names by instance id."""
    empty = np.zeros((0, 3), np.float32)
    targets = tuple(
        Target(instance=each, box_px=None if box is None else np.array(box), points_left=empty, box=None)
        for each, box in found
    )
    result = FrameResult(scene=Scene(index=number, time_ns=0, targets=targets, people=()), attentions=())
    return name_targets(result, manifest.subjects, manifest.targets, SubjectNames())


def small_last(objects: list[SceneObject]) -> tuple[SceneObject, ...]:
    """Sort in drawing order: small objects last, on top, so that they can be clicked."""
    return tuple(sorted(objects, key=lambda each: (-_area(each.box_px), each.instance_id)))


def _area(box_px: BoxPx) -> float:
    return (box_px[2] - box_px[0]) * (box_px[3] - box_px[1])


def _extent(mask: Mask) -> BoxPx:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return float(columns[0]), float(rows[0]), float(columns[-1]), float(rows[-1])


def _box(array: np.ndarray[Any, np.dtype[np.float64]]) -> BoxPx:
    u0, v0, u1, v1 = array.tolist()
    return u0, v0, u1, v1


def _rectangle(box_px: BoxPx) -> Outline:
    u0, v0, u1, v1 = (round(each) for each in box_px)
    return [[[u0, v0], [u1, v0], [u1, v1], [u0, v1]]]
