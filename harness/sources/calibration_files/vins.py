"""The cameras in the configuration of VINS-Fusion (YAML), and the files of camodocal that it names.

cam0_calib: "cam0_pinhole.yaml"           a file beside it; cam1_calib, body_T_cam1 the same
body_T_cam0: 4 x 4                        takes points of the camera to the body (the IMU), metres

model_type: PINHOLE                       of each camera; image_width, image_height
distortion_parameters: k1, k2, p1, p2     of PINHOLE_FULL also k3, k4, k5, k6: OpenCV's rational model
projection_parameters: fx, fy, cx, cy     of KANNALA_BRANDT, a fisheye lens: mu, mv, u0, v0, k2, k3, k4, k5
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from harness.sources.calibration_files.documents import (
    Document,
    expect_names,
    named_numbers,
    numbers,
    pose_of,
    read_document,
)
from harness.sources.calibration_files.texts import IncompleteCalibrationError
from harness.sources.rectification import Model, RawCalibration, RawCamera, rectify_pose
from vfoa.errors import VfoaError

PROGRAM = "VINS-Fusion"
_OF_CAMERA = "projection_parameters"
_DISTORTION = "distortion_parameters"
_MODELS: Mapping[str, tuple[Model, tuple[str, ...], str, tuple[str, ...]]] = {
    "PINHOLE": ("plumb_bob", ("fx", "fy", "cx", "cy"), _DISTORTION, ("k1", "k2", "p1", "p2")),
    "PINHOLE_FULL": (
        *("plumb_bob", ("fx", "fy", "cx", "cy"), _DISTORTION),
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    ),
    "KANNALA_BRANDT": ("equidistant", ("mu", "mv", "u0", "v0"), _OF_CAMERA, ("k2", "k3", "k4", "k5")),
}
_LENS_FILE = "a camera of camodocal"
_GUESSED_POSE, _UNKNOWN_POSE = "1", "2"
"""``estimate_extrinsic`` of a configuration whose poses are a first guess, and of one whose poses mean nothing."""


def is_vins(document: Document) -> bool:
    """Whether a document is such a configuration, or a camera of camodocal."""
    return "body_T_cam0" in document or "cam0_calib" in document or document.keys() >= {"model_type", _OF_CAMERA}


def vins_pair(
    document: Document, cameras: tuple[int, int], paths: Sequence[Path], *, has_baseline: bool
) -> RawCalibration:
    """Return two cameras, left and right, by their numbers; ``has_baseline``: the user gives their distance.

    Raises
    ------
    VfoaError
        If a value or a file is missing or wrong, or the model of a camera is not one that OpenCV has
        (:class:`IncompleteCalibrationError` for cameras without a configuration).
    """
    path, where = paths[0], " and ".join(map(str, paths))
    if len(paths) > 1 or _OF_CAMERA in document:
        raise IncompleteCalibrationError(
            f"{where}: cameras of camodocal do not hold their poses; expected the configuration of {PROGRAM} alone, "
            "which names these files and has body_T_cam0 and body_T_cam1"
        )
    names = tuple(name for number in cameras for name in (f"cam{number}_calib", f"body_T_cam{number}"))
    expect_names(document, names, where, f"the configuration of {PROGRAM} for two cameras")
    estimated = str(document.get("estimate_extrinsic"))
    if estimated == _GUESSED_POSE and not has_baseline:
        raise VfoaError(
            f"{where}: estimate_extrinsic: found {_GUESSED_POSE}: body_T_cam0 and body_T_cam1 are a first guess, which "
            f"{PROGRAM} refines; expected --baseline METRES, the distance of the cameras, or 0 if the poses are right"
        )
    if estimated == _UNKNOWN_POSE:
        raise VfoaError(
            f"{where}: estimate_extrinsic: found {_UNKNOWN_POSE}: {PROGRAM} ignores body_T_cam0 and body_T_cam1; "
            "expected 0, and the poses of both cameras there"
        )
    left, right = (_camera(path, number, str(document[f"cam{number}_calib"])) for number in cameras)
    body_from_left, body_from_right = (
        pose_of(document[f"body_T_cam{number}"], f"{where}: body_T_cam{number}") for number in cameras
    )
    right_from_left = np.linalg.inv(body_from_right) @ body_from_left
    return rectify_pose(left, right, right_from_left[:3, :3], right_from_left[:3, 3], where)


def _camera(configuration: Path, number: int, name: str) -> RawCamera:
    """The camera in a file beside the configuration."""
    path = configuration.parent / name
    if "\0" in name or not path.is_file():
        raise VfoaError(f"{configuration}: cam{number}_calib: no file {path}; expected the camera's file beside it")
    document = read_document(path)
    expect_names(document, ("model_type", _OF_CAMERA, "image_width", "image_height"), str(path), _LENS_FILE)
    kind = str(document["model_type"])
    if kind not in _MODELS:
        raise VfoaError(
            f"{path}: model_type: found {kind!r}, a lens that OpenCV does not rectify; expected one of: "
            f"{', '.join(_MODELS)}: calibrate the cameras again as one of these"
        )
    model, of_matrix, table, of_lens = _MODELS[kind]
    fx, fy, cx, cy = named_numbers(document[_OF_CAMERA], of_matrix, f"{path}: {_OF_CAMERA}", _LENS_FILE)
    width, height = (
        int(numbers(document[f"image_{side}"], f"{path}: image_{side}", 1)[0]) for side in ("width", "height")
    )
    return RawCamera(
        size_px=(width, height),
        k=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        d=np.array(named_numbers(document.get(table), of_lens, f"{path}: {table}", _LENS_FILE)),
        model=model,
    )
