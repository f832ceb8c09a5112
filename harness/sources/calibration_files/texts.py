"""Calibrations in other texts: of KITTI, Middlebury and the ZED, and a bare camera matrix."""

from __future__ import annotations

import configparser
import math
import re
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from harness.files.io import read_bytes
from harness.sources.calibration import Calibration, check_skew, from_projections
from harness.sources.rectification import ImageSize, RawCalibration, RawCamera, rectify_pose
from vfoa.errors import VfoaError
from vfoa.types import Float


class IncompleteCalibrationError(VfoaError):
    """The file is of a known kind and lacks a value; the message says which, and how to give it.

    A search for calibrations reports these files, and ignores files of other kinds.
    """


def floats(text: str) -> list[float] | None:
    """The numbers of a text, with or without brackets, commas and semicolons; None if it holds anything else."""
    try:
        return [float(word) for word in re.sub(r"[\[\],;]", " ", text).split()]
    except ValueError:
        return None


def _values(text: str, count: int, where: str, expected: str) -> Float:
    """The finite numbers (count,) of a text; a single one is positive."""
    numbers = np.array(floats(text) or [])
    if numbers.size != count or not np.isfinite(numbers).all() or (count == 1 and numbers[0] <= 0):
        raise VfoaError(f"{where}: found {text[:60]!r}; expected {expected}")
    return numbers


# KITTI: "P2: 12 numbers" (object and odometry sets) or "P_rect_02:" (raw recordings)


def read_kitti(path: Path, text: str, cameras: tuple[int, int]) -> Calibration:
    """Return the rectified pair of two cameras in a file's text: (2, 3) is the colour pair, (0, 1) the gray one.

    Raises
    ------
    VfoaError
        If a line is missing or has a wrong form, or the two cameras are not a rectified pair.
    """
    parts = [(number, *line.partition(":")) for number, line in enumerate(text.splitlines(), start=1)]
    lines = {key.strip(): (number, rest) for number, key, colon, rest in parts if colon}

    def values(key: str, count: int) -> Float:
        number, rest = lines[key]
        return _values(rest.strip(), count, f"{path}:{number}", f"{count} numbers")

    matrices = []
    for camera in cameras:
        key = next((key for key in (f"P{camera}", f"P_rect_{camera:02d}") if key in lines), None)
        if key is None:
            raise VfoaError(
                f"{path}: no line P{camera}: or P_rect_{camera:02d}:; expected the calibration of KITTI (those lines), "
                "Middlebury (cam0=[...]), a camera matrix of 3 x 3 numbers, or fx: 700 and the others in lines"
            )
        matrices.append(values(key, 12).reshape(3, 4))
    size_key = f"S_rect_{cameras[0]:02d}"
    size = values(size_key, 2).tolist() if size_key in lines else None
    size_px = None if size is None else (int(size[0]), int(size[1]))
    left, right = matrices
    return from_projections(left, right, f"{path}: P{cameras[0]} and P{cameras[1]}", size_px=size_px)


# Middlebury 2014 and 2021, and ETH3D's two-view set

_LINE = re.compile(r"^[ \t]*(\w+)[ \t]*=[ \t]*(.*?)[ \t]*$", re.MULTILINE)


def is_middlebury(text: str) -> bool:
    """Whether a text holds a camera in Middlebury's format."""
    return any(match[1] == "cam0" for match in _LINE.finditer(text))


def read_middlebury(path: Path, text: str) -> Calibration:
    """Return the rectified pair; the principal points' columns may differ (``doffs``), the baseline is in mm.

    Lines such as ``cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]``, ``cam1=...``, ``baseline=193.001``,
    ``width=2964``, ``height=1988``.

    Raises
    ------
    VfoaError
        If a key is missing, a value is not a number or matrix, or the two cameras are not a rectified pair.
    """
    texts = {match[1]: match[2] for match in _LINE.finditer(text)}

    def values(name: str, count: int, expected: str) -> Float:
        if name not in texts:
            raise VfoaError(
                f"{path}: no {name}; expected Middlebury's calib.txt: cam0, cam1, baseline (mm), width, height"
            )
        return _values(texts[name], count, f"{path}: {name}", expected)

    k_left, k_right = (values(name, 9, "a matrix of 3 x 3 numbers").reshape(3, 3) for name in ("cam0", "cam1"))
    baseline_mm, width, height = (
        float(values(name, 1, "a positive number")[0]) for name in ("baseline", "width", "height")
    )
    left, right = (np.hstack([k, np.zeros((3, 1))]) for k in (k_left, k_right))
    right[0, 3] = -right[0, 0] * (baseline_mm / 1000)
    return from_projections(left, right, f"{path}: cam0 and cam1", size_px=(round(width), round(height)))


