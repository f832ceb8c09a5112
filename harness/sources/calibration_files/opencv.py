"""OpenCV: matrices of stereoCalibrate and stereoRectify, and of calibrateCamera, as cameras."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

import cv2
import numpy as np

from harness.sources.calibration import Calibration, ProjectionError, from_projections
from harness.sources.calibration_files.documents import METRES, Document, numbers
from harness.sources.calibration_files.image_size import image_size
from harness.sources.calibration_files.opencv_names import (
    bare_name,
    is_of_one_camera,
    names_unit,
    numbered_from_1,
    one_level,
    role_alone,
    role_of,
    stated_unit_m,
)
from harness.sources.calibration_files.texts import IncompleteCalibrationError
from harness.sources.rectification import (
    Cameras,
    ImageSize,
    Model,
    RawCalibration,
    RawCamera,
    in_metres,
    rectify_pose,
)
from vfoa.errors import VfoaError, listed
from vfoa.types import Float

_MOST_RADIANS = 0.15
"""Longest rotation vector of a pair that is read, 9 degrees; longer ones are probably in degrees.

The cameras of most pairs differ by less than this in radians, and by more than this in degrees.
"""
_MOST_OFF = 2.0
"""Largest ratio of a baseline to the one of the matrices; a nominal one is off by some percent, another unit by 10."""
_BASELINE = re.compile(rf".*baseline(?:{'|'.join(METRES)})?")
_OF_LENS = re.compile(r"dist(?!ance)|coef|lens|k[1-6]$")
"""Part of the bare name of a lens's distortion."""
_MOST_TANGENTIAL = 0.02
"""Largest p1 or p2 of a lens; those of whole ones are below 0.01."""
_SHAPES = {"K": (3, 3), "R": (3, 3), "P": (3, 4)}
_LENSES = ("K1", "D1", "K2", "D2")
_RECTIFICATION = ("R1", "R2", "P1", "P2")
_WAYS = _RECTIFICATION, ("R", "T")
"""What rectifies images, beside the lenses."""


_XI = re.compile(r"(?:left|right)?(?:camera)?xi(?:[012lr]|left|right)?")
_TRUTHS = {"true": True, "1": True, "false": False, "0": False}
_KINDS_OF_LENSES = {
    **dict.fromkeys(("fisheye", "equidistant", "kannala", "kb4"), True),
    **dict.fromkeys(("pinhole", "plumb", "brown", "radtan", "rational"), False),
}
"""Parts of what people call a model of lenses, and whether it is that of cv2.fisheye; the first one counts."""
_MODELS: dict[bool, Model] = {True: "equidistant", False: "plumb_bob"}


def opencv_pair(
    document: Document, size: ImageSize, where: str, *, rectified: bool, fisheye: bool | None, has_unit: bool
) -> Cameras:
    """Return the pair: rectified by the file's R1 R2 P1 P2 if it has them, else by its R and T.

    P1 and P2 without distortion, rotation or translation describe images that are rectified already, and so do K1 and
    K2 with a baseline. Of R1 R2 P1 P2, a matrix of zeros was not computed, and does not count; nor does any matrix
    without numbers. Lengths are in metres; in the file's own unit if ``has_unit`` (the user gives it) or the file does
    not say it. ``fisheye`` is whether the lenses are those of cv2.fisheye; None is what the file says.

    Raises
    ------
    VfoaError
        If a matrix is missing, occurs under two names, or has a wrong shape, or nothing says whether four coefficients
        are of cv2.fisheye.
    """
    document = _with_pair_table(document)
    cameras = _pair(document, size, where, rectified=rectified, fisheye=fisheye)
    return cameras if has_unit else in_metres(cameras, _unit_m(document, cameras, where))


def _unit_m(document: Document, cameras: Cameras, where: str) -> float:
    """The unit of a file's matrices, by a translation or a baseline whose name has a unit (``translation_mm``).

    People write both beside matrices in metres, too, so the lengths are compared.
    """
    lengths = [
        (name, value, unit_m)
        for name, value in one_level(document)
        if value is not None and (unit_m := stated_unit_m(name)) is not None
    ]
    if not lengths:
        return 1.0
    name, value, own_m = min(lengths, key=lambda length: not names_unit(length[0]))
    baseline = float(np.linalg.norm(numbers(value, f"{where}: {name}")))
    length = (cameras if isinstance(cameras, Calibration) else cameras.rectified()).baseline_m
    for unit_m in METRES.values():
        if 1 / _MOST_OFF < baseline * own_m / (length * unit_m) < _MOST_OFF:
            return unit_m
    raise VfoaError(
        f"{where}: {name}: found {baseline:g}, and cameras {length:g} apart by the matrices; expected the same in m, "
        'cm or mm: say calibration_unit = "mm" (or "cm", "m"), the unit of the matrices, or baseline_m = in [source]'
    )


