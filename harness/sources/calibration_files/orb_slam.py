"""The cameras in the settings of ORB-SLAM2, ORB-SLAM3 and stella_vslam (YAML).

Camera.type: "PinHole"            KannalaBrandt8; Rectified: Camera1 alone, and Stereo.b in metres
Camera1.fx: 458.654               Camera2 is the right one; k1, k2, p1, p2 (k3), of KannalaBrandt8 k1 to k4
Stereo.T_c1_c2: 4 x 4             takes points of Camera2 to Camera1, metres

Camera.fx: 435.2                  ORB-SLAM2: of the rectified pair, Camera.bf is fx times the baseline in metres
LEFT.K  LEFT.D  LEFT.R  LEFT.P    how images are rectified, if they are not yet; RIGHT the same

Camera: {fx: 435.2 ...}           stella_vslam (OpenVSLAM: Camera.fx): the same with focal_x_baseline, cols and rows
StereoRectifier: {K_left ...}     K, D, R of both, of lenses without a model or of the model fisheye; P is Camera's
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.sources.calibration import Calibration, from_projections
from harness.sources.calibration_files.documents import Document, expect_names, numbers, pose_of
from harness.sources.rectification import Cameras, ImageSize, Model, RawCalibration, RawCamera, rectify_pose
from vfoa.errors import VfoaError, check_known
from vfoa.types import Float

PROGRAM = "ORB-SLAM"
_MODELS: dict[str, tuple[Model, tuple[str, ...]]] = {
    "PinHole": ("plumb_bob", ("k1", "k2", "p1", "p2", "k3")),
    "KannalaBrandt8": ("equidistant", ("k1", "k2", "k3", "k4")),
}
_RECTIFIED = "Rectified"


def is_orb_slam(document: Document) -> bool:
    """Whether a document has such settings."""
    return "Camera1.fx" in document or "Camera.fx" in document


_OF_STELLA = {"focal_x_baseline": "bf", "cols": "width", "rows": "height"}
"""ORB-SLAM's names of what stella_vslam calls otherwise."""


def as_orb_slam(document: Document, where: str) -> Document:
    """The settings of stella_vslam by the names of ORB-SLAM2's; other documents as they are.

    Raises
    ------
    VfoaError
        If they are not of a stereo pair, or a value is missing.
    """
    camera, rectifier = (_table(document, name) for name in ("Camera", "StereoRectifier"))
    if "focal_x_baseline" not in camera:
        return document
    if (setup := camera.get("setup", "stereo")) != "stereo":
        raise VfoaError(f"{where}: Camera.setup: found {setup!r}; expected the settings of stella_vslam for stereo")
    settings = {f"Camera.{_OF_STELLA.get(name, name)}": value for name, value in camera.items() if value is not None}
    if not rectifier:
        return settings
    expect_names(settings, ("Camera.width", "Camera.height"), where, "cols and rows of stella_vslam's Camera")
    expect_names(rectifier, tuple(f"{role}_{side}" for side in _SIDES for role in "KDR"), where, "StereoRectifier")
    (times_fx,) = numbers(camera["focal_x_baseline"], f"{where}: focal_x_baseline", 1)
    for side, shift in zip(_SIDES, (0.0, -times_fx), strict=True):
        values = {role: rectifier[f"{role}_{side}"] for role in "KDR"}
        values["P"] = np.column_stack([_matrix(settings, "Camera", where), [shift, 0, 0]])
        values |= {name: settings[f"Camera.{name}"] for name in ("width", "height")}
        settings |= {f"{side.upper()}.{name}": value for name, value in values.items()}
    return {**settings, "LENS": rectifier.get("model")}


_SIDES = ("left", "right")


def _table(document: Document, name: str) -> dict[str, Any]:
    """The values of a table, or of the names that begin with its name and a dot."""
    if isinstance(table := document.get(name), Mapping):
        return {str(inner): value for inner, value in table.items()}
    dotted = ((str(key).partition("."), value) for key, value in document.items())
    return {inner: value for (table_name, _, inner), value in dotted if table_name == name and inner}