# A camera by the names of its numbers: "fx: 700", "baseline_mm = 120"

_NAMED = re.compile(r"[ \t]*([A-Za-z]\w*)[ \t]*[:= \t][ \t]*([-+.\deE]+)[ \t]*[,;]?[ \t]*")


def named_numbers(text: str) -> dict[str, float]:
    """The numbers of a text by their names in small letters; none if it has other lines, or no focal lengths."""
    named = dict[str, float]()
    for line in _bare_lines(text):
        match = _NAMED.fullmatch(line)
        value = floats(match[2]) if match else None
        if match is None or not value:
            return {}
        named[match[1].lower()] = value[0]
    return named if named.keys() >= {"fx", "fy"} else {}


# A bare camera matrix (K.txt): nine numbers, or fx fy cx cy, and the baseline in metres on a line of its own

_COMMENT = re.compile(r"#.*|^\W*fx\W+fy\W+cx\W+cy\W*$", re.IGNORECASE)
"""What is no value: also the names of four numbers above them."""
_MOST_OFF_MIDDLE, _LEAST_FOCAL, _MOST_UNEVEN = 0.25, 0.25, 0.05
"""Of four numbers that are a camera's: the principal point's share off the middle, the focal length in widths, and the
share by which the two focal lengths differ: another order has other ones."""
_BASELINE = re.compile(r"baseline(?:_m)?\s*[:=]?\s*", re.IGNORECASE)


def is_matrix(text: str, size: ImageSize) -> bool:
    """Whether a text begins with a line of three or nine numbers, or with fx, fy, cx and cy of images of this size."""
    first = _first_numbers(text)
    return len(first) in (3, 9) or _are_of_a_camera(first, size)


def bare_numbers(text: str, size: ImageSize) -> list[float]:
    """The numbers of a bare text, NaN for what is none; fx, fy, cx and cy of a first line as nine by rows.

    So is a matrix of 4 x 4 numbers whose last row and column are 0, 0, 0, 1, as ScanNet has it.
    """
    values = [value for line in _bare_lines(text) for value in floats(_BASELINE.sub("", line)) or [math.nan]]
    if _are_of_a_camera(_first_numbers(text), size):
        fx, fy, cx, cy = values[:4]
        return [fx, 0, cx, 0, fy, cy, 0, 0, 1, *values[4:]]
    if len(values) == 16 and values[3::4] == values[12:] == [0, 0, 0, 1]:
        return [*values[:3], *values[4:7], *values[8:11]]
    return values


def _first_numbers(text: str) -> list[float]:
    return floats(next(iter(_bare_lines(text)), "")) or []


def _are_of_a_camera(numbers: list[float], size: ImageSize) -> bool:
    """Whether numbers are probably fx, fy, cx and cy, in this order."""
    if len(numbers) != 4:
        return False
    fx, fy, cx, cy = numbers
    width, height = size()
    is_middle = max(abs(cx / width - 0.5), abs(cy / height - 0.5)) < _MOST_OFF_MIDDLE
    return is_middle and fx > _LEAST_FOCAL * width and abs(fx - fy) < _MOST_UNEVEN * fx


def read_matrix(path: Path, text: str, size: ImageSize, baseline_m: float | None) -> Calibration:
    """Return the rectified pair of two cameras that share this matrix.

    The matrix is on one line (``700 0 639.5 0 700 359.5 0 0 1``, or ``700 700 639.5 359.5``) or on three, the baseline
    alone (``0.12``) or with a name (``baseline: 0.12``). ``baseline_m`` is used for a file that does not hold one.

    Raises
    ------
    VfoaError
        If there are not nine numbers, and at most one after them, they are no camera matrix, or no baseline is known
        (:class:`IncompleteCalibrationError`).
    """
    values = bare_numbers(text, size)
    if len(values) not in (9, 10) or not np.isfinite(values).all():
        raise VfoaError(f"{path}: found {len(values)} values; expected a camera matrix of 3 x 3 numbers and a baseline")
    k = camera_matrix(values[:9], path)
    baseline = values[9] if len(values) == 10 else baseline_m
    if baseline is None:
        raise IncompleteCalibrationError(
            f"{path}: a camera matrix without a baseline; expected, of rectified images, a line with the distance of "
            "the two cameras in metres, or --baseline METRES (baseline_m in [source]); of others, K1 D1 K2 D2 R T in "
            "one file .npz (datasets/README.md says how)"
        )
    if not baseline > 0:
        raise VfoaError(f"{path}: the baseline is {baseline:g}; expected a positive number of metres")
    return Calibration.of_equal_cameras(k, float(baseline))