def _baseline(document: Document, where: str) -> float | None:
    """The distance of the cameras that a file says, in its own unit; None if it says none."""
    names = [name for name in document if _BASELINE.fullmatch(bare_name(name))]
    if not names:
        return None
    name = min(names, key=lambda name: stated_unit_m(name) is not None)
    baseline = float(numbers(document[name], f"{where}: {name}", 1)[0])
    if not baseline > 0:
        raise VfoaError(f"{where}: {name}: found {baseline:g}; expected a positive number")
    return baseline


def _pair(document: Document, size: ImageSize, where: str, *, rectified: bool, fisheye: bool | None) -> Cameras:
    """The pair of :func:`opencv_pair` in the file's own unit."""
    document = numbered_from_1(dict(one_level(document)), where)
    _check_model(document, where)
    read = _opencv_matrices(document, where)
    unset = [name for name, matrix in read.items() if not matrix.any() and (name in _RECTIFICATION or not matrix.size)]
    matrices = {name: matrix for name, matrix in read.items() if name not in unset}
    size_px = image_size(document, matrices.get("K1", matrices.get("P1")), where)
    unrectified = [
        name for name in ("R", "T", "D1", "D2", "R1", "R2") if name in matrices and not _is_trivial(matrices[name])
    ]
    is_bare = not unrectified
    if matrices.keys() >= {"P1", "P2"} and (rectified or is_bare):
        left, right = (_of_shape(matrices, f"P{number}", where) for number in "12")
        return from_projections(left, right, f"{where}: P1 and P2", size_px=size_px)
    if matrices.keys() >= {"K1", "K2"} and is_bare and (baseline := _baseline_of_bare(document, where)) is not None:
        left, right = (np.hstack([_of_shape(matrices, f"K{number}", where), np.zeros((3, 1))]) for number in "12")
        right[0, 3] = -right[0, 0] * baseline
        return from_projections(left, right, f"{where}: K1 and K2", size_px=size_px)
    is_rectifying, is_posed = (matrices.keys() >= {*_LENSES, *names} for names in _WAYS)
    if not is_rectifying and not is_posed:
        raise _lacking(document, matrices, unset, unrectified, where)
    first, second = _raw_cameras(document, matrices, lambda: size_px or size(), where, fisheye)
    if not is_rectifying:
        return _posed(first, second, matrices, where)
    r1, r2, p1, p2 = (_of_shape(matrices, name, where) for name in _RECTIFICATION)
    return RawCalibration(left=replace(first, r=r1, p=p1), right=replace(second, r=r2, p=p2), where=where)


def _baseline_of_bare(document: Document, where: str) -> float | None:
    """The distance of cameras without lenses, in the file's own unit; None if it says none, or names a lens."""
    has_lens = any(role_of(name) is None and _OF_LENS.search(bare_name(name)) for name in document)
    return None if has_lens else _baseline(document, where)


def _raw_cameras(
    document: Document, matrices: Mapping[str, Float], size: ImageSize, where: str, fisheye: bool | None
) -> tuple[RawCamera, RawCamera]:
    """Both cameras with their lenses, which are those of cv2.fisheye if ``fisheye``, or if the file says so."""
    is_fisheye = says_fisheye(document) if fisheye is None else fisheye
    if is_fisheye is None:
        columns = [name for name in document if role_of(name) in ("D1", "D2")]
        _check_lenses_are_told(document, columns, where, "in [source]")
    size_px, model = size(), _MODELS[bool(is_fisheye)]
    first, second = (
        RawCamera(
            size_px=size_px, k=_of_shape(matrices, f"K{number}", where), d=matrices[f"D{number}"].ravel(), model=model
        )
        for number in "12"
    )
    return first, second


