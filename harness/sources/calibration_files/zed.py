"""The ZED's own calibration (``SN12345678.conf``): intrinsics for each resolution, lengths in millimetres."""

from __future__ import annotations

import configparser
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from harness.files.io import read_bytes
from harness.sources.calibration_files.options import ImageSize
from harness.sources.calibration_files.pose import Lens, rectify_pose
from harness.sources.rectification import Model, RawCalibration
from vfoa.errors import VfoaError
from vfoa.types import Float

RESOLUTIONS = {
    (3840, 2160): "4K",
    (3200, 1800): "QHDPLUS",
    (2208, 1242): "2K",
    (1920, 1200): "FHD1200",
    (1920, 1080): "FHD",
    (1280, 720): "HD",
    (960, 600): "SVGA",
    (672, 376): "VGA",
}

Section = Mapping[str, str]


def read(path: Path, size: ImageSize) -> RawCalibration:
    """Return the pair for the images' resolution.

    ``[STEREO]`` holds the pose x_right = R x_left + T: T = (-Baseline, TY, TZ), R the rotation vector (RX, CV, RZ), as
    Stereolabs' calibration program (zedx-one-capture) writes the result of OpenCV's stereoCalibrate.

    Raises
    ------
    VfoaError
        If the file is no such file, or has nothing for this resolution.
    """
    sections, size_px = _sections(path), size()
    if size_px not in RESOLUTIONS:
        known = ", ".join(f"{width} x {height}" for width, height in RESOLUTIONS)
        raise VfoaError(
            f"{path}: the images have {size_px[0]} x {size_px[1]} pixels; expected one of the ZED's: {known}"
        )
    name = RESOLUTIONS[size_px]
    left, right = (_lens(sections, side, name, path) for side in ("LEFT", "RIGHT"))
    stereo = _section(sections, "STEREO", path)
    rotation, _ = cv2.Rodrigues(np.array([_number(stereo, f"{key}_{name}", path) for key in ("RX", "CV", "RZ")]))
    ty, tz = (_number(stereo, f"{key}_{name}" if f"{key}_{name}" in stereo else key, path, 0.0) for key in ("TY", "TZ"))
    translation = np.array([-_number(stereo, "BASELINE", path), ty, tz]) / 1000
    return rectify_pose(left, right, np.asarray(rotation, dtype=np.float64), translation, size_px, str(path))


def _sections(path: Path) -> dict[str, Section]:
    parser = configparser.ConfigParser(inline_comment_prefixes=(";", "#"), interpolation=None, strict=False)
    try:
        parser.read_string(read_bytes(path).decode("utf-8-sig"))
    except (UnicodeDecodeError, configparser.Error):
        raise VfoaError(f"{path}: cannot be parsed; expected the ZED's calibration with [LEFT_CAM_HD] ...") from None
    return {name.upper(): {key.upper(): value for key, value in parser[name].items()} for name in parser.sections()}


def _section(sections: Mapping[str, Section], name: str, path: Path) -> Section:
    if name not in sections:
        raise VfoaError(f"{path}: no section [{name}]; found {', '.join(sections) or 'none'}")
    return sections[name]


def _lens(sections: Mapping[str, Section], side: str, name: str, path: Path) -> Lens:
    camera = _section(sections, f"{side}_CAM_{name}", path)
    fx, fy, cx, cy = (_number(camera, key, path) for key in ("FX", "FY", "CX", "CY"))
    k: Float = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    distortion = sections.get(f"{side}_DISTO", camera)  # the ZED X writes one for all resolutions
    model, keys = _model(distortion)
    optional = {} if model == "equidistant" else {"P1": 0.0, "P2": 0.0, "K3": 0.0}  # the first ZED had K1 and K2
    return Lens(k=k, d=np.array([_number(distortion, key, path, optional.get(key)) for key in keys]), model=model)


def _model(distortion: Section) -> tuple[Model, list[str]]:
    """The lens model and its coefficients: fisheye if there are four radial coefficients and no tangential ones."""
    if "K4" in distortion and "P1" not in distortion and "P2" not in distortion:
        return "equidistant", ["K1", "K2", "K3", "K4"]
    return "plumb_bob", ["K1", "K2", "P1", "P2", "K3"] + (["K4", "K5", "K6"] if "K4" in distortion else [])


def _number(section: Section, key: str, path: Path, default: float | None = None) -> float:
    if key not in section:
        if default is not None:
            return default
        raise VfoaError(f"{path}: no {key}; expected the ZED's calibration")
    try:
        return float(section[key])
    except ValueError:
        raise VfoaError(f"{path}: {key}: found {section[key]!r}; expected a number") from None
