"""Rectification of two camera images to common rows: from known projections, or from the pose between two lenses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import ArrayLike

from harness.sources.calibration import Calibration, ProjectionError, check_size, check_skew, from_projections
from vfoa.errors import VfoaError
from vfoa.types import Float, Image, Map

Model = Literal["plumb_bob", "equidistant"]

MODELS: dict[str, Model] = {
    "": "plumb_bob",
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "plumb_bob",
    "equidistant": "equidistant",
    "fisheye": "equidistant",
    "kannala_brandt": "equidistant",
    "None": "plumb_bob",
    "Brown Conrady": "plumb_bob",
    "Modified Brown Conrady": "plumb_bob",
    "Inverse Brown Conrady": "plumb_bob",
    "Kannala Brandt4": "equidistant",
}
"""Names of distortion models in ROS, Foxglove and librealsense, whose Brown Conrady's are all projected alike, and are
``plumb_bob`` in its ROS driver.
"""

_MOST_SKEWED = 0.05
"""Of the rotation in a camera's pose, what rounding may leave of its product with its transpose, less the identity."""
_ROUNDED = 1e-6
"""Of a camera matrix, what computing may leave of zeros below its diagonal, as a share of the focal length."""
_COEFFICIENTS: dict[Model, tuple[int, ...]] = {"plumb_bob": (0, 4, 5, 8, 12, 14), "equidistant": (0, 4)}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawCamera:
    """One camera before rectification, in the terms of ROS's CameraInfo and OpenCV's stereoRectify.

    ``k`` (3, 3) in pixels, ``d`` OpenCV's coefficients (none: no distortion), ``r`` (3, 3) rectified_from_camera,
    ``p`` (3, 4) of the rectified camera, its fourth column in pixel metres (zeros: not known). ``model`` ``plumb_bob``
    also holds the rational, thin prism and tilted coefficients; ``equidistant`` is OpenCV's fisheye.
    """

    size_px: tuple[int, int]
    k: Float
    d: Float
    r: Float = field(default_factory=lambda: np.eye(3))
    p: Float = field(default_factory=lambda: np.zeros((3, 4)))
    model: Model = "plumb_bob"

    @property
    def key(self) -> bytes:
        """The bytes of all values: equal for equal cameras."""
        matrices = b"".join(matrix.tobytes() for matrix in (self.k, self.d, self.r, self.p))
        return f"{self.size_px} {self.model} {self.d.size} ".encode() + matrices

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RawCamera) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @property
    def is_rectified(self) -> bool:
        """Whether rectification would change no pixel."""
        return bool(not self.d.any() and np.array_equal(self.r, np.eye(3)) and np.array_equal(self.k, self.p[:, :3]))

    @property
    def has_p(self) -> bool:
        """Whether P is set: drivers send zeros for a camera that belongs to no calibrated pair."""
        return bool(self.p[0, 0] > 0 and self.p[1, 1] > 0)

    def of_rectified_images(self) -> RawCamera:
        """The camera of images that were rectified already: the left part of P, or K if P is not set; same P."""
        k = self.p[:, :3] if self.has_p else self.k
        return replace(self, k=k, d=np.zeros(0), r=np.eye(3))

    def unrotated(self) -> RawCamera:
        """The same camera, of which only the lens distortion is to be removed: without a rotation, z stays z."""
        return replace(self, r=np.eye(3), p=np.column_stack([self.k, np.zeros(3)]))


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
            where = f"{self.where}: {side}"
            check_lens(camera, where)
            _check_rotation(camera.r, where)
            _check_shape("P", camera.p, (3, 4), where)
        if self.left.size_px != self.right.size_px:
            raise VfoaError(
                "{}: found a left camera of {} x {} pixels and a right one of {} x {}; expected the same size".format(
                    self.where, *self.left.size_px, *self.right.size_px
                )
            )
        self.rectified()

    def rectified(self) -> Calibration:
        """The calibration of the rectified pair."""
        return from_projections(self.left.p, self.right.p, self.where, self.left.size_px)


