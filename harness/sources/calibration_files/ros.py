"""ROS's camera_info YAML (camera_calibration_parsers): one file per camera, with R and P of the rectified pair."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.sources.calibration_files.documents import numbers
from harness.sources.rectification import MODELS, RawCamera
from vfoa.errors import VfoaError

_MATRICES = {"camera_matrix": (3, 3), "rectification_matrix": (3, 3), "projection_matrix": (3, 4)}


def is_camera_info(document: Mapping[str, Any]) -> bool:
    """Whether a document is one camera of ROS."""
    return "camera_matrix" in document and "projection_matrix" in document


def camera(document: Mapping[str, Any], where: str) -> RawCamera:
    """Return one camera. P of a pair's right one holds -fx B; without it the two have no baseline.

    Raises
    ------
    VfoaError
        If a name is missing, a matrix has another number of entries, or the distortion model is unknown.
    """
    for name in (*_MATRICES, "distortion_coefficients", "image_width", "image_height"):
        if name not in document:
            raise VfoaError(f"{where}: no {name}; expected ROS's camera_info")
    model = str(document.get("distortion_model", ""))
    if model not in MODELS:
        raise VfoaError(f"{where}: distortion model {model!r}; expected one of {', '.join(filter(None, MODELS))}")
    k, r, p = (
        numbers(document[name], f"{where}: {name}", shape[0] * shape[1]).reshape(shape)
        for name, shape in _MATRICES.items()
    )
    width, height = (int(numbers(document[f"image_{name}"], f"{where}: {name}", 1)[0]) for name in ("width", "height"))
    d = numbers(document["distortion_coefficients"], f"{where}: distortion_coefficients")
    return RawCamera(size_px=(width, height), k=k, d=d, r=r, p=p, model=MODELS[model])
