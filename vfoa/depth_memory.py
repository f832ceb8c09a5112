"""Where an object is while a frame shows it and measures no depth: where its last depth puts it.

A matcher finds little on a smooth surface, so that a plain cup or a phone has a cloud in one frame and none in the
next. Without a box nobody could look at it. Its mask says in which direction it is, and its distance hardly changes
within a few frames.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vfoa.instance_tracking import PATIENCE
from vfoa.types import StereoRig, Target


class DepthMemory:
    """The last measured target of each instance of one sequence, frame by frame.

    Instances must keep their numbers (:class:`vfoa.instance_tracking.InstanceTracker`). After ``PATIENCE`` frames
    without a depth, also frames that miss the object, it has no box.
    """

    def __init__(self) -> None:
        self._measured: dict[int, Target] = {}
        self._ages: dict[int, int] = {}  # frames since then

    def step(self, targets: tuple[Target, ...], rig: StereoRig) -> tuple[Target, ...]:
        """Return the targets of the next frame, those without a box at their last depth; the same if all have one."""
        measured = {target.instance.id: target for target in targets if target.box is not None}
        ages = {id_: age + 1 for id_, age in self._ages.items() if id_ not in measured and age < PATIENCE}
        self._measured = {id_: self._measured[id_] for id_ in ages} | measured
        self._ages = ages | dict.fromkeys(measured, 0)
        if all(target.instance.id in measured or target.instance.id not in ages for target in targets):
            return targets
        return tuple(
            _moved(self._measured[target.instance.id], target, rig) if target.instance.id in ages else target
            for target in targets
        )


def _moved(measured: Target, now: Target, rig: StereoRig) -> Target:
    """The target with the cloud and box that were measured, moved sideways as the middle of its mask."""
    if measured.box is None or measured.box_px is None or now.box_px is None:
        return now
    right_px, down_px = ((now.box_px - measured.box_px).reshape(2, 2).mean(axis=0)).tolist()
    depth_m = float(measured.box.center_m[2])
    shift_m = np.array([right_px * depth_m / rig.fx_px, down_px * depth_m / rig.fy_px, 0.0])
    box = replace(measured.box, center_m=measured.box.center_m + shift_m)
    return replace(now, points_left=(measured.points_left + shift_m).astype(np.float32), box=box)