Cameras = RawCalibration | Calibration
"""A pair before rectification, or one that is rectified already."""

ImageSize = Callable[[], tuple[int, int]]
"""Returns (width, height) of the clip's images; called only if a file depends on the size or lacks it."""


class Undistorter:
    """Moves the pixels of one camera's images to those of its rectified camera P; ``where`` opens the messages.

    Raises
    ------
    VfoaError
        By both methods, if an image is not of the calibration's size; ``kind`` names the image.
    """

    def __init__(self, camera: RawCamera, where: str) -> None:
        self._size_px, self._where = camera.size_px, where
        self._maps = None if camera.is_rectified else _undistortion_maps(camera)

    @property
    def keeps(self) -> bool:
        """Whether images stay unchanged."""
        return self._maps is None

    def image(self, image: Image, kind: str) -> Image:
        """Return a rectified image (H, W, 3) uint8; pixels that the camera did not see are black."""
        self._check_size(image, kind)
        if self._maps is None:
            return image
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_LINEAR), dtype=np.uint8)

    def depth(self, depth_m: Map) -> Map:
        """Return a rectified depth map (H, W), by nearest pixels: depths must not be averaged across edges."""
        self._check_size(depth_m, "depth map")
        if self._maps is None:
            return depth_m
        nan = float("nan")
        return np.asarray(cv2.remap(depth_m, *self._maps, cv2.INTER_NEAREST, borderValue=nan), dtype=np.float32)

    def _check_size(self, pixels: Image | Map, kind: str) -> None:
        check_size((pixels.shape[1], pixels.shape[0]), self._size_px, f"{self._where}: {kind}")


class Rectifier:
    """Rectifies the pairs of one calibration, or leaves them as they are if that is of rectified images.

    Pixels that no camera saw are black. ``calibration`` belongs to the images that :meth:`rectify` returns.
    """

    def __init__(self, cameras: Cameras) -> None:
        self.calibration = cameras if isinstance(cameras, Calibration) else cameras.rectified()
        self._sides: tuple[Undistorter, Undistorter] | None = None
        if isinstance(cameras, RawCalibration):
            self._sides = Undistorter(cameras.left, cameras.where), Undistorter(cameras.right, cameras.where)

    @property
    def keeps_left(self) -> bool:
        """Whether left images are rectified already, and stay unchanged."""
        return self._sides is None or self._sides[0].keeps

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Rectify two images (H, W, 3) uint8; images that are rectified already are returned unchanged.

        Raises
        ------
        VfoaError
            If an image is not of the calibration's size.
        """
        if self._sides is None:
            return left, right
        of_left, of_right = self._sides
        return of_left.image(left, "left image"), of_right.image(right, "right image")

    def rectify_left(self, left: Image) -> Image:
        """Rectify only the left image, as :meth:`rectify` does."""
        return left if self._sides is None else self._sides[0].image(left, "left image")


def check_lens(camera: RawCamera, where: str) -> None:
    """Reject an invalid camera matrix, or a wrong number of coefficients for the model."""
    k, d, counts = camera.k, camera.d, _COEFFICIENTS[camera.model]
    _check_shape("K", k, (3, 3), where)
    if not (k[0, 0] > 0 and k[1, 1] > 0):
        raise VfoaError(f"{where}: K: found focal lengths {k[0, 0]:g}, {k[1, 1]:g}; expected positive")
    if np.abs(k[[1, 2, 2], [0, 0, 1]]).max() > _ROUNDED * k[0, 0]:
        raise VfoaError(
            f"{where}: K: found {k.tolist()}; expected [fx 0 cx; 0 fy cy; 0 0 1] (transposed, as in MATLAB?)"
        )
    check_skew(k, where)
    if d.ndim != 1 or d.size not in counts or not np.isfinite(d).all():
        raise VfoaError(f"{where}: D: found {d.size} coefficients; expected one of {counts}, finite")


def _check_rotation(r: Float, where: str) -> None:
    """Reject a matrix that is not a rotation (3, 3)."""
    _check_shape("R", r, (3, 3), where)
    is_bounded = bool((np.abs(r) < 2).all())  # or its square overflows
    if not is_bounded or not np.allclose(r @ r.T, np.eye(3), atol=1e-4) or np.linalg.det(r) < 0:
        raise VfoaError(f"{where}: R: not a rotation; expected an orthonormal matrix (the identity if rectified)")


def _check_shape(name: str, matrix: Float, shape: tuple[int, int], where: str) -> None:
    if matrix.shape != shape or not np.isfinite(matrix).all():
        raise VfoaError(f"{where}: {name}: found shape {matrix.shape}; expected {shape}, finite")


def _undistortion_maps(camera: RawCamera) -> tuple[cv2.typing.MatLike, cv2.typing.MatLike]:
    """Position of each pixel of the rectified camera P in the camera's image: (H, W) float32 columns and rows."""
    lens = camera.k, _coefficients(camera), camera.r, camera.p[:, :3], camera.size_px, cv2.CV_32FC1
    if camera.model == "equidistant":
        return cv2.fisheye.initUndistortRectifyMap(*lens)
    return cv2.initUndistortRectifyMap(*lens)


