"""A calibration for images of another resolution: scaled if the aspect ratio is the same, refused otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.options import Cameras
from harness.sources.rectification import RawCamera
from vfoa.errors import VfoaError
from vfoa.types import Float

Size = tuple[int, int]


def calibrated_size_px(cameras: Cameras) -> Size | None:
    """The (width, height) that a calibration was made for; None if it is not given."""
    return cameras.size_px if isinstance(cameras, Calibration) else cameras.left.size_px


def scaled_to(cameras: Cameras, size_px: Size) -> Cameras:
    """Return the calibration of images that were scaled to (width, height); the same object if that is its own size.

    Pixel centres have whole numbers: column c becomes s (c + 0.5) - 0.5.

    Raises
    ------
    VfoaError
        If the images have another aspect ratio: they were cropped, and it is not known where.
    """
    own = calibrated_size_px(cameras)
    if own is None or own == size_px:
        return cameras
    scale = size_px[0] / own[0]
    if abs(own[1] * scale - size_px[1]) > max(1.0, scale):
        raise VfoaError(
            f"the calibration is for {own} pixels, the images have {size_px}: another aspect; expected the calibration "
            "of these images"
        )
    if isinstance(cameras, Calibration):
        return replace(
            cameras,
            fx_px=cameras.fx_px * scale,
            fy_px=cameras.fy_px * scale,
            cx_px=_moved(cameras.cx_px, scale),
            cy_px=_moved(cameras.cy_px, scale),
            cx_right_px=_moved(cameras.cx_right_px, scale),
            size_px=size_px,
        )
    left, right = (_scaled(camera, scale, size_px) for camera in (cameras.left, cameras.right))
    return replace(cameras, left=left, right=right)


def scaling_note(cameras: Cameras, size_px: Size) -> tuple[str, ...]:
    """A note if :func:`scaled_to` changes a calibration."""
    own = calibrated_size_px(cameras)
    if own is None or own == size_px:
        return ()
    return (f"the calibration of {own[0]} x {own[1]} pixels is scaled to the images' {size_px[0]} x {size_px[1]}",)


def _scaled(camera: RawCamera, scale: float, size_px: Size) -> RawCamera:
    projection = np.hstack(
        [_scaled_matrix(camera.p[:, :3], scale), camera.p[:, 3:] * np.array([[scale], [scale], [1]])]
    )
    return replace(camera, size_px=size_px, k=_scaled_matrix(camera.k, scale), p=projection)


def _scaled_matrix(k: Float, scale: float) -> Float:
    found = k.copy()
    found[:2] *= scale
    found[0, 2], found[1, 2] = _moved(k[0, 2], scale), _moved(k[1, 2], scale)
    return found


def _moved(center_px: float, scale: float) -> float:
    return float(scale * (center_px + 0.5) - 0.5)
