"""Where an object or a pair of eyes is while a frame shows it and measures no depth: where its last depth puts it.

A matcher finds little on a smooth surface, so that a plain cup, or a head before a plain wall, has a depth in one frame
and none in the next. Nobody could look at the cup, and nothing could be said of the person. The image shows in which
direction it is, and its distance hardly changes within a few frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from vfoa.instance_tracking import frames_missed
from vfoa.times import Gap, seconds_between
from vfoa.types import Float, Percepts, Person, StereoRig, Target

_Measured = TypeVar("_Measured")


@dataclass(frozen=True, slots=True)
class _Last(Generic[_Measured]):
    """What was measured last, in the frame of this number."""

    measured: _Measured
    frame: int


class _LastMeasured(Generic[_Measured]):
    """What was measured last, by number."""

    def __init__(self) -> None:
        self._last: dict[int, _Last[_Measured]] = {}
        self._gaps: Mapping[int, Gap] = {}
        self._time_ns: int | None = None

    def step(self, frame: Percepts, measured: Mapping[int, _Measured]) -> Mapping[int, _Last[_Measured]]:
        """Return what was last measured within ``PATIENCE`` frames of those who are not measured in this one."""
        passed_s, self._time_ns = seconds_between(self._time_ns, frame.time_ns), frame.time_ns
        self._gaps = frames_missed(self._gaps, measured, passed_s)
        held = {id_: self._last[id_] for id_ in self._gaps if id_ not in measured}
        self._last = held | {id_: _Last(each, frame.index) for id_, each in measured.items()}
        return held


class DepthMemory:
    """The last measured target of each instance of one sequence, frame by frame.

    Instances must keep their numbers (:class:`vfoa.instance_tracking.InstanceTracker`). After ``PATIENCE`` frames
    (:meth:`vfoa.times.Gap.is_within`) without a depth, also frames that miss the object, it has no box. ``depth_from``
    says whose depth it is.
    """

    def __init__(self) -> None:
        self._last = _LastMeasured[Target]()

    def step(self, targets: tuple[Target, ...], frame: Percepts) -> tuple[Target, ...]:
        """Return the targets of the next frame, those without a box at their last depth; the same if all have one."""
        last = self._last.step(frame, {target.instance.id: target for target in targets if target.box is not None})
        if not any(target.instance.id in last for target in targets):
            return targets
        return tuple(
            _moved(last[target.instance.id], target, frame.rig) if target.instance.id in last else target
            for target in targets
        )


class EyeMemory:
    """The last measured eye origin of each track of one sequence, frame by frame; for as long as that of a target."""

    def __init__(self) -> None:
        self._last = _LastMeasured[Person]()

    def step(self, people: tuple[Person, ...], tracks: Sequence[int | None], frame: Percepts) -> tuple[Person, ...]:
        """Return the people of the next frame, those without an eye origin at their last depth.

        ``tracks`` are their tracks, in their order (None: not followed). The same people if all have an origin.
        """
        known = {track: person for track, person in zip(tracks, people, strict=True) if track is not None}
        measured = {track: each for track, each in known.items() if each.eye_origin_left is not None}
        last = self._last.step(frame, measured)
        if not any(track in last for track in known):
            return people
        return tuple(
            _seen_again(last[track], person, frame.rig) if track is not None and track in last else person
            for track, person in zip(tracks, people, strict=True)
        )


def _moved(last: _Last[Target], now: Target, rig: StereoRig) -> Target:
    """The target with the cloud and box that were measured, moved sideways as the middle of its mask."""
    measured = last.measured
    if measured.box is None or measured.box_px is None or now.box_px is None:
        return now
    shift_m = _shift_m(measured.box_px, now.box_px, float(measured.box.center_m[2]), rig)
    box = replace(measured.box, center_m=measured.box.center_m + shift_m)
    points_left = (measured.points_left + shift_m).astype(np.float32)
    return replace(now, points_left=points_left, box=box, depth_from=last.frame)


def _seen_again(last: _Last[Person], now: Person, rig: StereoRig) -> Person:
    """The person with the eye origin that was measured, moved sideways as the middle of the head's box."""
    measured = last.measured
    if measured.eye_origin_left is None or measured.head is None or now.head is None:
        return now
    depth_m = float(measured.eye_origin_left[2])
    shift_m = _shift_m(measured.head.box_px, now.head.box_px, depth_m, rig)
    return replace(now, eye_origin_left=measured.eye_origin_left + shift_m, depth_from=last.frame)


def _shift_m(before_px: Float, now_px: Float, depth_m: float, rig: StereoRig) -> Float:
    """How far (3,) the middle of a box (4,) has moved, at a depth."""
    right_px, down_px = (now_px - before_px).reshape(2, 2).mean(axis=0).tolist()
    return np.array([right_px * depth_m / rig.fx_px, down_px * depth_m / rig.fy_px, 0.0])
