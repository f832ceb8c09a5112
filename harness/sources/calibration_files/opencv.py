"""Calibrations saved with OpenCV: matrices of stereoCalibrate and stereoRectify, under their usual names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from harness.sources.calibration import Calibration, from_projections
from harness.sources.calibration_files.documents import numbers
from harness.sources.calibration_files.options import Cameras, ImageSize, Options
from harness.sources.calibration_files.pose import Lens, rectify_pose
from harness.sources.rectification import Model, RawCalibration, RawCamera
from vfoa.errors import VfoaError
from vfoa.types import Float

_OF_A_CAMERA = {
    "K": ("k", "m", "mtx", "cm", "cameramatrix", "intrinsic", "intrinsics", "intrinsicmatrix"),
    "D": ("d", "dist", "distcoef", "distcoeff", "distcoeffs", "distortion", "distortioncoefficients"),
    "R": ("r", "rect", "rectification", "rectificationmatrix"),
    "P": ("p", "proj", "projmat", "projection", "projectionmatrix"),
}
_OF_THE_PAIR = {
    "R": ("r", "rot", "rotation", "rotationmatrix"),
    "T": ("t", "trans", "translation", "translationvector"),
}
_SIDES = {"1": ("1", "l", "left"), "2": ("2", "r", "right")}
_SIZES = ("imagesize", "imgsize", "size")

_LENSES = ("K1", "D1", "K2", "D2")
_POSE = ("R", "T")
_RECTIFICATION = ("R1", "R2", "P1", "P2")


def _spellings() -> dict[str, str]:
    """Lower-case names without underscores, and the role of each: ``cameramatrixleft`` is K1."""
    found = {name: role for role, names in _OF_THE_PAIR.items() for name in names}
    for role, names in _OF_A_CAMERA.items():
        for number, sides in _SIDES.items():
            for name in names:
                found |= {f"{name}{side}": f"{role}{number}" for side in sides}
                found |= {f"{side}{name}": f"{role}{number}" for side in sides[2:]}
    return found


_ROLES = _spellings()


def pair(document: Mapping[str, Any], size: ImageSize, options: Options, where: str) -> Cameras:
    """Return the pair: rectified by the file's R1 R2 P1 P2 if it has them, else by its R and T.

    P1 and P2 without distortion, rotation or translation describe images that are rectified already.

    Raises
    ------
    VfoaError
        If a matrix is missing, occurs under two names, or has a wrong shape.
    """
    found = _matrices(document, where)
    if found.keys() >= {"P1", "P2"} and (options.rectified or not _undone(found)):
        return _rectified(found, _size(document, where), where)
    size_px = _size(document, where)
    if found.keys() >= {*_LENSES, *_RECTIFICATION}:
        left, right = (_camera(found, number, size_px or size(), options, where) for number in "12")
        return RawCalibration(left=left, right=right, where=where)
    if found.keys() >= {*_LENSES, *_POSE}:
        first, second = (_lens(found, number, options, where) for number in "12")
        rotation, translation = _rotation(found["R"], where), numbers(found["T"], f"{where}: T", 3)
        return rectify_pose(first, second, rotation, translation, size_px or size(), where)
    raise VfoaError(_what_is_missing(found, where))


def _matrices(document: Mapping[str, Any], where: str) -> dict[str, Float]:
    names: dict[str, str] = {}
    for name in document:
        role = _ROLES.get(str(name).lower().replace("_", ""))
        if role in names:
            raise VfoaError(f"{where}: {names[role]} and {name} both are {role}; expected one of them")
        if role is not None:
            names[role] = name
    found = {}
    for role, name in names.items():
        value = document[name]
        if isinstance(value, np.ndarray):
            found[role] = np.asarray(value, dtype=np.float64)
        else:
            found[role] = numbers(value, f"{where}: {name}")
    return found


def _rectified(found: Mapping[str, Float], size_px: tuple[int, int] | None, where: str) -> Calibration:
    left, right = (_shaped(found, f"P{number}", (3, 4), where) for number in "12")
    return from_projections(left, right, f"{where}: P1 and P2", size_px=size_px)


def _camera(
    found: Mapping[str, Float], number: str, size_px: tuple[int, int], options: Options, where: str
) -> RawCamera:
    lens = _lens(found, number, options, where)
    rotation, projection = _shaped(found, f"R{number}", (3, 3), where), _shaped(found, f"P{number}", (3, 4), where)
    return RawCamera(size_px=size_px, k=lens.k, d=lens.d, r=rotation, p=projection, model=lens.model)


def _lens(found: Mapping[str, Float], number: str, options: Options, where: str) -> Lens:
    model: Model = "equidistant" if options.fisheye else "plumb_bob"
    return Lens(k=_shaped(found, f"K{number}", (3, 3), where), d=found[f"D{number}"].ravel(), model=model)


def _rotation(value: Float, where: str) -> Float:
    """A matrix, or OpenCV's rotation vector."""
    if value.size == 3:
        return np.asarray(cv2.Rodrigues(value.reshape(3))[0], dtype=np.float64)
    return _shaped({"R": value}, "R", (3, 3), where)


def _shaped(found: Mapping[str, Float], name: str, shape: tuple[int, int], where: str) -> Float:
    matrix = found[name]
    if matrix.size != shape[0] * shape[1] or matrix.shape not in (shape, (matrix.size,)):
        raise VfoaError(f"{where}: {name}: found shape {matrix.shape}; expected {shape}")
    return matrix.reshape(shape)


def _size(document: Mapping[str, Any], where: str) -> tuple[int, int] | None:
    plain = {str(name).lower().replace("_", ""): value for name, value in document.items()}
    pairs = [("imagewidth", "imageheight"), ("width", "height")]
    values = next((([plain[w], plain[h]]) for w, h in pairs if w in plain and h in plain), None)
    values = values or next((plain[name] for name in _SIZES if name in plain), None)
    if values is None:
        return None
    width, height = numbers(values, f"{where}: image size", 2)
    return (int(width), int(height)) if width > 0 and height > 0 else None


def _undone(found: Mapping[str, Float]) -> list[str]:
    """Names of the distortion, rotation and translation in the file that are not trivial."""
    return [name for name in ("R", "T", "D1", "D2", "R1", "R2") if name in found and not _is_trivial(found[name])]


def _is_trivial(matrix: Float) -> bool:
    return not matrix.any() or (matrix.size == 9 and np.array_equal(matrix.reshape(3, 3), np.eye(3)))


def _what_is_missing(found: Mapping[str, Float], where: str) -> str:
    there = ", ".join(sorted(found)) or "none of them"
    expected = "expected K1 D1 K2 D2 with R T or R1 R2 P1 P2"
    if found.keys() >= {"P1", "P2"}:
        undone = " and ".join(_undone(found))
        return (
            f"{where}: holds {undone} of an unrectified pair but not all that rectifies it: found {there}; {expected}, "
            "or rectified = true in [source] if the images are rectified"
        )
    return f"{where}: found {there}; {expected}, or P1 P2 of rectified images"