def _posed(first: RawCamera, second: RawCamera, matrices: Mapping[str, Float], where: str) -> RawCalibration:
    """Two cameras rectified by the R and T between them."""
    rotation = matrices["R"]
    if rotation.size == 3:  # OpenCV's rotation vector
        if (angle := float(np.linalg.norm(rotation))) > _MOST_RADIANS:
            raise VfoaError(
                f"{where}: R: found a rotation vector of length {angle:.3g}; expected radians, at most "
                f"{_MOST_RADIANS:g}: if it is in degrees, convert it; if the cameras do differ by "
                f"{np.degrees(angle):.0f} degrees, give R as a matrix of 3 x 3 numbers"
            )
        rotation = np.asarray(cv2.Rodrigues(rotation.reshape(3))[0], dtype=np.float64)
    rotation, translation = _of_shape({"R": rotation}, "R", where), numbers(matrices["T"], f"{where}: T", 3)
    try:
        return rectify_pose(first, second, rotation, translation, where)
    except ProjectionError as error:
        raise VfoaError(
            f"{error}, and x_right = R x_left + T: if T is where the right camera stands, give T = -R times it"
        ) from None


def _lacking(
    document: Document, matrices: Mapping[str, Float], unset: Iterable[str], unrectified: Iterable[str], where: str
) -> VfoaError:
    """The error of a document without all matrices of a pair: which it has, which are ``unset``, what is expected."""
    if not matrices and (single := [name for name in document if is_of_one_camera(name)]):
        return IncompleteCalibrationError(
            f"{where}: found {listed(single, 4)} and no matrices of a pair; expected, of one with rectified images, a "
            "baseline and no distortion beside it, or four numbers, --fx --cx --cy and --baseline in metres; of "
            "another, K1 D1 K2 D2 with R T or R1 R2 P1 P2"
        )
    there, expected = ", ".join(sorted(matrices)) or "none of them", "expected K1 D1 K2 D2 with R T or R1 R2 P1 P2"
    if others := [name for name in document if role_of(name) is None]:
        there += f" (and, not known, {listed(others, 8)})"
    if unset:
        there += f", and zeros or nothing as {', '.join(unset)}"
    if matrices.keys() >= {"P1", "P2"}:
        return VfoaError(
            f"{where}: holds {' and '.join(unrectified)} of an unrectified pair but not all that rectifies it: found "
            f"{there}; {expected}, or rectified = true in [source] if the images are rectified"
        )
    return VfoaError(f"{where}: found {there}; {expected}, or, of rectified images, P1 P2, or K1 K2 and baseline")


def opencv_camera(
    document: Document, size_px: tuple[int, int], where: str, *, rectified: bool = False
) -> RawCamera | None:
    """Return the camera of a file of calibrateCamera, which has one matrix, for images of this size if it names none.

    None: there is no matrix under such a name. ``rectified``: the lens of the coefficients does not matter.

    Raises
    ------
    VfoaError
        If the matrix or the coefficients occur under two names or have a wrong shape, or may be of cv2.fisheye.
    """
    _check_model(document, where)
    read = {role: [name for name in document if role_alone(name) == role] for role in "KD"}
    for role, names in read.items():
        if len(names) > 1:
            raise VfoaError(f"{where}: {' and '.join(names)} all are {role}; expected one of them")
    if not read["K"]:
        return None
    values = {role: numbers(document[name], f"{where}: {name}") for role, names in read.items() for name in names}
    k = _of_shape(values, "K", where)
    size = image_size(document, k, where) or size_px
    is_fisheye = says_fisheye(document)
    if is_fisheye is None and not rectified:
        _check_lenses_are_told(document, read["D"], where, "in the file, beside it")
    model: Model = "equidistant" if is_fisheye else "plumb_bob"
    return RawCamera(size_px=size, k=k, d=values.get("D", np.zeros(0)), model=model)


def _check_model(document: Document, where: str) -> None:
    """Raise a :class:`VfoaError` for a camera of cv2.omnidir, whose K and D have the names of others; xi is not 0."""
    if name := next((name for name in document if _XI.fullmatch(bare_name(name)) and np.any(document[name])), None):
        raise VfoaError(
            f"{where}: {name}: found a camera of cv2.omnidir, whose model is not read; expected one of "
            "cv2.stereoCalibrate or cv2.fisheye: calibrate again with one of these"
        )