def _coefficients(camera: RawCamera) -> Float:
    return camera.d if camera.d.size else np.zeros(4)


def rays(pixels: Float, camera: RawCamera) -> Float:
    """(x / z, y / z) (N, 2) of pixels (N, 2) in the camera's own image, distortion included."""
    undistort = cv2.fisheye.undistortPoints if camera.model == "equidistant" else cv2.undistortPoints
    return np.asarray(undistort(pixels[:, None], camera.k, _coefficients(camera))).reshape(-1, 2)


def motion_of(rotation: ArrayLike, translation_m: ArrayLike) -> Float:
    """The motion (4, 4) that is a rotation (3, 3) and then a translation (3,)."""
    matrix: Float = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation_m
    return matrix


def check_motion(matrix: Float, where: str) -> Float:
    """Return a matrix (4, 4) if it is a rotation and a translation, by rows; else raise a :class:`VfoaError`.

    Files have zeros for a pose that nobody has calibrated.
    """
    rotation = matrix[:3, :3]
    is_rotation = (np.abs(rotation) < 2).all() and np.abs(rotation @ rotation.T - np.eye(3)).max() < _MOST_SKEWED
    if not is_rotation or not np.allclose(matrix[3], [0, 0, 0, 1], atol=_ROUNDED):
        found = "zeros (not set)" if not rotation.any() else str(matrix.tolist())
        raise VfoaError(f"{where}: found {found}; expected a rotation and a translation, by rows, with 0 0 0 1 below")
    return matrix


def rectify_pose(left: RawCamera, right: RawCamera, rotation: Float, translation: Float, where: str) -> RawCalibration:
    """Return the pair with Bouguet's rectification, cropped to common pixels (OpenCV's alpha 0).

    x_right = rotation x_left + translation, in any unit; the fourth column of P2 has the same unit. The cameras' own R
    and P do not count. The view of fisheye lenses is about the axis of the rectified cameras.

    Raises
    ------
    VfoaError
        If the models differ, a matrix is wrong, or the cameras are not side by side, left before right.
    """
    for side, camera in (("left", left), ("right", right)):
        check_lens(camera, f"{where}: {side}")
    _check_rotation(rotation, where)
    if left.model != right.model:
        raise VfoaError(f"{where}: left is {left.model}, right {right.model}; expected one distortion model")
    if translation.shape != (3,) or not np.isfinite(translation).all() or not translation.any():
        raise VfoaError(f"{where}: T: found {translation.tolist()}; expected three finite numbers that are not all 0")
    along = cv2.Rodrigues(-0.5 * cv2.Rodrigues(rotation)[0])[0] @ translation  # in axes between those of both
    for axis, how in ((1, "above each other"), (2, "one behind the other, by a calibration that probably failed")):
        if abs(along[axis]) > abs(along[0]):
            raise VfoaError(f"{where}: T: {translation.tolist()}: the cameras stand {how}; expected side by side")
    try:
        r1, r2, p1, p2 = _rectification(left, right, rotation, translation)
    except cv2.error as error:
        raise VfoaError(f"{where}: OpenCV finds no rectification for these cameras: {str(error).strip()}") from None
    return RawCalibration(left=replace(left, r=r1, p=p1), right=replace(right, r=r2, p=p2), where=where)


