"""Triangle meshes with smooth normals: lofted rings, tubes and boxes, of which all studio objects are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vfoa.geometry import unit
from vfoa.types import Float

_SMALLEST_M = 1e-4
"""Radius at which a ring counts as closed: not zero, so that it has a normal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mesh:
    """Vertices (V, 3) in metres, their unit normals (V, 3) and triangles (T, 3), in the frame of one body."""

    vertices: Float
    normals: Float
    triangles: NDArray[np.int32]


def box(center: ArrayLike, size: ArrayLike) -> Mesh:
    """A box with flat faces, axis-aligned in its body's frame, from its centre (3,) and full size (3,)."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
    vertices, normals = [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            face = np.insert(corners, axis, sign, axis=1)
            vertices.append(face)
            normals.append(np.tile(np.eye(3)[axis] * sign, (4, 1)))
    quads = 4 * np.arange(6, dtype=np.int32)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    return Mesh(
        vertices=np.concatenate(vertices) * np.asarray(size) / 2 + np.asarray(center),
        normals=np.concatenate(normals),
        triangles=quads.reshape(-1, 3),
    )


def loft(rings: Sequence[tuple[float, float, float]], segments: int = 28) -> Mesh:
    """Elliptical rings (z, radius x, radius y) about the z axis, from below to above; radius 0 closes an end."""
    z, radius_x, radius_y = np.array(rings, dtype=np.float64).T
    angle = 2 * np.pi * np.arange(segments) / segments
    grid = np.stack(
        [
            np.maximum(radius_x, _SMALLEST_M)[:, None] * np.cos(angle),
            np.maximum(radius_y, _SMALLEST_M)[:, None] * np.sin(angle),
            np.broadcast_to(z[:, None], (len(z), segments)),
        ],
        axis=-1,
    )
    return _from_grid(grid)


def ellipsoid(center: ArrayLike, radii: ArrayLike, segments: int = 28) -> Mesh:
    """An ellipsoid with its axes along its body's, from its centre (3,) and radii (3,)."""
    radii = np.asarray(radii, dtype=np.float64)
    polar = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    rings = np.stack([np.sin(polar) * radii[2], np.cos(polar) * radii[0], np.cos(polar) * radii[1]], axis=-1)
    mesh = loft([tuple(ring) for ring in rings.tolist()], segments=segments)
    return Mesh(
        vertices=mesh.vertices + np.asarray(center),
        normals=unit(mesh.vertices / radii**2),
        triangles=mesh.triangles,
    )


def turned(profile: Sequence[tuple[float, float]], segments: int = 32) -> Mesh:
    """A turned (lathed) shape: (radius, z) from the bottom's centre outwards and up. Close corners look sharp."""
    return loft([(z, radius, radius) for radius, z in profile], segments=segments)


def tube(path: ArrayLike, radii: ArrayLike, segments: int = 14) -> Mesh:
    """A round tube along a path (N, 3) with a radius at each point, smoothed between and rounded at the ends."""
    knots, radii = np.asarray(path, dtype=np.float64), np.asarray(radii, dtype=np.float64)
    steps = np.linspace(0, len(knots) - 1, 6 * (len(knots) - 1) + 1)
    at = np.arange(len(knots))
    spine = np.stack([_smooth(steps, at, knots[:, axis]) for axis in range(3)], axis=-1)
    radius = np.interp(steps, at, radii)
    along = unit(np.gradient(spine, axis=0))
    spine, radius, along = _round_ends(spine, radius, along)
    # The axis that is most perpendicular to the path: one for all rings, so that they do not twist against each other.
    helper = np.eye(3)[np.abs(along).max(axis=0).argmin()]
    side = unit(np.cross(helper, along))
    up = np.cross(along, side)
    angle = 2 * np.pi * np.arange(segments) / segments
    ring = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * up[:, None]
    return _from_grid(spine[:, None] + radius[:, None, None] * ring)


def _smooth(steps: Float, at: NDArray[np.intp], values: Float) -> Float:
    """Catmull-Rom interpolation of ``values`` given at the integers ``at``."""
    slope = np.gradient(values)
    low = np.minimum(steps.astype(int), len(at) - 2)
    s = steps - low
    p0, p1, m0, m1 = values[low], values[low + 1], slope[low], slope[low + 1]
    return (2 * s**3 - 3 * s**2 + 1) * p0 + (s**3 - 2 * s**2 + s) * m0 + (3 * s**2 - 2 * s**3) * p1 + (s**3 - s**2) * m1


def _round_ends(spine: Float, radius: Float, along: Float) -> tuple[Float, Float, Float]:
    """Put a half sphere on both ends of a tube."""
    turn = np.linspace(np.pi / 2, 0, 5)[:4]
    start = spine[0] - along[0] * (radius[0] * np.sin(turn))[:, None]
    end = spine[-1] + along[-1] * (radius[-1] * np.sin(turn[::-1]))[:, None]
    radii = np.concatenate([radius[0] * np.cos(turn), radius, radius[-1] * np.cos(turn[::-1])])
    directions = np.concatenate([np.tile(along[0], (4, 1)), along, np.tile(along[-1], (4, 1))])
    return np.concatenate([start, spine, end]), np.maximum(radii, _SMALLEST_M), directions


def _from_grid(grid: Float) -> Mesh:
    """A mesh from rings of points (rings, segments, 3), each ring closed."""
    rings, segments, _ = grid.shape
    around = np.roll(grid, -1, axis=1) - np.roll(grid, 1, axis=1)
    normals = np.cross(around, np.gradient(grid, axis=0))
    outwards = np.einsum("rsk,rsk->", normals, grid - grid.mean(axis=1, keepdims=True))
    index = np.arange(rings * segments, dtype=np.int32).reshape(rings, segments)
    a, b = index[:-1], np.roll(index, -1, axis=1)[:-1]
    c, d = np.roll(index, -1, axis=1)[1:], index[1:]
    triangles = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2)
    return Mesh(
        vertices=grid.reshape(-1, 3),
        normals=unit(normals.reshape(-1, 3)) * (1.0 if outwards >= 0 else -1.0),
        triangles=triangles.reshape(-1, 3),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The surface of a body, at whose points a gaze can rest.

    ``corners`` are its triangles (T, 3, 3) in its own frame, metres, and ``area_m2`` is the running sum (T,) of their
    areas.
    """

    corners: Float
    area_m2: Float

    @classmethod
    def of(cls, meshes: list[Mesh]) -> Surface:
        """The surface of meshes of one body."""
        corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes])
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        return cls(corners, np.cumsum(np.linalg.norm(np.cross(first, second), axis=1) / 2))

    def point(self, shares: Float) -> Float:
        """Return a point (3,), uniform over the area, for three numbers in [0, 1).

        One chooses the triangle, two the place on it.
        """
        place = np.searchsorted(self.area_m2, shares[0] * self.area_m2[-1], side="right")
        a, b, c = self.corners[min(int(place), len(self.corners) - 1)]
        root = np.sqrt(shares[1])
        point: Float = (1 - root) * a + root * (1 - shares[2]) * b + root * shares[2] * c
        return point
