"""Ray casting: the surface that a ray hits, its paint, and the light on it."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.studio.choreography import Pose
from harness.studio.material import Values
from harness.studio.stage import RIG, Body
from vfoa.errors import VfoaError
from vfoa.geometry import project, unit
from vfoa.types import Float

_PLOTS = "open3d.visualization.draw_plotly"
"""Open3D's plots for notebooks import a web framework, which takes twice as long as all the rest of Open3D."""

try:
    if "open3d" not in sys.modules:
        sys.modules[_PLOTS] = ModuleType(_PLOTS)
        sys.modules[_PLOTS].__getattr__ = lambda name: None  # type: ignore[method-assign]
    import open3d as o3d
except (ImportError, OSError) as error:  # the package is missing, or a system library that it loads
    raise VfoaError(
        f"rendering a studio clip needs Open3D, which cannot be imported: {error}; expected the package open3d and its "
        "system libraries (Debian: libgl1 libx11-6 libgomp1 libegl1 libusb-1.0-0)"
    ) from None
finally:
    sys.modules.pop(_PLOTS, None)

_LIGHT_LEFT = np.array([-0.55, -0.8, -0.5])
_KEY, _AMBIENT = 1.02, 0.52
_SHADOW_RAYS = 8
_SHADOW_SPREAD = 0.14


class Assembly:
    """Several bodies as one mesh: each triangle knows its part, each vertex its body."""

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

    def placed(self, poses: dict[str, Pose]) -> PlacedAssembly:
        """Return the bodies at their poses of one frame."""
        vertices, normals = np.empty_like(self.vertices), np.empty_like(self.normals)
        for body, span in zip(self.part_bodies, self.part_spans, strict=True):
            rotation = poses[body].frame_from_body.T.astype(np.float32)
            vertices[span] = self.vertices[span] @ rotation + poses[body].origin_m.astype(np.float32)
            normals[span] = self.normals[span] @ rotation
        return PlacedAssembly(self, vertices, normals)


class PlacedAssembly:
    """An assembly in the camera frame, ready for rays."""

    def __init__(self, assembly: Assembly, vertices: Values, normals: Values) -> None:
        self.assembly, self.vertices, self.normals = assembly, vertices, normals
        # One thread: frames are computed in parallel by processes.
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(_tensor(vertices), _tensor(assembly.triangles))

    def cast(self, rays: Values) -> Hits:
        """Follow rays (N, 6) whose directions have z = 1, so that the distance is the depth."""
        hits = self._scene.cast_rays(_tensor(rays))
        return Hits(
            placed=self,
            rays=rays,
            depth_m=hits["t_hit"].numpy(),
            triangle=hits["primitive_ids"].numpy(),
            corner_share=hits["primitive_uvs"].numpy(),
        )

    def blocks(self, rays: Values) -> NDArray[np.bool_]:
        """Whether anything blocks rays (N, 6)."""
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
    """Hits of N rays (N, 6) in an assembly: depth (N,), inf for a miss, triangle (N,), barycentric shares (N, 2)."""

    placed: PlacedAssembly
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
        """The hits of these rays alone (N,)."""
        rows = np.flatnonzero(which)
        return Hits(
            placed=self.placed,
            rays=self.rays.take(rows, axis=0),
            depth_m=self.depth_m[rows],
            triangle=self.triangle[rows],
            corner_share=self.corner_share.take(rows, axis=0),
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
    mixed = values.take(corners[0], axis=0) * shares[0]
    mixed += values.take(corners[1], axis=0) * shares[1]
    mixed += values.take(corners[2], axis=0) * shares[2]
    return mixed


def shadow_share(hits: Hits, blockers: tuple[PlacedAssembly, ...]) -> Values:
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