def camera_matrix(values: ArrayLike, path: Path) -> Float:
    """Return K (3, 3) of nine numbers by rows; VfoaError if they are no camera's."""
    k = np.asarray(values, dtype=np.float64).reshape(3, 3)
    is_one = np.array_equal(k, np.eye(3))  # the rotation of two cameras
    if is_one or not (
        np.isfinite(k).all() and k[0, 0] > 0 and k[1, 1] > 0 and np.array_equal(k[2], [0, 0, 1]) and k[1, 0] == 0
    ):
        raise VfoaError(f"{path}: found {k.tolist()}; expected a camera matrix [fx 0 cx; 0 fy cy; 0 0 1]")
    check_skew(k, str(path))
    return k


def _bare_lines(text: str) -> list[str]:
    return [line for raw_line in text.splitlines() if (line := _COMMENT.sub("", raw_line).strip())]


# The ZED's own calibration (SN12345678.conf): intrinsics for each resolution, lengths in millimetres

_ZED_SIZES = {
    (3840, 2160): "4K",
    (3200, 1800): "QHDPLUS",
    (2208, 1242): "2K",
    (1920, 1200): "FHD1200",
    (1920, 1080): "FHD",
    (1280, 720): "HD",
    (960, 600): "SVGA",
    (672, 376): "VGA",
}


def read_zed(path: Path, size: ImageSize) -> RawCalibration:
    """Return the pair for the images' resolution.

    ``[STEREO]`` holds the pose x_right = R x_left + T: T = (-Baseline, TY, TZ), R the rotation vector (RX, CV, RZ), as
    Stereolabs' calibration program (zedx-one-capture) writes the result of OpenCV's stereoCalibrate.

    Raises
    ------
    VfoaError
        If it is not such a file, or has no section for this resolution.
    """
    sections, size_px = _sections(path), size()
    if size_px not in _ZED_SIZES:
        known = ", ".join(f"{width} x {height}" for width, height in _ZED_SIZES)
        raise VfoaError(
            f"{path}: the images have {size_px[0]} x {size_px[1]} pixels; expected one of the ZED's: {known}"
        )
    name = _ZED_SIZES[size_px]

    def number(section: str, *keys: str, default: float | None = None) -> float:
        """The number of the first key that a section has."""
        values = sections.get(section, {})
        text = next((values[key] for key in keys if key in values), default)
        try:
            return float(text)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            raise VfoaError(f"{path}: [{section}] {keys[-1]}: found {text!r}; expected a number") from None

    def camera(side: str) -> RawCamera:
        own = f"{side}_CAM_{name}"
        fx, fy, cx, cy = (number(own, key) for key in ("FX", "FY", "CX", "CY"))
        k: Float = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        place = f"{side}_DISTO" if f"{side}_DISTO" in sections else own  # the ZED X writes one for all resolutions
        has = sections.get(place, {}).keys()
        if "K4" in has and not has & {"P1", "P2"}:  # four radial coefficients and no tangential ones: fisheye
            d = [number(place, f"K{n}") for n in range(1, 5)]
            return RawCamera(size_px=size_px, k=k, d=np.array(d), model="equidistant")
        d = [number(place, "K1"), number(place, "K2")]
        d += [number(place, key, default=0.0) for key in ("P1", "P2", "K3")]  # the first ZED had K1 and K2
        d += [number(place, f"K{n}") for n in (4, 5, 6) if "K4" in has]
        return RawCamera(size_px=size_px, k=k, d=np.array(d))

    rotation, _ = cv2.Rodrigues(np.array([number("STEREO", f"{key}_{name}") for key in ("RX", "CV", "RZ")]))
    ty, tz = (number("STEREO", f"{key}_{name}", key, default=0.0) for key in ("TY", "TZ"))
    translation = np.array([-number("STEREO", "BASELINE"), ty, tz]) / 1000
    return rectify_pose(camera("LEFT"), camera("RIGHT"), np.asarray(rotation, dtype=np.float64), translation, str(path))


def _sections(path: Path) -> dict[str, dict[str, str]]:
    parser = configparser.ConfigParser(inline_comment_prefixes=(";", "#"), interpolation=None, strict=False)
    try:
        parser.read_string(read_bytes(path).decode("utf-8-sig"))
    except (UnicodeDecodeError, configparser.Error):
        raise VfoaError(f"{path}: cannot be parsed; expected the ZED's calibration with [LEFT_CAM_HD] ...") from None
    return {name.upper(): {key.upper(): value for key, value in parser[name].items()} for name in parser.sections()}
