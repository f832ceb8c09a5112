"""Stages that answer what is true: a person to the left and two things, seen without error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tests.scenes import make_box, make_rig, rendered_boxes
from vfoa.geometry import project, unit
from vfoa.pipeline import Stages
from vfoa.pixels import relabel
from vfoa.types import Disparity, Float, Gaze, Head, HeadPose, Instances, Percepts, StereoFrame

PERSON, NEAR, FAR = 1, 2, 3
BOXES = {
    PERSON: make_box((-0.6, 0, 2.0), 0.2),
    NEAR: make_box((0.5, 0.2, 1.8), 0.15),
    FAR: make_box((0.5, -0.5, 2.6), 0.2),
}
EYES = np.array([-0.6, -0.06, 1.8])
"""In the front of the person's box, 35 % of its height from the top."""


@dataclass(frozen=True)
class Seen:
    """All five stages at once: they answer what is true, and look at the target with the id ``looked_at``."""

    percepts: Percepts
    looked_at: int
    head_px: Float

    def match(self, frame: StereoFrame) -> Disparity:
        return self.percepts.disparity

    def segment(self, frame: StereoFrame) -> Instances:
        return self.percepts.instances

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        return (Head(box_px=self.head_px, score=0.9),)

    @property
    def direction(self):
        return unit(BOXES[self.looked_at].center_m - EYES)


class TrueHeadPose(Seen):
    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose:
        return HeadPose(direction=self.direction)


class TrueGaze(Seen):
    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze:
        return Gaze(direction=self.direction)


def renamed(instances: Instances, other: Mapping[int, int]) -> Instances:
    """The same instances under other ids, by those that they have."""
    return replace(
        instances,
        ids=relabel(instances.ids, other),
        instances=tuple(replace(each, id=other[each.id]) for each in instances.instances),
    )


def true_percepts() -> Percepts:
    """Disparity and masks of the scene."""
    seen = rendered_boxes(make_rig(400, 240, fx_px=320), list(BOXES.values()))
    person, *things = seen.instances.instances
    instances = Instances(ids=seen.instances.ids, instances=(replace(person, label="person"), *things))
    return replace(seen, instances=instances)


def true_stages(percepts: Percepts, looked_at: int, *, cues: bool = True) -> Stages:
    """Stages for which the person looks at the target with this id; without ``cues``, nothing says where."""
    face = project([[-0.8, -0.2, 1.8], [-0.4, 0.2, 1.8]], percepts.rig).ravel()
    given = {"percepts": percepts, "looked_at": looked_at, "head_px": face}
    seen = Seen(**given)
    models = {"head_pose": TrueHeadPose(**given) if cues else None, "gaze": TrueGaze(**given) if cues else None}
    return Stages(matcher=seen, segmenter=seen, heads=seen, **models)
