"""The plan of a clip of measurements, shown in place of images: everyone and everything seen from above.

The plan's u grows with x (right), its v falls with z (away from the camera); heights are left out. Every frame of a
clip has the same plan: it holds all that is ever measured, and a margin.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import cv2
import numpy as np

from harness.annotate.scene import SceneObject, SceneView, small_last
from harness.clips.manifest import ClipManifest
from harness.clips.naming import SubjectNames, name_targets
from harness.sources import MeasuredClip
from vfoa.geometry import box_corners
from vfoa.types import Box3D, Cue, Float, FrameResult, Person, Scene, Target

WIDTH_PX, HEIGHT_PX = 1600, 800
"""Size of the plan's pixel grid, in which outlines and positions are whole numbers; the page draws lines."""
_MARGIN = 0.15
"""Margin around all measurements, as a share of the longer side."""
_LEAST_MARGIN_M = 0.4
_REACH: Mapping[Cue, float] = {"head": 0.7, "gaze": 0.95}
"""Lengths of the drawn directions, as shares of the margin: none leaves the plan, and equal directions stay visible."""


class Plan:
    """The plans of a clip's frames, in one scale."""

    def __init__(self, clip: MeasuredClip) -> None:
        self._clip = clip
        low, high = _extent(clip)
        self._margin_m = max(_MARGIN * float((high - low).max()), _LEAST_MARGIN_M)
        width_m, depth_m = (high - low + 2 * self._margin_m).tolist()
        self._px_per_m = min(WIDTH_PX / width_m, HEIGHT_PX / depth_m)
        self._middle = (high + low) / 2

    def at(self, number: int, manifest: ClipManifest) -> dict[str, Any]:
        """A frame's plan as JSON: the values of :class:`~harness.annotate.scene.SceneView`, and the key ``plan``.

        ``plan`` has the scale, the pixel of the origin, and a ray for each measured direction of a person.
        """
        scene = self._clip.scene(number)
        unattended = FrameResult(scene=scene, attentions=())
        names = name_targets(unattended, manifest.subjects, manifest.targets, SubjectNames())
        shown = [(each, each.box) for each in scene.targets if each.box is not None]
        objects = [self._object(each, box, names[each.instance.id]) for each, box in shown]
        view = SceneView(objects=small_last(objects), heads_px={})
        plan = {
            "px_per_m": self._px_per_m,
            "origin_px": self._px(np.zeros(3)),
            "rays": list(self._rays(scene, names)),
        }
        return {**view.plain(), "size_px": (WIDTH_PX, HEIGHT_PX), "plan": plan}

    def _object(self, target: Target, box: Box3D, name: str) -> SceneObject:
        corners = np.array([self._px(corner) for corner in box_corners(box)], np.float32)
        outline = [[round(float(u)), round(float(v))] for u, v in cv2.convexHull(corners)[:, 0]]
        u, v = corners.T.tolist()
        return SceneObject(
            instance_id=target.instance.id,
            name=name,
            label=target.instance.label,
            score=target.instance.score,
            box_px=(min(u), min(v), max(u), max(v)),
            outline=[outline],
        )

    def _rays(self, scene: Scene, names: dict[int, str]) -> Iterator[dict[str, Any]]:
        for person in scene.people:
            eyes_m = person.eye_origin_left
            if eyes_m is None:
                continue
            for cue, direction in _directions(person):
                yield {
                    "name": names.get(person.instance_id or 0, ""),
                    "cue": cue,
                    "from_px": self._px(eyes_m),
                    "to_px": self._px(eyes_m + _REACH[cue] * self._margin_m * direction),
                }

    def _px(self, point_m: Float) -> list[float]:
        u = WIDTH_PX / 2 + (float(point_m[0]) - self._middle[0]) * self._px_per_m
        v = HEIGHT_PX / 2 - (float(point_m[2]) - self._middle[1]) * self._px_per_m
        return [round(float(u), 1), round(float(v), 1)]


def _extent(clip: MeasuredClip) -> tuple[Float, Float]:
    """The least and the largest x and z (2,), m, of eyes and boxes in any frame; 0 if there are none."""
    points = [point[[0, 2]] for number in clip.frames for point in _points(clip.scene(number))]
    found = np.array(points) if points else np.zeros((1, 2))
    return found.min(axis=0), found.max(axis=0)


def _points(scene: Scene) -> Iterator[Float]:
    for target in scene.targets:
        if target.box is not None:
            yield from box_corners(target.box)
    yield from (person.eye_origin_left for person in scene.people if person.eye_origin_left is not None)


def _directions(person: Person) -> Iterator[tuple[Cue, Float]]:
    if person.view.head_pose is not None:
        yield "head", person.view.head_pose.direction
    if person.view.gaze is not None:
        yield "gaze", person.view.gaze.direction