def orb_slam_pair(document: Document, size: ImageSize, where: str, *, rectified: bool) -> Cameras:
    """Return the pair; ``rectified``: the images are rectified already, although the file says how to do it.

    Raises
    ------
    VfoaError
        If a value is missing or wrong, or the settings are of one camera.
    """
    if "Camera1.fx" in document:
        kind = str(document.get("Camera.type", ""))
        check_known(kind, [_RECTIFIED, *_MODELS], f"{where}: Camera.type: no")
        if kind == _RECTIFIED:
            expect_names(document, ("Stereo.b",), where, f"the settings of {PROGRAM}")
            return _parallel(document, "Camera1", numbers(document["Stereo.b"], f"{where}: Stereo.b", 1)[0], where)
        return _posed(document, kind, size, where)
    if "LEFT.K" in document:
        cameras = [_of_side(document, side, where) for side in ("LEFT", "RIGHT")]
        return RawCalibration(left=cameras[0], right=cameras[1], where=where)
    expect_names(document, ("Camera.bf",), where, f"the settings of {PROGRAM} for a stereo pair")
    if not rectified and any(_coefficients(document, "Camera", _MODELS["PinHole"][1], where)):
        raise VfoaError(
            f"{where}: Camera.k1 ...: lens distortion of one camera; expected LEFT.K and the others of both, or "
            "rectified = true in [source] if the images are rectified"
        )
    (times_fx,) = numbers(document["Camera.bf"], f"{where}: Camera.bf", 1)
    return _parallel(document, "Camera", times_fx / _matrix(document, "Camera", where)[0, 0], where)


def _parallel(document: Document, camera: str, baseline_m: float, where: str) -> Calibration:
    """The pair of two rectified cameras with one matrix."""
    left = np.column_stack([_matrix(document, camera, where), np.zeros(3)])
    right = left.copy()
    right[0, 3] = -left[0, 0] * baseline_m
    return from_projections(left, right, where, _size(document))


def _posed(document: Document, kind: str, size: ImageSize, where: str) -> RawCalibration:
    """The pair of two cameras by their pose."""
    expect_names(document, ("Camera2.fx", "Stereo.T_c1_c2"), where, f"two cameras ({PROGRAM}, Camera.type {kind})")
    model, coefficients = _MODELS[kind]
    size_px = _size(document) or size()
    left, right = (
        RawCamera(
            size_px=size_px,
            k=_matrix(document, camera, where),
            d=np.array(_coefficients(document, camera, coefficients, where)),
            model=model,
        )
        for camera in ("Camera1", "Camera2")
    )
    left_from_right = pose_of(document["Stereo.T_c1_c2"], f"{where}: Stereo.T_c1_c2")
    rotation = left_from_right[:3, :3].T
    return rectify_pose(left, right, rotation, -rotation @ left_from_right[:3, 3], where)


def _of_side(document: Document, side: str, where: str) -> RawCamera:
    """A camera with what rectifies its images, in pixels and metres."""
    names = tuple(f"{side}.{name}" for name in ("K", "D", "R", "P", "width", "height"))
    expect_names(document, names, where, f"the settings of {PROGRAM} with LEFT and RIGHT")
    k, r, p = (
        numbers(document[f"{side}.{name}"], f"{where}: {side}.{name}", 3 * columns).reshape(3, columns)
        for name, columns in (("K", 3), ("R", 3), ("P", 4))
    )
    width, height = (int(numbers(document[name], f"{where}: {name}", 1)[0]) for name in names[4:])
    d, is_fisheye = numbers(document[f"{side}.D"], f"{where}: {side}.D"), document.get("LENS") == "fisheye"
    return RawCamera(size_px=(width, height), k=k, d=d, r=r, p=p, model="equidistant" if is_fisheye else "plumb_bob")


def _matrix(document: Document, camera: str, where: str) -> Float:
    names = tuple(f"{camera}.{name}" for name in ("fx", "fy", "cx", "cy"))
    expect_names(document, names, where, f"the settings of {PROGRAM}")
    fx, fy, cx, cy = (numbers(document[name], f"{where}: {name}", 1)[0] for name in names)
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _coefficients(document: Document, camera: str, names: tuple[str, ...], where: str) -> list[float]:
    """Lens distortion; what is missing is 0."""
    keys = [f"{camera}.{name}" for name in names]
    return [float(numbers(document.get(key, 0), f"{where}: {key}", 1)[0]) for key in keys]


def _size(document: Document) -> tuple[int, int] | None:
    sides = [document.get(f"Camera.{side}") for side in ("width", "height")]
    width, height = (side if isinstance(side, int) and side > 0 else None for side in sides)
    return (width, height) if width and height else None
