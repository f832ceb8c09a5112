"""What is seen of a stage: by two cameras, with the effects of their sensors, and by the people, along their gaze.

Static objects are cast and lit once. At each frame only the pixels that the moving bodies can cover are cast again.
Both views shade the same surface points with the same light, so they differ only in the viewpoint, the gain and the
noise, as in reality.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from harness.studio.material import Values
from harness.studio.raycast import Assembly, Hits, PlacedAssembly, shadow_share
from harness.studio.stage import RIG, Stage
from vfoa.recent import Recent
from vfoa.types import Image, Map

VIEWS = (0, 1)
_GAIN = (1.0, 0.92)
_NOISE_LEVELS = 3.0
_LENS_SIGMA_PX = 0.55
_NOISE_MARGIN_PX = 97
_NEARER_M = 0.01
"""A blocker must be nearer than the target by at least this: things stand on the table, and touch."""
_STEP_M = 0.001


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedView:
    """The view of one camera: depth (H, W) in metres, inf where nothing is, and instance ids (H, W), 0 for none."""

    depth_m: Map
    ids: NDArray[np.uint16]


Moving = tuple[tuple[NDArray[np.intp], NDArray[np.intp]], Hits]
"""Pixels (v, u) where moving bodies are seen, and the hits there."""


class Renderer:
    """Renders the frames of a stage, each independently, in any order."""

    def __init__(self, stage: Stage, seed: int) -> None:
        self._stage, self._seed = stage, seed
        self._still = Assembly([body for body in stage.bodies if not body.moves])
        self._moving = Assembly([body for body in stage.bodies if body.moves])
        self._rays = [_camera_rays(view) for view in VIEWS]
        self._moving_layers: Recent[Moving] = Recent(len(VIEWS))
        self._depths: dict[int, RenderedView] = {}
        self._backdrops: dict[int, Values] = {}

    def image(self, frame: int, view: int) -> Image:
        """Return the image of camera ``view`` (0 left, 1 right): (H, W, 3) uint8 RGB. ``frame`` counts from 0."""
        (v, u), hits = self._moving_layer(frame, view)
        colour = self._backdrop(view).copy()
        colour[v, u] = hits.shade(np.ones(len(v), dtype=np.float32))
        return self._sense(colour, frame, view)

    def left_geometry(self, frame: int) -> RenderedView:
        """Depth and instance ids of the left view."""
        (v, u), hits = self._moving_layer(frame, 0)
        still = self._still_view(0)
        depth, ids = still.depth_m.copy(), still.ids.copy()
        depth[v, u], ids[v, u] = hits.depth_m, hits.ids
        return RenderedView(depth_m=depth, ids=ids)

    def _moving_layer(self, frame: int, view: int) -> Moving:
        """The moving bodies where they are in front of the static ones; image and geometry of a frame share them."""
        return self._moving_layers.get((), (frame, view), lambda: self._cast_moving(frame, view))

    def _cast_moving(self, frame: int, view: int) -> Moving:
        placed = self._moving.placed(self._stage.poses(frame))
        where = placed.covers(view)
        hits = placed.cast(self._rays[view][where])
        nearer = hits.depth_m < self._still_view(view).depth_m[where]
        v, u = np.nonzero(where)
        return (v[nearer], u[nearer]), hits.keep(nearer)

    def _still_view(self, view: int) -> RenderedView:
        if view not in self._depths:
            hits = self._still.placed(self._stage.poses(0)).cast(self._rays[view].reshape(-1, 6))
            shape = (RIG.height_px, RIG.width_px)
            self._depths[view] = RenderedView(depth_m=hits.depth_m.reshape(shape), ids=hits.ids.reshape(shape))
        return self._depths[view]

    def _backdrop(self, view: int) -> Values:
        """Linear colour (H, W, 3) of the static objects, with the shadows of all people at their first poses."""
        if view not in self._backdrops:
            poses = self._stage.poses(0)
            still, moving = self._still.placed(poses), self._moving.placed(poses)
            hits = still.cast(self._rays[view].reshape(-1, 6))
            colour = hits.shade(shadow_share(hits, (still, moving)))
            self._backdrops[view] = colour.reshape(RIG.height_px, RIG.width_px, 3)
        return self._backdrops[view]

    def _sense(self, linear: Values, frame: int, view: int) -> Image:
        """Lens blur, gain, tone curve, and noise that differs in every frame and view."""
        blurred = cv2.GaussianBlur(linear, (3, 3), _LENS_SIGMA_PX)
        levels = np.power(np.clip(blurred * np.float32(_GAIN[view]), 0, 1), np.float32(1 / 2.2), dtype=np.float32)
        shift = np.random.default_rng([self._seed, frame, view]).integers(0, _NOISE_MARGIN_PX, 2)
        noise = _noise_table()[shift[0] : shift[0] + RIG.height_px, shift[1] : shift[1] + RIG.width_px]
        return np.clip(levels * np.float32(255) + noise + np.float32(0.5), 0, 255).astype(np.uint8)


@cache
def _noise_table() -> Values:
    """Sensor noise in levels, larger than an image: every frame uses another part of it."""
    size = (RIG.height_px + _NOISE_MARGIN_PX, RIG.width_px + _NOISE_MARGIN_PX, 3)
    return np.random.default_rng(0).standard_normal(size, dtype=np.float32) * np.float32(_NOISE_LEVELS)


def _camera_rays(view: int) -> Values:
    """Rays (H, W, 6) through the pixels' centres; z of each direction is 1."""
    v, u = np.mgrid[: RIG.height_px, : RIG.width_px].astype(np.float32)
    rays = np.zeros((RIG.height_px, RIG.width_px, 6), dtype=np.float32)
    rays[..., 0] = RIG.baseline_m * view
    rays[..., 3], rays[..., 4], rays[..., 5] = (u - RIG.cx_px) / RIG.fx_px, (v - RIG.cy_px) / RIG.fy_px, 1
    return rays


# Lines of sight: the script of a scene does not check whether a target is visible. The label of such a frame is exact
# about the aim, but no person who saw the frame could have given it.


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


def _first(scene: PlacedAssembly, ray: Values, *, own: int) -> tuple[int, float]:
    """The instance that a ray (6,) hits first, except the own body, and its distance in metres; 0 and inf for none."""
    walked_m = 0.0
    while True:
        start = ray[:3] + walked_m * ray[3:]
        hits = scene.cast(np.concatenate([start, ray[3:]]).astype(np.float32)[None])
        met, distance_m = int(hits.ids[0]), walked_m + float(hits.depth_m[0])
        if met != own:
            return met, distance_m
        walked_m = distance_m + _STEP_M
