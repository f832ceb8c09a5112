"""Registration of depth to another camera: each pixel is moved in space and drawn where the other camera sees it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from harness.sources.rectification import RawCamera
from vfoa.types import Float, Map, StereoRig

_LARGEST_PX = 16
"""Most pixels of the target image, in each direction, that one pixel of depth covers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Transform:
    """A rigid motion between camera frames: ``x_target = rotation (3, 3) @ x_source + translation_m (3,)``."""

    rotation: Float
    translation_m: Float

    def then(self, following: Transform) -> Transform:
        """Return this motion followed by another."""
        return Transform(
            rotation=following.rotation @ self.rotation,
            translation_m=following.rotation @ self.translation_m + following.translation_m,
        )

    def inverse(self) -> Transform:
        """Return the inverse motion."""
        return Transform(rotation=self.rotation.T, translation_m=-self.rotation.T @ self.translation_m)


class DepthRegistration:
    """Draws depth maps of one camera into the image of another.

    Parameters
    ----------
    source
        The depth camera of the maps: with its lens distortion, or without coefficients if they are rectified.
    target
        The rectified camera that the depth is drawn for.
    target_from_source
        From the depth camera's frame to the target's.
    """

    def __init__(self, source: RawCamera, target: StereoRig, target_from_source: Transform) -> None:
        self._target, self._motion = target, target_from_source
        width, height = source.size_px
        # A pixel is a square: its four corners tell which pixels of the target it covers.
        v, u = np.mgrid[: height + 1, : width + 1].astype(np.float64) - 0.5
        corners = _rays(np.column_stack([u.ravel(), v.ravel()]), source).reshape(height + 1, width + 1, 2)
        self._corners = corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]

    def register(self, depth_m: Map) -> Map:
        """Return the depth (H, W) float32 in the target camera, NaN where none was measured; the nearer one wins.

        A pixel is drawn as the rectangle around its corners, so that a target of a higher resolution has holes only
        where the depth camera sees nothing.
        """
        known = np.isfinite(depth_m)
        z = depth_m[known].astype(np.float64)
        projected = [self._project(rays[known], z) for rays in self._corners]
        u, v, depths = (np.stack(values) for values in zip(*projected, strict=True))
        rig, seen = self._target, depths.mean(axis=0)
        found = np.full(rig.height_px * rig.width_px, np.inf, np.float32)
        first_u, last_u = _covered(u)
        first_v, last_v = _covered(v)
        ahead = (depths > 0).all(axis=0)
        columns = min(int((last_u - first_u)[ahead].max(initial=-1)) + 1, _LARGEST_PX)
        rows = min(int((last_v - first_v)[ahead].max(initial=-1)) + 1, _LARGEST_PX)
        for row in range(rows):
            for column in range(columns):
                at_u, at_v = first_u + column, first_v + row
                drawn = ahead & (at_u <= last_u) & (at_v <= last_v)
                drawn &= (at_u >= 0) & (at_u < rig.width_px) & (at_v >= 0) & (at_v < rig.height_px)
                places = at_v[drawn].astype(np.intp) * rig.width_px + at_u[drawn].astype(np.intp)
                np.minimum.at(found, places, seen[drawn].astype(np.float32))
        found[np.isinf(found)] = np.nan
        return found.reshape(rig.height_px, rig.width_px)

    def _project(self, rays: Float, z: Float) -> tuple[Float, Float, Float]:
        """Columns and rows in the target, and depth there, of points at depth z on rays (N, 2) = (x / z, y / z)."""
        points = np.column_stack([rays * z[:, None], z]) @ self._motion.rotation.T + self._motion.translation_m
        depth = np.where(points[:, 2] > 0, points[:, 2], np.nan)
        rig = self._target
        u, v = points[:, 0] / depth * rig.fx_px + rig.cx_px, points[:, 1] / depth * rig.fy_px + rig.cy_px
        return u, v, points[:, 2]


def _covered(corners: Float) -> tuple[Float, Float]:
    """First and last integer (N,) within four corners (4, N); if there is none, the nearest one."""
    first, last = np.ceil(corners.min(axis=0)), np.ceil(corners.max(axis=0)) - 1
    nearest = np.round(corners.mean(axis=0))
    none = last < first
    return np.where(none, nearest, first), np.where(none, nearest, last)


def _rays(pixels: Float, camera: RawCamera) -> Float:
    """(x / z, y / z) (N, 2) of pixels (N, 2) in the camera's own image, distortion included."""
    if camera.model == "equidistant":
        d = camera.d if camera.d.size else np.zeros(4)
        return np.asarray(cv2.fisheye.undistortPoints(pixels[:, None], camera.k, d)).reshape(-1, 2)
    d = camera.d if camera.d.size else np.zeros(4)
    return np.asarray(cv2.undistortPoints(pixels[:, None], camera.k, d)).reshape(-1, 2)
