"""Depth maps of a single camera: its image without lens distortion, and registration to another camera."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from harness.sources.calibration import Calibration, check_camera
from harness.sources.rectification import ImageSize, RawCamera, Undistorter, rays
from vfoa.errors import VfoaError, located
from vfoa.settings import Settings
from vfoa.types import Float, Map, StereoRig


class Intrinsics(Settings):
    """A camera without lens distortion, pixels; fy defaults to fx.

    ``fov_deg``, the horizontal field of view of one image, stands for the other numbers: square pixels, and the
    principal point in the middle. ``baseline_m`` makes it the left camera of a rectified pair, whose right one has the
    same principal point.
    """

    fx_px: float | None = Field(default=None, gt=0)
    cx_px: float | None = None
    cy_px: float | None = None
    fy_px: float | None = Field(default=None, gt=0)
    fov_deg: float | None = Field(default=None, ge=5, le=170)
    baseline_m: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _numbers_or_field_of_view(self) -> Self:
        numbers = {"fx_px": self.fx_px, "cx_px": self.cx_px, "cy_px": self.cy_px, "fy_px": self.fy_px}
        given = [key for key, number in numbers.items() if number is not None]
        if self.fov_deg is not None and given:
            raise ValueError(f"found fov_deg and {', '.join(given)}; expected fov_deg alone, or fx_px, cx_px and cy_px")
        missing = [key for key in ("fx_px", "cx_px", "cy_px") if key not in given]
        if self.fov_deg is None and missing:
            raise ValueError(f"{', '.join(missing)}: missing; expected fx_px, cx_px and cy_px, or fov_deg")
        return self

    @property
    def notes(self) -> tuple[str, ...]:
        """A note that the focal length is only as good as the field of view that was given."""
        if self.fov_deg is None:
            return ()
        return (
            f"The focal length is made from a field of view of {self.fov_deg:g} degrees, without lens distortion: an "
            "error of the field of view scales every distance.",
        )

    def pair(self, where: str, size: ImageSize) -> Calibration:
        """Return the rectified pair for images of the (width, height) that ``size`` gives.

        Raises
        ------
        VfoaError
            Without a baseline; the message begins with ``where``.
        """
        if self.baseline_m is None:
            raise VfoaError(f"{where}: source.camera.baseline_m: missing; expected the pair's baseline in metres")
        return Calibration.of_equal_cameras(self._k(size), self.baseline_m)

    def camera(self, size_px: tuple[int, int]) -> RawCamera:
        """Return it as a camera for images of this (width, height)."""
        return pinhole(self._k(lambda: size_px), size_px)

    def _k(self, size: ImageSize) -> Float:
        if self.fov_deg is None:
            fx, fy, cx, cy = self.fx_px, self.fy_px or self.fx_px, self.cx_px, self.cy_px
        else:
            width, height = size()
            # an image reaches from -0.5 to width - 0.5: pixel coordinates are those of pixels' middles
            fx = fy = width / 2 / math.tan(math.radians(self.fov_deg) / 2)
            cx, cy = (width - 1) / 2, (height - 1) / 2
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64)


def check_one_calibration(calibration: object, camera: Intrinsics | None) -> None:
    """Reject settings with neither or both of a calibration's file and numbers."""
    if (calibration is None) == (camera is None):
        raise ValueError(
            f"found {'neither' if camera is None else 'both'}; expected either calibration (a file) or camera (numbers)"
        )


def pinhole(k: Float, size_px: tuple[int, int]) -> RawCamera:
    """Return a camera with this matrix (3, 3) and no distortion."""
    return RawCamera(size_px=size_px, k=k, d=np.zeros(0)).unrotated()


def without_distortion(camera: RawCamera) -> RawCamera:
    """Return the camera of images that were rectified already: the left part of P, or K if P is empty."""
    return camera.of_rectified_images().unrotated()


class DepthOptics(Undistorter):
    """Removes the lens distortion from images of one camera, and from depth maps in these images.

    A single camera is not rotated: the new camera has the matrix K of the old one and no distortion, so that z stays z.
    ``rig`` is that of the images and maps without distortion.

    Raises
    ------
    VfoaError
        If the camera is not calibrated; ``where`` opens the message, here and below.
    """

    def __init__(self, camera: RawCamera, where: str) -> None:
        (width, height), k = camera.size_px, camera.k
        fx, fy, cx, cy = (float(k[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
        with located(where):
            check_camera(camera.size_px, (fx, fy), (cx, cy))
        super().__init__(camera.unrotated(), where)
        self.rig = StereoRig.of_depth_camera(width_px=width, height_px=height, fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy)


_LARGEST_PX = 16
"""Most pixels of the target image, in each direction, that one pixel of depth covers."""


class DepthRegistration:
    """Draws depth maps of one camera into the image of another.

    Parameters
    ----------
    source
        The depth camera of the maps: with its lens distortion, or without coefficients if they are rectified.
    target
        The rectified camera that the depth is drawn for.
    target_from_source
        The rigid motion (4, 4) from the depth camera's frame to the target's, metres.
    """

    def __init__(self, source: RawCamera, target: StereoRig, target_from_source: Float) -> None:
        self._target, self._motion = target, target_from_source
        width, height = source.size_px
        # A pixel is a square: its four corners tell which pixels of the target it covers.
        v, u = np.mgrid[: height + 1, : width + 1].astype(np.float64) - 0.5
        corners = rays(np.column_stack([u.ravel(), v.ravel()]), source).reshape(height + 1, width + 1, 2)
        self._corners = corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]

    def register(self, depth_m: Map) -> Map:
        """Return the depth (H, W) float32 in the target camera, NaN where none was measured; the nearer one wins.

        A pixel is drawn as the rectangle around its corners, so that a target of a higher resolution has holes only
        where the depth camera sees nothing.
        """
        known = np.isfinite(depth_m)
        z = depth_m[known].astype(np.float64)
        projected = [self._project(corner[known], z) for corner in self._corners]
        u, v, depths = (np.stack(values) for values in zip(*projected, strict=True))
        rig, seen = self._target, depths.mean(axis=0)
        nearest_m = np.full(rig.height_px * rig.width_px, np.inf, np.float32)
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
                np.minimum.at(nearest_m, places, seen[drawn].astype(np.float32))
        nearest_m[np.isinf(nearest_m)] = np.nan
        return nearest_m.reshape(rig.height_px, rig.width_px)

    def _project(self, directions: Float, z: Float) -> tuple[Float, Float, Float]:
        """Columns and rows in the target, and depth there, of points (N, 2) = (x / z, y / z) at depth z."""
        points = np.column_stack([directions * z[:, None], z]) @ self._motion[:3, :3].T + self._motion[:3, 3]
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