def _rectification(
    left: RawCamera, right: RawCamera, rotation: Float, translation: Float
) -> tuple[Float, Float, Float, Float]:
    # cv2.fisheye refuses views of larger matrices
    pose = np.ascontiguousarray(rotation), np.ascontiguousarray(translation).reshape(3, 1)
    size_px = left.size_px
    lenses = left.k, _coefficients(left), right.k, _coefficients(right), size_px
    flag = cv2.CALIB_ZERO_DISPARITY
    if left.model == "equidistant":
        r1, r2 = map(np.asarray, cv2.fisheye.stereoRectify(*lenses, *pose, flag, newImageSize=size_px)[:2])
        p1 = _fisheye_projection(replace(left, r=r1), replace(right, r=r2))
        p2 = p1.copy()
        p2[0, 3] = p1[0, 0] * (r2 @ translation)[0]
        return r1, r2, p1, p2
    matrices = cv2.stereoRectify(*lenses, *pose, flags=flag, alpha=0)[:4]
    r1, r2, p1, p2 = (np.asarray(matrix, dtype=np.float64) for matrix in matrices)
    return r1, r2, p1, p2


def _fisheye_projection(*cameras: RawCamera) -> Float:
    """The projection (3, 4) of rectified images that reach no farther than the middles of the edges of both cameras.

    The principal point is in the middle of the image. OpenCV's is off by the mean of the tangents of these edges: with
    lenses that see 80 degrees aside, a turn by one degree moves it by half an image.
    """
    size = np.array(cameras[0].size_px, dtype=np.float64)
    middle, sides = (size - 1) / 2, np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])
    focal_px = 0.0
    for camera in cameras:
        edges = np.column_stack([rays(middle + sides * size / 2, camera), np.ones(len(sides))]) @ camera.r.T
        ahead = edges[:, 2] > 0
        tangents = np.abs((edges[:, :2] * sides).sum(axis=1))[ahead] / edges[ahead, 2]
        focal_px = max(focal_px, *(np.abs(sides) @ size / 2)[ahead] / tangents)
    return np.array([[focal_px, 0, middle[0], 0], [0, focal_px, middle[1], 0], [0, 0, 1, 0]])


def unset_matrices(left: RawCamera, right: RawCamera) -> str:
    """The matrices of zeros, which drivers send for those that are not set: "P", "R", "P and R" or ""."""
    matrices = {"P": (left.p, right.p), "R": (left.r, right.r)}
    return " and ".join(name for name, both in matrices.items() if not all(matrix.any() for matrix in both))


def pair_of_infos(left: RawCamera, right: RawCamera, where: str, baseline_m: float | None) -> RawCalibration:
    """Return the pair of two calibrations of ROS, by their own P, or with a given baseline in metres.

    Raises
    ------
    VfoaError
        If P or R are not set, or are not those of a rectified pair: it says that a baseline completes them.
    """
    if baseline_m is not None:
        return with_baseline(left, right, baseline_m, where)
    try:
        if unset := unset_matrices(left, right):
            raise ProjectionError(f"{where}: {unset}: found zeros (not set); expected the pair's")
        return RawCalibration(left=left, right=right, where=where)
    except ProjectionError as error:
        raise VfoaError(f"{error}, or --baseline METRES (baseline_m of [source]), which keeps K, D and R") from None


