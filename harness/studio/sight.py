"""Detects objects between a person's eyes and their target, by rays against the meshes.

The script of a scene does not check whether a target is visible. The label of such a frame is exact about the aim, but
no person who saw the frame could have given it.
"""

from __future__ import annotations

import numpy as np

from harness.studio.material import Values
from harness.studio.raycast import Assembly, Placed
from harness.studio.stage import Stage

_NEARER_M = 0.01
"""A blocker must be nearer than the target by at least this: things stand on the table, and touch."""
_STEP_M = 0.001


class LinesOfSight:
    """The lines of sight of a stage's people, from between the eyes along the gaze."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._ids = {body.name: body.instance_id for body in stage.bodies if "/" not in body.name}
        self._ids |= {person.name: person.instance_id for person in stage.people(0)}
        self._names = {number: name for name, number in self._ids.items()}
        self._still = Assembly([body for body in stage.bodies if not body.moves]).placed(stage.poses(0))
        self._moving = Assembly([body for body in stage.bodies if body.moves])

    def blockers(self, frame: int) -> dict[str, str]:
        """By person, the object hit before the target; ``frame`` counts from 0. Unblocked people are left out."""
        scenes = (self._still, self._moving.placed(self._stage.poses(frame)))
        boxes = self._stage.boxes(frame)
        blockers = {}
        for person in self._stage.people(frame):
            eyes, gaze = person.eye_origin_left, person.gaze_direction
            if person.target not in self._ids or eyes is None or gaze is None:
                continue
            target = self._ids[person.target]
            met, distance_m = min(
                (_first(scene, np.concatenate([eyes, gaze]), own=person.instance_id) for scene in scenes),
                key=lambda hit: hit[1],
            )
            if met != target and distance_m < float((boxes[target].center_m - eyes) @ gaze) - _NEARER_M:
                blockers[person.name] = self._names[met]
        return blockers


def _first(scene: Placed, ray: Values, *, own: int) -> tuple[int, float]:
    """The instance that a ray (6,) hits first, except the own body, and its distance in metres; 0 and inf for none."""
    walked_m = 0.0
    while True:
        start = ray[:3] + walked_m * ray[3:]
        hits = scene.cast(np.concatenate([start, ray[3:]]).astype(np.float32)[None])
        met, distance_m = int(hits.ids[0]), walked_m + float(hits.depth_m[0])
        if met != own:
            return met, distance_m
        walked_m = distance_m + _STEP_M
