"""The text in which ROS's camera_calibration prints and saves a stereo calibration (``ost.txt``).

Files ``.ini`` hold one camera in the same form.

Titles with numbers below them, for both cameras one after the other; lengths in metres::

    # oST version 5.0 parameters
    [image]
    width
    1280
    height
    1024
    [narrow_stereo/left]                        then [narrow_stereo/right]
    camera matrix
    1136.683548 0.000000 642.744901             and the other two rows
    distortion                                  rectification (3 x 3), projection (3 x 4)
    -0.215824 0.152577 -0.001868 0.002018 0.000000
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from harness.sources.calibration_files.documents import camera_of_ros, numbers
from harness.sources.calibration_files.texts import IncompleteCalibrationError, floats
from harness.sources.rectification import RawCalibration, RawCamera, pair_of_infos
from vfoa.errors import VfoaError

FILE_NAME = "ost.txt"
"""The name beside ``left.yaml`` and ``right.yaml``, which say the same."""

_TITLES = {"K": "camera matrix", "D": "distortion", "R": "rectification", "P": "projection"}
_SIZES = ("width", "height")
_SECTION = re.compile(r"\[([\w./-]+)\]")
_IMAGE = "[image]"
_SIDES = ("left", "right")
_EXPECTED = "expected both cameras, [NAME/left] and [NAME/right], in one file or two, or the YAML files of both"


def is_ros_text(text: str) -> bool:
    """Whether a text holds such a camera."""
    lines = {line.strip() for line in text.splitlines()}
    return lines >= {_IMAGE, _TITLES["K"]}


def read_ros_text(where: str, text: str, baseline_m: float | None) -> RawCalibration:
    """Return the pair of a file's text, or of the texts of two, with this baseline if it is not None.

    Raises
    ------
    VfoaError
        If a value is missing or wrong, the lenses are fisheye lenses, which the file does not say, or there are not two
        cameras (:class:`IncompleteCalibrationError`).
    """
    cameras = _cameras(text)
    by_side = {name.rpartition("/")[2].lower(): (name, values) for name, values in cameras}
    if len(cameras) != 2 or by_side.keys() != set(_SIDES):
        there = ", ".join(f"[{name}]" for name, _ in cameras) or "no camera"
        raise IncompleteCalibrationError(f"{where}: found {there}; {_EXPECTED}")
    left, right = (_camera(by_side[side][1], f"{where}: [{by_side[side][0]}]") for side in _SIDES)
    return pair_of_infos(left, right, where, baseline_m)


def read_ros_camera(path: Path, text: str) -> RawCamera:
    """Return the only camera of a file; raises as :func:`read_ros_text`."""
    cameras = _cameras(text)
    if len(cameras) != 1:
        there = ", ".join(f"[{name}]" for name, _ in cameras) or "no camera"
        raise VfoaError(f"{path}: found {there}; expected one camera")
    ((name, values),) = cameras
    return _camera(values, f"{path}: [{name}]")


def _cameras(text: str) -> list[tuple[str, dict[str, list[float]]]]:
    """The name of each camera, and the numbers below each title; what is before the first ``[image]`` is no part."""
    cameras: list[tuple[str, dict[str, list[float]]]] = []
    values, title = dict[str, list[float]](), ""
    for line in (raw_line.partition("#")[0].strip() for raw_line in text.splitlines()):
        if line == _IMAGE:
            values, title = {}, ""
        elif match := _SECTION.fullmatch(line):
            cameras.append((match[1], values))
        elif line in (*_SIZES, *_TITLES.values()):
            title = line
            values[title] = []
        elif (row := floats(line)) is None:
            title = ""
        elif title:
            values[title] += row
    return cameras


def _camera(values: Mapping[str, list[float]], where: str) -> RawCamera:
    for title in (*_SIZES, *_TITLES.values()):
        if not values.get(title):
            raise VfoaError(f"{where}: no {title}; expected it with numbers below, as ROS's camera_calibration writes")
    width, height = (int(numbers(values[side], f"{where}: {side}", 1)[0]) for side in _SIZES)
    if len(values[_TITLES["D"]]) == 4:
        raise VfoaError(
            f"{where}: distortion: found 4 coefficients, as of a fisheye lens, and this file does not name the model; "
            "expected the YAML files of both cameras (left.yaml, right.yaml), which do"
        )
    by_role = {role: np.array(values[title]) for role, title in _TITLES.items()}
    return camera_of_ros("plumb_bob", (width, height), by_role, where)
