"""Files of camodocal (also VINS-Fusion's cameras), which are refused with what can be done instead."""

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
    """Raise the error that says which camera model this is and which formats are read."""
    model = document.get("model_type", "the pose of a pair")
    raise IncompleteCalibrationError(
        f"{where}: a calibration of camodocal ({model}), which is not read; expected OpenCV's, ROS's or Kalibr's "
        "(kalibr_calibrate_cameras or vfoa calibrate on the same pictures make one), or rectified images with "
        "--fx --cx --cy --baseline"
    )
