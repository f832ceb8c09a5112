"""Calibration files of rectified stereo cameras: KITTI's text, OpenCV's YAML or XML."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from harness.files import read_bytes
from vfoa.errors import VfoaError
from vfoa.types import Float, StereoRig

_UNRECTIFIED = (("R", "T"), ("D1", "D2"), ("distCoeffs1", "distCoeffs2"), ("R1", "R2"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """A rectified pair: intrinsics in pixels, baseline in metres.

    ``size_px`` is the (width, height) it holds for, where the file says so.
    """

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    cx_right_px: float
    baseline_m: float
    size_px: tuple[int, int] | None = None

    def rig(self, width_px: int, height_px: int) -> StereoRig:
        """The rig for images of this size.

        Raises
        ------
        VfoaError
            If the calibration is for another size.
        """
        if self.size_px not in (None, (width_px, height_px)):
            raise VfoaError(f"the calibration is for {self.size_px} pixels, the images have ({width_px}, {height_px})")
        return StereoRig(
            width_px=width_px,
            height_px=height_px,
            fx_px=self.fx_px,
            fy_px=self.fy_px,
            cx_px=self.cx_px,
            cy_px=self.cy_px,
            baseline_m=self.baseline_m,
            cx_right_px=self.cx_right_px,
        )


def read_calibration(path: Path, *, kitti_cameras: tuple[int, int] = (2, 3), rectified: bool = False) -> Calibration:
    """Read a calibration file: OpenCV's (``.yml``, ``.yaml``, ``.xml``: P1 and P2 of stereoRectify) or KITTI's.

    Parameters
    ----------
    path
        The file.
    kitti_cameras
        Left and right camera of a KITTI file: (2, 3) is the colour pair, (0, 1) the gray one.
    rectified
        The images are rectified already, although an OpenCV file also tells how to do it.

    Raises
    ------
    VfoaError
        If the file cannot be read, lacks a matrix, or describes no rectified pair with a positive baseline.
    """
    if path.suffix.lower() in (".yml", ".yaml", ".xml"):
        return _read_opencv(path, rectified)
    return _read_kitti(path, kitti_cameras)


def from_projections(
    p_left: ArrayLike, p_right: ArrayLike, where: str, size_px: tuple[int, int] | None = None
) -> Calibration:
    """The calibration in two projection matrices (3, 4) of a rectified pair, fourth columns in pixel metres.

    B = (P_left[0, 3] - P_right[0, 3]) / fx: in KITTI's files neither camera is the origin.

    Raises
    ------
    VfoaError
        If the two do not share focal lengths and rows, or the right camera is not to the right of the left one.
    """
    left, right = np.asarray(p_left, dtype=np.float64), np.asarray(p_right, dtype=np.float64)
    if not (np.isfinite(left).all() and np.isfinite(right).all() and left[0, 0] > 0 and left[1, 1] > 0):
        raise VfoaError(f"{where}: expected finite matrices with positive focal lengths")
    for name, row, column in (("fx", 0, 0), ("fy", 1, 1), ("cy", 1, 2)):
        if not np.isclose(left[row, column], right[row, column], rtol=1e-6, atol=1e-3):
            raise VfoaError(
                f"{where}: {name} is {left[row, column]:g} left and {right[row, column]:g} right; "
                "expected the same in a rectified pair"
            )
    baseline = (left[0, 3] - right[0, 3]) / left[0, 0]
    if not baseline > 0:
        raise VfoaError(f"{where}: the baseline is {baseline:g} m; expected a positive one (left and right swapped?)")
    return Calibration(
        fx_px=float(left[0, 0]),
        fy_px=float(left[1, 1]),
        cx_px=float(left[0, 2]),
        cy_px=float(left[1, 2]),
        cx_right_px=float(right[0, 2]),
        baseline_m=float(baseline),
        size_px=size_px,
    )


def _read_kitti(path: Path, cameras: tuple[int, int]) -> Calibration:
    """``P2: 12 numbers`` (object and odometry sets) or ``P_rect_02: 12 numbers`` (raw recordings)."""
    lines = _kitti_lines(path)
    matrices = []
    for camera in cameras:
        key = next((key for key in (f"P{camera}", f"P_rect_{camera:02d}") if key in lines), None)
        if key is None:
            raise VfoaError(f"{path}: no line P{camera}: or P_rect_{camera:02d}:; expected KITTI's calibration")
        matrices.append(_kitti_numbers(path, *lines[key], 12).reshape(3, 4))
    size_key = f"S_rect_{cameras[0]:02d}"
    size = _kitti_numbers(path, *lines[size_key], 2).tolist() if size_key in lines else None
    where = f"{path}: P{cameras[0]} and P{cameras[1]}"
    left, right = matrices
    return from_projections(left, right, where, size_px=None if size is None else (int(size[0]), int(size[1])))


def _kitti_numbers(path: Path, line: int, text: str, expected: int) -> Float:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError as error:
        raise VfoaError(f"{path}:{line}: {error}; expected {expected} numbers") from None
    if values.size != expected:
        raise VfoaError(f"{path}:{line}: found {values.size} numbers; expected {expected}")
    return values


def _kitti_lines(path: Path) -> dict[str, tuple[int, str]]:
    try:
        text = read_bytes(path).decode()
    except UnicodeDecodeError:
        raise VfoaError(f"{path}: not text; expected KITTI's calibration, or OpenCV's in .yml or .xml") from None
    parts = [(number, *line.partition(":")) for number, line in enumerate(text.splitlines(), start=1)]
    return {key.strip(): (number, rest) for number, key, colon, rest in parts if colon}


def _read_opencv(path: Path, rectified: bool) -> Calibration:
    read_bytes(path)  # OpenCV says nothing of a file that is not there
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        try:
            matrices = {name: storage.getNode(name).mat() for name in ("P1", "P2")}
            size = _opencv_size(storage)
            unrectified = [pair for pair in _UNRECTIFIED if _undoes_something(storage, pair)]
        finally:
            storage.release()
    except (cv2.error, SystemError):  # OpenCV's binding raises the latter where parsing failed
        raise VfoaError(f"{path}: cannot be parsed; expected YAML or XML as OpenCV's FileStorage writes it") from None
    for name, matrix in matrices.items():
        if matrix is None or matrix.shape != (3, 4):
            found = "no such matrix" if matrix is None else f"shape {matrix.shape}"
            raise VfoaError(
                f"{path}: {name}: {found}; expected the (3, 4) matrix of stereoRectify: only rectified images are read"
            )
    if unrectified and not rectified:
        raise VfoaError(
            f"{path}: holds {' and '.join(unrectified[0])} of an unrectified pair, which is not rectified here; "
            "rectify the images first, or say rectified = true in [source] if they are"
        )
    return from_projections(matrices["P1"], matrices["P2"], f"{path}: P1 and P2", size_px=size)


def _opencv_size(storage: cv2.FileStorage) -> tuple[int, int] | None:
    width, height = (int(storage.getNode(name).real()) for name in ("image_width", "image_height"))
    return (width, height) if width > 0 and height > 0 else None


def _undoes_something(storage: cv2.FileStorage, names: tuple[str, str]) -> bool:
    """Whether these nodes hold a distortion or a rotation: images as the cameras saw them are not rectified."""
    matrices: list[Float] = [matrix for name in names if (matrix := storage.getNode(name).mat()) is not None]
    return any(not _is_trivial(matrix) for matrix in matrices)


def _is_trivial(matrix: Float) -> bool:
    return not matrix.any() or (matrix.shape == (3, 3) and np.array_equal(matrix, np.eye(3)))
