"""Files of camodocal (also VINS-Fusion's cameras): they are refused, and the error says what to do instead."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.sources.calibration_files.incomplete import IncompleteCalibrationError

_POSE = ("q_x", "q_y", "q_z", "q_w")


def is_camodocal(document: Mapping[str, Any]) -> bool:
    """Whether a document is one camera, or the pose between two, as camodocal writes them."""
    pose = document.get("transform")
    return "model_type" in document or (isinstance(pose, Mapping) and all(name in pose for name in _POSE))


def refuse(document: Mapping[str, Any], where: str) -> None:
    """Raise an error that names this camera model and the formats that are read."""
    model = document.get("model_type", "the pose of a pair")
    raise IncompleteCalibrationError(
        f"{where}: a camodocal calibration ({model}) cannot be read; expected OpenCV's, ROS's or Kalibr's "
        "(kalibr_calibrate_cameras or vfoa calibrate on the same pictures make one), or rectified images with "
        "--fx --cx --cy --baseline"
    )
