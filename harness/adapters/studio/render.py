"""Two cameras that see a stage: ray casting, light, and what a sensor adds.

What stands still is cast and lit once. At each frame only the pixels that the moving bodies can cover are cast
again. Both views shade the same surface points with the same light, so what differs between them is what differs
in life: the viewpoint, the gain and the noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from harness.adapters.studio.choreography import Pose
from harness.adapters.studio.material import Values
from harness.adapters.studio.stage import RIG, Body, Stage
from vfoa.geometry import project, unit
from vfoa.types import Float, Image, Map

VIEWS = (0, 1)
_LIGHT_LEFT = np.array([-0.55, -0.8, -0.5])
_KEY, _AMBIENT = 1.02, 0.52
_SHADOW_RAYS = 8
_SHADOW_SPREAD = 0.14
_GAIN = (1.0, 0.955)
_NOISE_LEVELS = 2.4
_LENS_SIGMA_PX = 0.55
_NOISE_MARGIN_PX = 97


@dataclass(frozen=True, slots=True, kw_only=True)
class Layer:
    """What one camera sees: depth (H, W) in metres, inf where nothing is, and instance ids (H, W), 0 for none."""

    depth_m: Map
    ids: NDArray[np.uint16]


class Renderer:
    """Renders the frames of a stage; each by itself, in any order."""

    def __init__(self, stage: Stage, seed: int) -> None:
        self._stage, self._seed = stage, seed
        self._still = Assembly([body for body in stage.bodies if not body.moves])
        self._moving = Assembly([body for body in stage.bodies if body.moves])
        self._rays = [_camera_rays(view) for view in VIEWS]
        self._depths: dict[int, Layer] = {}
        self._backdrops: dict[int, Values] = {}

    def image(self, frame: int, view: int) -> Image:
        """What camera ``view`` (0 left, 1 right) delivers: (H, W, 3) uint8 RGB. ``frame`` counts from 0."""
        seen, hits = self._layer(frame, view)
        colour = self._backdrop(view).copy()
        v, u = seen
        colour[v, u] = hits.shade(np.ones(len(v), dtype=np.float32))
        return self._sense(colour, frame, view)

    def left_geometry(self, frame: int) -> Layer:
        """Depth and instance ids of the left view."""
        (v, u), hits = self._layer(frame, 0)
        still = self._still_layer(0)
        depth, ids = still.depth_m.copy(), still.ids.copy()
        depth[v, u], ids[v, u] = hits.depth_m, hits.ids
        return Layer(depth_m=depth, ids=ids)

    def _layer(self, frame: int, view: int) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], Hits]:
        """The moving bodies where they stand before the still ones: pixels (v, u), and the hits there."""
        placed = self._moving.placed(self._stage.poses(frame))
        where = placed.covers(view)
        hits = placed.cast(self._rays[view][where])
        nearer = hits.depth_m < self._still_layer(view).depth_m[where]
        v, u = np.nonzero(where)
        return (v[nearer], u[nearer]), hits.keep(nearer)

    def _still_layer(self, view: int) -> Layer:
        if view not in self._depths:
            hits = self._still.placed(self._stage.poses(0)).cast(self._rays[view].reshape(-1, 6))
            shape = (RIG.height_px, RIG.width_px)
            self._depths[view] = Layer(depth_m=hits.depth_m.reshape(shape), ids=hits.ids.reshape(shape))
        return self._depths[view]

    def _backdrop(self, view: int) -> Values:
        """Linear colour (H, W, 3) of what stands still, in the shadow of everybody as they sit at the beginning."""
        if view not in self._backdrops:
            poses = self._stage.poses(0)
            still, moving = self._still.placed(poses), self._moving.placed(poses)
            hits = still.cast(self._rays[view].reshape(-1, 6))
            colour = hits.shade(_shadow_share(hits, (still, moving)))
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
    """Sensor noise in levels, larger than an image: every frame cuts its own piece out of it."""
    size = (RIG.height_px + _NOISE_MARGIN_PX, RIG.width_px + _NOISE_MARGIN_PX, 3)
    return np.random.default_rng(0).standard_normal(size, dtype=np.float32) * np.float32(_NOISE_LEVELS)


class Assembly:
    """Several bodies as one mesh: triangles that know their part, vertices that know their body."""

    def __init__(self, bodies: list[Body]) -> None:
        parts = [(body, part) for body in bodies for part in body.parts]
        counts = [len(part.mesh.vertices) for _, part in parts]
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        meshes = [part.mesh for _, part in parts]
        self.part_bodies = [body.name for body, _ in parts]
        self.materials = [part.material for _, part in parts]
        self.part_ids = np.array([body.instance_id for body, _ in parts], dtype=np.uint16)
        self.vertices = np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32)
        self.normals = np.concatenate([mesh.normals for mesh in meshes]).astype(np.float32)
        self.triangles = np.concatenate([m.triangles + k for m, k in zip(meshes, first, strict=True)]).astype(np.uint32)
        self.part_of_triangle = np.repeat(
            np.arange(len(parts), dtype=np.uint16), [len(mesh.triangles) for mesh in meshes]
        )
        self.part_spans = [slice(int(k), int(k) + n) for k, n in zip(first, counts, strict=True)]

    def placed(self, poses: dict[str, Pose]) -> Placed:
        """The bodies where they are at one frame."""
        vertices, normals = np.empty_like(self.vertices), np.empty_like(self.normals)
        for body, span in zip(self.part_bodies, self.part_spans, strict=True):
            rotation = poses[body].room_from_body.T.astype(np.float32)
            vertices[span] = self.vertices[span] @ rotation + poses[body].origin_room.astype(np.float32)
            normals[span] = self.normals[span] @ rotation
        return Placed(self, vertices, normals)


class Placed:
    """An assembly in the camera frame, ready for rays."""

    def __init__(self, assembly: Assembly, vertices: Values, normals: Values) -> None:
        self.assembly, self.vertices, self.normals = assembly, vertices, normals
        # One thread: frames are computed in parallel by processes.
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(_tensor(vertices), _tensor(assembly.triangles))

    def cast(self, rays: Values) -> Hits:
        """Follow rays (N, 6) whose directions have z = 1, so that the distance is the depth."""
        found = self._scene.cast_rays(_tensor(rays))
        return Hits(
            placed=self,
            rays=rays,
            depth_m=found["t_hit"].numpy(),
            triangle=found["primitive_ids"].numpy(),
            corner_share=found["primitive_uvs"].numpy(),
        )

    def blocks(self, rays: Values) -> NDArray[np.bool_]:
        """Whether anything stands in the way of rays (N, 6)."""
        return self._scene.test_occlusions(_tensor(rays)).numpy()

    def covers(self, view: int) -> NDArray[np.bool_]:
        """Pixels (H, W) that the bodies can cover: the extents of their parts' projections."""
        where = np.zeros((RIG.height_px, RIG.width_px), dtype=np.bool_)
        pixels = project(self.vertices - np.array([RIG.baseline_m * view, 0, 0]), RIG)
        for span in self.assembly.part_spans:
            u0, v0 = np.maximum(np.floor(pixels[span].min(axis=0)).astype(int), 0)
            u1, v1 = np.maximum(np.ceil(pixels[span].max(axis=0)).astype(int) + 1, 0)
            where[v0:v1, u0:u1] = True
        return where