def _check_lenses_are_told(document: Document, names: Iterable[str], where: str, place: str) -> None:
    """Raise a :class:`VfoaError` for four coefficients under these names that are probably of cv2.fisheye.

    It returns a column, cv2.stereoCalibrate five or more. Four in a row or in a list are mostly k1, k2, p1, p2, which
    people and other programs write; p1 and p2 of lenses are small.
    """
    for name in names:
        d = numbers(document[name], f"{where}: {name}")
        is_column = np.shape(document[name]) == (4, 1)
        if d.size == 4 and d.any() and (is_column or np.abs(d[2:]).max() > _MOST_TANGENTIAL):
            found = "a column of 4 coefficients" if is_column else f"the coefficients {d.tolist()}"
            raise VfoaError(
                f"{where}: {name}: found {found}, such as cv2.fisheye returns, and nothing that names the lens; "
                f"expected fisheye = true {place}, or fisheye = false if they are k1, k2, p1, p2"
            )


def rectifies(document: Document) -> bool:
    """Whether a document has K and D of both cameras, and how they stand or how images are rectified."""
    roles = {role_of(name) for name, _ in one_level(document)}
    return any(roles >= {*_LENSES, *names} for names in _WAYS)


def with_equal_cameras(document: Document, where: str, *, rectified: bool) -> Document:
    """The values of a document with one camera beside a baseline, its matrix as that of both; others as they are.

    Such a camera is that of rectified images: with the distortion of a lens it is none, unless they are ``rectified``.
    """
    alone = {role: [name for name in document if role_alone(name) == role] for role in "KD"}
    has_baseline = any(_BASELINE.fullmatch(bare_name(name)) for name in document)
    if len(alone["K"]) != 1 or not has_baseline or any(map(role_of, document)):
        return document
    if not rectified and any(numbers(document[name], f"{where}: {name}").any() for name in alone["D"]):
        return document
    rest = {name: value for name, value in document.items() if role_alone(name) not in ("K", "D")}
    return {**rest, **dict.fromkeys(("K1", "K2"), document[alone["K"][0]])}


def is_pair(document: Document) -> bool:
    """Whether a document has K of both cameras, and how they stand or their distance."""
    named = [name for name, _ in one_level(document)]
    roles = {role_of(name) for name in named}
    return roles >= {"K1", "K2"} and (
        roles >= {"R", "T"} or any(_BASELINE.fullmatch(bare_name(name)) for name in named)
    )


def _with_pair_table(document: Document) -> Document:
    """The values of a document and of its only table with a pair: ``{"stereo_calibration": {"K1": ...}}``."""
    tables = {name: value for name, value in document.items() if isinstance(value, Mapping) and rectifies(value)}
    if len(tables) != 1 or rectifies(document):
        return document
    ((_, table),) = tables.items()
    return {**{name: value for name, value in document.items() if name not in tables}, **table}


def _opencv_matrices(document: Document, where: str) -> dict[str, Float]:
    names: dict[str, str] = {}
    for name in sorted(document, key=names_unit):
        role = role_of(name)
        if role in names and names_unit(name):  # the same in another unit, which is compared
            continue
        if role in names:
            raise VfoaError(f"{where}: {names[role]} and {name} both are {role}; expected one of them")
        if role is not None:
            names[role] = name
    return {
        role: np.asarray(value, np.float64)
        if isinstance(value := document[name], np.ndarray)
        else numbers(value, f"{where}: {name}")
        for role, name in names.items()
    }


def _of_shape(matrices: Mapping[str, Float], name: str, where: str) -> Float:
    """A matrix (rows, columns), which a file may also hold as a list."""
    matrix, shape = matrices[name], _SHAPES[name[0]]
    if matrix.shape not in (shape, (shape[0] * shape[1],)):
        raise VfoaError(f"{where}: {name}: found shape {matrix.shape}; expected {shape}")
    return matrix.reshape(shape)


def says_fisheye(document: Document) -> bool | None:
    """Whether a value such as ``fisheye: true`` or ``camera_model: fisheye`` says so, which people add.

    None: nothing names the lens. ``fisheye_model: 1`` is of OpenCV's own program.
    """
    said = {_says_fisheye(bare_name(name), str(value).lower()) for name, value in document.items()}
    return None if said <= {None} else True in said


def _says_fisheye(name: str, value: str) -> bool | None:
    if "fisheye" in name and value in _TRUTHS:
        return _TRUTHS[value]
    if not name.endswith(("model", "type")):
        return None
    return next((is_fisheye for kind, is_fisheye in _KINDS_OF_LENSES.items() if kind in value), None)


def _is_trivial(matrix: Float) -> bool:
    return not matrix.any() or (matrix.size == 9 and np.array_equal(matrix.reshape(3, 3), np.eye(3)))