def with_baseline(left: RawCamera, right: RawCamera, baseline_m: float, where: str) -> RawCalibration:
    """Return the pair with its own K, D and R, and projections of this baseline in metres.

    Both projections get the focal lengths and the rows of the first camera that has a P, else those of the left K. An R
    of zeros, which drivers send for one that is not set, becomes the identity: the cameras are taken as parallel.

    Raises
    ------
    VfoaError
        If only one of the two has an R, or a matrix is wrong.
    """
    unset = [side for side, camera in (("left", left), ("right", right)) if not camera.r.any()]
    if len(unset) == 1:
        raise VfoaError(f"{where}: {unset[0]}: R: found zeros; expected a rotation, since the other camera has one")
    shared = next((camera.p[:, :3] for camera in (left, right) if camera.has_p), left.k)
    projections = [
        camera.p.copy() if camera.has_p else np.column_stack([shared, np.zeros(3)]) for camera in (left, right)
    ]
    for projection, offset in zip(projections, (0.0, -shared[0, 0] * baseline_m), strict=True):
        projection[0, 0], projection[1, 1], projection[1, 2] = shared[0, 0], shared[1, 1], shared[1, 2]
        projection[:, 3] = offset, 0, 0
    cameras = (
        replace(camera, r=np.eye(3) if unset else camera.r, p=projection)
        for camera, projection in zip((left, right), projections, strict=True)
    )
    return RawCalibration(left=next(cameras), right=next(cameras), where=where)


def calibrated_size_px(cameras: Cameras) -> tuple[int, int] | None:
    """The (width, height) that a calibration was made for; None if it is not given."""
    return cameras.size_px if isinstance(cameras, Calibration) else cameras.left.size_px


def in_metres(cameras: Cameras, unit_m: float) -> Cameras:
    """Return cameras whose baseline is in another unit, in metres."""
    if isinstance(cameras, Calibration):
        return replace(cameras, baseline_m=cameras.baseline_m * unit_m)
    left, right = (replace(camera, p=camera.p * [1, 1, 1, unit_m]) for camera in (cameras.left, cameras.right))
    return replace(cameras, left=left, right=right)


def scaled_to(cameras: Cameras, size_px: tuple[int, int]) -> Cameras:
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
            f"images of {size_px[0]} x {size_px[1]} pixels have another aspect ratio; expected that of {own[0]} x "
            f"{own[1]}, the size that the calibration is for"
        )
    shift = (scale - 1) / 2
    if isinstance(cameras, Calibration):
        places = {name: scale * getattr(cameras, name) + shift for name in ("cx_px", "cy_px", "cx_right_px")}
        return replace(cameras, fx_px=cameras.fx_px * scale, fy_px=cameras.fy_px * scale, size_px=size_px, **places)
    to_scaled = np.array([[scale, 0, shift], [0, scale, shift], [0, 0, 1]])
    left, right = (
        replace(camera, size_px=size_px, k=to_scaled @ camera.k, p=to_scaled @ camera.p)
        for camera in (cameras.left, cameras.right)
    )
    return replace(cameras, left=left, right=right)


def scaling_note(cameras: Cameras, size_px: tuple[int, int]) -> tuple[str, ...]:
    """A note if :func:`scaled_to` changes a calibration."""
    own = calibrated_size_px(cameras)
    if own is None or own == size_px:
        return ()
    return (f"the calibration of {own[0]} x {own[1]} pixels is scaled to the images' {size_px[0]} x {size_px[1]}",)


_LEAST_SHARE = 0.5
"""Of the lenses' focal length, what rectification usually leaves at least."""


def shrinking_note(cameras: Cameras) -> tuple[str, ...]:
    """A note if rectification makes what is in the middle of the images much smaller, as of very wide lenses."""
    if isinstance(cameras, Calibration):
        return ()
    lens_px, rectified_px = cameras.left.k[0, 0], cameras.left.p[0, 0]
    if rectified_px >= _LEAST_SHARE * lens_px:
        return ()
    return (
        f"rectification reduces fx from {lens_px:.4g} to {rectified_px:.4g} px, to keep the whole view of such wide "
        f"lenses: depth is {lens_px / rectified_px:.1f} times less precise than with the lens's fx. For a narrower "
        "view, give K1 D1 K2 D2 R1 R2 P1 P2 of OpenCV's stereoRectify (of cv2.fisheye: fov_scale below 1)",
    )