@dataclass(frozen=True, slots=True, kw_only=True)
class Hits:
    """Where N rays (N, 6) met an assembly: depth (N,), inf for a miss, triangle (N,) and barycentric shares (N, 2)."""

    placed: Placed
    rays: Values
    depth_m: Values
    triangle: NDArray[np.uint32]
    corner_share: Values

    @property
    def ids(self) -> NDArray[np.uint16]:
        """Instance ids (N,), 0 for a miss."""
        assembly, met = self.placed.assembly, np.isfinite(self.depth_m)
        ids = np.zeros(len(met), dtype=np.uint16)
        ids[met] = assembly.part_ids[assembly.part_of_triangle[self.triangle[met]]]
        return ids

    def keep(self, which: NDArray[np.bool_]) -> Hits:
        """Some of the rays."""
        return Hits(
            placed=self.placed,
            rays=self.rays[which],
            depth_m=self.depth_m[which],
            triangle=self.triangle[which],
            corner_share=self.corner_share[which],
        )

    @property
    def points(self) -> Values:
        """Points (N, 3), camera frame, not finite for a miss."""
        return self.rays[:, :3] + self.rays[:, 3:] * self.depth_m[:, None]

    def shade(self, key_share: Values) -> Values:
        """Linear colour (N, 3): Lambert's law for a key light, of which a share (N,) arrives, and for the sky."""
        assembly = self.placed.assembly
        colour = np.zeros((len(self.depth_m), 3), dtype=np.float32)
        met = np.flatnonzero(np.isfinite(self.depth_m))
        triangle, (a, b) = self.triangle[met], self.corner_share[met].T
        corners = assembly.triangles[triangle].T.astype(np.intp)
        shares = tuple(share[:, None] for share in (1 - a - b, a, b))
        normals = _mix(self.placed.normals, corners, shares)
        normals /= np.sqrt(np.einsum("ni,ni->n", normals, normals))[:, None]
        points = _mix(assembly.vertices, corners, shares)
        facing = np.maximum(normals @ unit(_LIGHT_LEFT).astype(np.float32), 0)
        light = np.float32(_KEY) * facing * key_share[met]
        light += np.float32(_AMBIENT) * (np.float32(0.72) - np.float32(0.28) * normals[:, 1])
        colour[met] = self._albedo(assembly, points, assembly.part_of_triangle[triangle]) * light[:, None]
        return colour

    @staticmethod
    def _albedo(assembly: Assembly, points: Values, part: NDArray[np.uint16]) -> Values:
        """Paint (N, 3) at points (N, 3) in their bodies' frames, part by part."""
        order = np.argsort(part, kind="stable")
        points, albedo = points[order], np.empty_like(points)
        ends = np.cumsum(np.bincount(part, minlength=len(assembly.materials)))
        for material, start, end in zip(assembly.materials, [0, *ends[:-1]], ends, strict=True):
            if end > start:
                albedo[order[start:end]] = material.paint(points[start:end])
        return albedo


