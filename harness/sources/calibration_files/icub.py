"""Calibrations of an iCub's eyes: ``icubEyes.ini``, and ``outputCalib.ini`` of YARP's stereoCalib.

A name and its value in a line; lengths in metres::

    [CAMERA_CALIBRATION_LEFT]                   and [CAMERA_CALIBRATION_RIGHT]
    w 320
    h 240
    fx 215.622                                  fy, cx, cy, k1, k2, p1, p2
    [STEREO_DISPARITY]
    HN (0.996239 -0.016423 -0.0850726 -0.0667909 0.0189257 ... 0 0 0 1)

HN is by rows, x_right = HN x_left, while the eyes are as they were when the board was seen: an iCub turns each of them.
"""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import numpy as np

from harness.sources.calibration_files.texts import IncompleteCalibrationError, floats
from harness.sources.rectification import RawCalibration, RawCamera, rectify_pose
from vfoa.errors import VfoaError
from vfoa.types import Float

PROGRAM = "the iCub"

_SECTION = re.compile(r"\[(\w+)\]")
_PAIR = re.compile(r"(\w+)\s+\(?([^()]*)\)?")
_CAMERA = "CAMERA_CALIBRATION_"


def is_icub(text: str) -> bool:
    """Whether a text has a section of a camera."""
    return f"[{_CAMERA}" in text


def read_icub(path: Path, text: str) -> RawCalibration:
    """Return the pair.

    Raises
    ------
    VfoaError
        If a section or a number is missing, or the cameras are no pair (:class:`IncompleteCalibrationError` without a
        pose).
    """
    sections = defaultdict[str, dict[str, str]](dict)
    section = ""
    for line in (raw_line.partition("//")[0].strip() for raw_line in text.splitlines()):
        if match := _SECTION.fullmatch(line):
            section = match[1]
        elif match := _PAIR.fullmatch(line):
            sections[section][match[1]] = match[2]
    if "HN" not in sections["STEREO_DISPARITY"]:
        raise IncompleteCalibrationError(
            f"{path}: [STEREO_DISPARITY] has no HN; expected the pose of both cameras, which stereoCalib writes"
        )

    def numbers(section: str, *names: str, count: int = 1) -> Float:
        found = [floats(sections[section].get(name, "")) or [] for name in names]
        for name, values in zip(names, found, strict=True):
            if len(values) != count or not np.isfinite(values).all():
                expected = "a number" if count == 1 else f"{count} numbers"
                found_text = sections[section].get(name)
                raise VfoaError(f"{path}: [{section}] {name}: found {found_text!r}; expected {expected}")
        return np.array(found).ravel()

    def camera(side: str) -> RawCamera:
        width, height, fx, fy, cx, cy = numbers(f"{_CAMERA}{side}", "w", "h", "fx", "fy", "cx", "cy")
        k: Float = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        d = numbers(f"{_CAMERA}{side}", "k1", "k2", "p1", "p2")
        return RawCamera(size_px=(int(width), int(height)), k=k, d=d)

    pose = numbers("STEREO_DISPARITY", "HN", count=16).reshape(4, 4)
    return rectify_pose(camera("LEFT"), camera("RIGHT"), pose[:3, :3], pose[:3, 3], str(path))
