"""Rectification of two camera images to common rows. The maps are computed once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from harness.sources.calibration import Calibration, from_projections
from vfoa.errors import VfoaError
from vfoa.types import Float, Image

Model = Literal["plumb_bob", "equidistant"]

MODELS: dict[str, Model] = {
    "": "plumb_bob",
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "plumb_bob",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "kannala_brandt": "equidistant",
}
"""Names of distortion models in ROS and Foxglove."""

_COEFFICIENTS: dict[Model, tuple[int, ...]] = {"plumb_bob": (0, 4, 5, 8, 12, 14), "equidistant": (0, 4)}


@dataclass(frozen=True, slots=True, kw_only=True)
class RawCamera:
    """One camera before rectification, in the terms of ROS's CameraInfo and OpenCV's stereoRectify.

    ``k`` (3, 3) in pixels, ``d`` OpenCV's coefficients (none: no distortion), ``r`` (3, 3) rectified_from_camera,
    ``p`` (3, 4) of the rectified camera, its fourth column in pixel metres. ``model`` ``plumb_bob`` also holds the
    rational, thin prism and tilted coefficients; ``equidistant`` is OpenCV's fisheye.
    """

    size_px: tuple[int, int]
    k: Float
    d: Float
    r: Float
    p: Float
    model: Model = "plumb_bob"

    @property
    def key(self) -> bytes:
        """Equal for equal cameras."""
        matrices = b"".join(matrix.tobytes() for matrix in (self.k, self.d, self.r, self.p))
        return f"{self.size_px} {self.model} {self.d.size} ".encode() + matrices

    @property
    def is_rectified(self) -> bool:
        """Whether rectification would change no pixel."""
        return bool(not self.d.any() and np.array_equal(self.r, np.eye(3)) and np.array_equal(self.k, self.p[:, :3]))


@dataclass(frozen=True, slots=True, kw_only=True)
class RawCalibration:
    """A pair of cameras before rectification. ``where`` names the file or the topics, for messages.

    Raises
    ------
    VfoaError
        If a matrix or the number of coefficients is wrong, or the rectified pair has no positive baseline.
    """

    left: RawCamera
    right: RawCamera
    where: str

    def __post_init__(self) -> None:
        for side, camera in (("left", self.left), ("right", self.right)):
            _check(camera, f"{self.where}: {side}")
        if self.left.size_px != self.right.size_px:
            raise VfoaError(
                f"{self.where}: left is {self.left.size_px} pixels, right {self.right.size_px}; expected the same"
            )
        self.rectified()

    def rectified(self) -> Calibration:
        """The calibration of the rectified pair."""
        return from_projections(self.left.p, self.right.p, self.where, self.left.size_px)


class Rectifier:
    """Rectifies the pairs of one calibration; pixels that no camera saw are black."""

    def __init__(self, calibration: RawCalibration) -> None:
        self._calibration = calibration
        self._maps = tuple(
            None if camera.is_rectified else _maps(camera) for camera in (calibration.left, calibration.right)
        )

    @property
    def calibration(self) -> Calibration:
        """Calibration of the images that :meth:`rectify` returns."""
        return self._calibration.rectified()

    @property
    def keeps_left(self) -> bool:
        """Whether left images are rectified already, and stay unchanged."""
        return self._maps[0] is None

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Rectify two images (H, W, 3) uint8; images that are rectified already are returned unchanged.

        Raises
        ------
        VfoaError
            If an image is not of the calibration's size.
        """
        return self._remap(left, "left", 0), self._remap(right, "right", 1)

    def rectify_left(self, left: Image) -> Image:
        """Rectify only the left image, as :meth:`rectify` does."""
        return self._remap(left, "left", 0)

    def _remap(self, image: Image, side: str, index: int) -> Image:
        size = (image.shape[1], image.shape[0])
        if size != self._calibration.left.size_px:
            raise VfoaError(
                f"{self._calibration.where}: the calibration is for {self._calibration.left.size_px} pixels, "
                f"the {side} image has {size}"
            )
        maps = self._maps[index]
        return image if maps is None else np.asarray(cv2.remap(image, *maps, cv2.INTER_LINEAR), dtype=np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """The rectifier of a pair (None: it is rectified already), and the calibration of the rectified pair."""

    calibration: Calibration
    rectifier: Rectifier | None

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Both images (H, W, 3), rectified."""
        return (left, right) if self.rectifier is None else self.rectifier.rectify(left, right)

    def rectify_left(self, left: Image) -> Image:
        """The left image, rectified."""
        return left if self.rectifier is None else self.rectifier.rectify_left(left)


def optics(cameras: RawCalibration | Calibration) -> Optics:
    """The optics of a pair; computes the maps."""
    if isinstance(cameras, Calibration):
        return Optics(calibration=cameras, rectifier=None)
    return Optics(calibration=cameras.rectified(), rectifier=Rectifier(cameras))


def check_lens(k: Float, d: Float, model: Model, where: str) -> None:
    """Reject an invalid camera matrix, or a wrong number of coefficients for the model."""
    _check_shape("K", k, (3, 3), where)
    if not (k[0, 0] > 0 and k[1, 1] > 0):
        raise VfoaError(f"{where}: K: found focal lengths {k[0, 0]:g}, {k[1, 1]:g}; expected positive")
    if d.ndim != 1 or d.size not in _COEFFICIENTS[model] or not np.isfinite(d).all():
        raise VfoaError(f"{where}: D: found {d.size} coefficients; expected one of {_COEFFICIENTS[model]}, finite")


def check_rotation(r: Float, where: str) -> None:
    """Reject a matrix that is no rotation (3, 3)."""
    _check_shape("R", r, (3, 3), where)
    is_bounded = bool((np.abs(r) < 2).all())  # or its square overflows
    if not is_bounded or not np.allclose(r @ r.T, np.eye(3), atol=1e-4) or np.linalg.det(r) < 0:
        raise VfoaError(f"{where}: R: not a rotation; expected an orthonormal matrix (the identity if rectified)")


def _check(camera: RawCamera, where: str) -> None:
    check_lens(camera.k, camera.d, camera.model, where)
    check_rotation(camera.r, where)
    _check_shape("P", camera.p, (3, 4), where)


def _check_shape(name: str, matrix: Float, shape: tuple[int, int], where: str) -> None:
    if matrix.shape != shape or not np.isfinite(matrix).all():
        raise VfoaError(f"{where}: {name}: found shape {matrix.shape}; expected {shape}, finite")


def _maps(camera: RawCamera) -> tuple[cv2.typing.MatLike, cv2.typing.MatLike]:
    """Position of each rectified pixel in the camera's image: (H, W) float32 columns and rows."""
    new, d = camera.p[:, :3], camera.d if camera.d.size else np.zeros(4)
    if camera.model == "equidistant":
        return cv2.fisheye.initUndistortRectifyMap(camera.k, d, camera.r, new, camera.size_px, cv2.CV_32FC1)
    return cv2.initUndistortRectifyMap(camera.k, d, camera.r, new, camera.size_px, cv2.CV_32FC1)