def _tensor(array: NDArray[Any]) -> Any:
    return o3d.core.Tensor.from_numpy(np.ascontiguousarray(array))


def _mix(values: Values, corners: NDArray[np.intp], shares: tuple[Values, ...]) -> Values:
    """Values (N, 3) inside triangles, from those of their corners (3, N) and barycentric shares 3 x (N, 1)."""
    mixed = values[corners[0]] * shares[0]
    mixed += values[corners[1]] * shares[1]
    mixed += values[corners[2]] * shares[2]
    return mixed


def _camera_rays(view: int) -> Values:
    """Rays (H, W, 6) through the pixels' centres; z of each direction is 1."""
    v, u = np.mgrid[: RIG.height_px, : RIG.width_px].astype(np.float32)
    rays = np.zeros((RIG.height_px, RIG.width_px, 6), dtype=np.float32)
    rays[..., 0] = RIG.baseline_m * view
    rays[..., 3], rays[..., 4], rays[..., 5] = (u - RIG.cx_px) / RIG.fx_px, (v - RIG.cy_px) / RIG.fy_px, 1
    return rays


def _shadow_share(hits: Hits, blockers: tuple[Placed, ...]) -> Values:
    """Share (N,) of an extended light that each point sees: soft shadows from a fixed set of directions."""
    met = np.isfinite(hits.depth_m)
    share = np.ones(len(met), dtype=np.float32)
    points = hits.points[met]
    blocked = np.zeros(len(points), dtype=np.float32)
    for direction in _light_directions():
        rays = np.concatenate([points + direction * np.float32(2e-3), np.broadcast_to(direction, points.shape)], axis=1)
        blocked += np.any([placed.blocks(rays) for placed in blockers], axis=0)
    share[met] = 1 - blocked / _SHADOW_RAYS
    return share


def _light_directions() -> Values:
    """Directions (S, 3) towards points of the light, on a spiral."""
    k = np.arange(_SHADOW_RAYS)
    radius, angle = _SHADOW_SPREAD * np.sqrt((k + 0.5) / _SHADOW_RAYS), 2.4 * k
    key = unit(_LIGHT_LEFT)
    side = unit(np.cross(key, [0.0, 0.0, 1.0]))
    offset: Float = radius[:, None] * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(key, side))
    return unit(key + offset).astype(np.float32)
