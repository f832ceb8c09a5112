"""Points on the surface of a body, uniform over its area, at which a gaze can rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.studio.mesh import Mesh
from vfoa.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The triangles (T, 3, 3) of a body in its own frame, metres, and the running sum (T,) of their areas."""

    corners: Float
    area_m2: Float

    @classmethod
    def of(cls, meshes: list[Mesh]) -> Surface:
        """The surface of meshes of one body."""
        corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes])
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        return cls(corners, np.cumsum(np.linalg.norm(np.cross(first, second), axis=1) / 2))

    def point(self, shares: Float) -> Float:
        """Return the point (3,) for three numbers in [0, 1): one chooses the triangle, two the place on it."""
        place = np.searchsorted(self.area_m2, shares[0] * self.area_m2[-1], side="right")
        a, b, c = self.corners[min(int(place), len(self.corners) - 1)]
        root = np.sqrt(shares[1])
        point: Float = (1 - root) * a + root * (1 - shares[2]) * b + root * shares[2] * c
        return point
