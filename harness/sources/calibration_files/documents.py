"""Calibrations in YAML, XML, JSON and NumPy's archives: the documents, and those of ROS, EuRoC and Kalibr.

OpenCV's own reader is not used: a damaged file makes it end the whole process.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal
from xml.etree.ElementTree import Element

import numpy as np
import yaml

from harness.files.io import read_bytes
from harness.files.parsing import parse_xml, parse_yaml
from harness.sources.calibration_files.python_files import head_of, read_archive, read_json, read_mat
from harness.sources.rectification import (
    MODELS,
    Model,
    RawCalibration,
    RawCamera,
    check_motion,
    pair_of_infos,
    rectify_pose,
)
from vfoa.errors import VfoaError, counted
from vfoa.types import Float

SUFFIXES = frozenset({".yml", ".yaml", ".xml", ".json", ".npz", ".mat"})
_BY_START = {b"%YAML": ".yml", b"<?xml": ".xml", b"{": ".json"}

Document = Mapping[str, Any]

Unit = Literal["m", "cm", "mm"]
METRES: Mapping[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""The units of a translation that can be given, or be in a name."""

_OPENCV_HEAD = re.compile(rb"\A(?:[ \t]*(?:#[^\n]*)?\r?\n)*%YAML:[^\n]*")
"""OpenCV writes "%YAML:1.0", which is not a valid YAML directive."""
_ECHO_END = re.compile(rb"(?<=\n)---[ \r\n]*\Z")
"""The line with which ``rostopic echo`` ends a message."""
_NO_BLANK = re.compile(rb"^([ \t]*[A-Za-z_][\w.]*):(?=[-+.\d\[\"])", re.MULTILINE)
"""A key whose value follows without a blank, which OpenCV reads, and YAML does not."""


def document_suffix(path: Path) -> str | None:
    """One of :data:`SUFFIXES`, which tells how a file is read: its own, or by its first bytes; None for another text.

    People call what OpenCV wrote ``calib.txt``.
    """
    if (suffix := path.suffix.lower()) in SUFFIXES:
        return suffix
    head = head_of(path).removeprefix(codecs.BOM_UTF8).lstrip()
    return next((suffix for start, suffix in _BY_START.items() if head.startswith(start)), None)


def read_document(path: Path) -> dict[str, Any]:
    """Return the values of a file's top level by name; OpenCV's matrices become arrays.

    Raises
    ------
    VfoaError
        If it cannot be read or parsed, or its top level is not a table.
    """
    match document_suffix(path):
        case ".xml":
            return _read_xml(path)
        case ".npz":
            return read_archive(path)
        case ".mat":
            return read_mat(path)
        case ".json":
            document = read_json(path)
        case _:
            data = read_bytes(path).removeprefix(codecs.BOM_UTF8)
            document = parse_yaml(_as_yaml(data), path, _Loader)
    if not isinstance(document, dict):
        raise VfoaError(f"{path}: not a table of names; expected the calibration of OpenCV, ROS or Kalibr")
    return _of_echoed_message(document, path)


def _as_yaml(data: bytes) -> bytes:
    """The text of a file, as YAML has it if OpenCV or people for OpenCV wrote it; lines stay where they are."""
    head = _OPENCV_HEAD.match(data)
    if head is None:
        return data[: -len(end[0])] if (end := _ECHO_END.search(data[-8:])) else data
    return b"\n" * head[0].count(b"\n") + _NO_BLANK.sub(rb"\1: ", data[head.end() :])


def numbers(value: Any, where: str, count: int | None = None) -> Float:
    """Return the numbers (count,) in a matrix, a (nested) list or a table with ``data``, row by row.

    Raises
    ------
    VfoaError
        If their number differs, or a value is not a finite number.
    """
    given = value["data"] if isinstance(value, Mapping) and "data" in value else value
    try:
        # also converts "1e-05", which YAML 1.1 reads as text; OpenCV's XML has sequences of numbers as one text
        words = given.split() if isinstance(given, str) else given
        values = np.asarray(words, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError, OverflowError):
        raise VfoaError(f"{where}: found {given!r}; expected numbers") from None
    unknown = values[~np.isfinite(values)]
    if (count is not None and values.size != count) or unknown.size:
        found = f"{unknown[0]:g} among {counted(values.size, 'number')}" if unknown.size else f"{values.size} numbers"
        expected = "finite numbers" if count is None else counted(count, "finite number")
        raise VfoaError(f"{where}: found {found}; expected {expected}")
    return values


def pose_of(value: Any, where: str) -> Float:
    """Return a pose (4, 4); raises a :class:`VfoaError` if it is no rotation and translation."""
    return check_motion(numbers(value, where, 16).reshape(4, 4), where)


class _Loader(yaml.SafeLoader):
    """Reads YAML and OpenCV's matrices."""


_MATRICES = ("opencv-matrix", "opencv-nd-matrix")
_WRONG_SIZE = "an opencv-matrix whose data do not have rows x cols numbers"


def _matrix(loader: _Loader, node: yaml.Node) -> Float:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.constructor.ConstructorError(None, None, "an opencv-matrix that is not a table", node.start_mark)
    try:
        return _shaped(loader.construct_mapping(node, deep=True))
    except (KeyError, TypeError, ValueError):
        raise yaml.constructor.ConstructorError(None, None, _WRONG_SIZE, node.start_mark) from None


for _kind in _MATRICES:
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _matrix)


def _python_value(loader: _Loader, kind: str, node: yaml.Node) -> Any:
    """What ``yaml.dump`` writes of a tuple, an array or a number of NumPy; nothing is imported or run.

    Any other object is a text, so that it is refused only if its value is needed.
    """
    parts: Any
    try:
        match node:
            case yaml.SequenceNode():
                parts = loader.construct_sequence(node, deep=True)
            case yaml.MappingNode():
                parts = loader.construct_mapping(node, deep=True)
            case _:
                return kind
        if kind.endswith("multiarray.scalar"):
            return _numpy_values(*parts)
        if kind.endswith("multiarray._reconstruct"):
            _, shape, type_, is_by_columns, data = parts["state"]
            return _numpy_values(type_, data).reshape(shape, order="F" if is_by_columns else "C")
    except (AttributeError, KeyError, TypeError, ValueError):
        return _OF_PYTHON
    return parts if kind in ("tuple", "object/apply:numpy.dtype") else _OF_PYTHON


def _numpy_values(type_: Mapping[str, Any], data: bytes) -> Float:
    """The numbers in ``data``; ``type_`` has the name of their type, such as f8, and the order of their bytes."""
    return np.frombuffer(data, np.dtype(f"{type_['state'][1]}{type_['args'][0]}")).astype(np.float64)


_OF_PYTHON = "an object of Python"
_Loader.add_multi_constructor("tag:yaml.org,2002:python/", _python_value)


def _read_xml(path: Path) -> dict[str, Any]:
    root = parse_xml(read_bytes(path), path)
    try:
        return {child.tag: _value(child) for child in root}
    except (LookupError, TypeError, ValueError):
        raise VfoaError(f"{path}: {_WRONG_SIZE}") from None


def _value(element: Element) -> Any:
    text = (element.text or "").strip()
    if element.get("type_id") in _MATRICES:
        parts = {child.tag: (child.text or "").split() for child in element}
        return _shaped({**parts, **{name: parts[name][0] for name in ("rows", "cols") if name in parts}})
    if len(element):
        is_sequence = all(child.tag == "_" for child in element)
        return [_value(child) for child in element] if is_sequence else {child.tag: _value(child) for child in element}
    return text.strip('"')


def _shaped(matrix: Mapping[Any, Any]) -> Float:
    """The numbers of a matrix (rows, cols), or of one with any number of dimensions (sizes)."""
    shape = matrix["sizes"] if "sizes" in matrix else (matrix["rows"], matrix["cols"])
    # YAML does not know OpenCV's .Nan and .Inf
    values = [float(str(value).lower().replace(".nan", "nan").replace(".inf", "inf")) for value in matrix["data"]]
    return np.array(values).reshape([int(size) for size in shape])


# ROS's camera_info (camera_calibration_parsers): one file per camera, with R and P of the rectified pair

_ROS_NAMES = (
    *("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix"),
    *("image_width", "image_height"),
)


_MESSAGE_NAMES = dict(zip((*"KDRP", "width", "height"), _ROS_NAMES, strict=True))


def _of_echoed_message(document: dict[str, Any], path: Path) -> dict[str, Any]:
    """The CameraInfo that ``rostopic echo`` (K, D, R, P) or ``ros2 topic echo`` (k, d, r, p) prints, as a file's names.

    Other documents are returned as they are.
    """
    message = {str(name).upper() if str(name) in "kdrp" else name: value for name, value in document.items()}
    if not message.keys() >= {*_MESSAGE_NAMES, "distortion_model"}:
        return document
    return message | {name: message[short] for short, name in _MESSAGE_NAMES.items()}


def part_of_sensor(
    camera: RawCamera, binning: tuple[int, int], corner_px: tuple[int, int], size_px: tuple[int, int], where: str
) -> RawCamera:
    """Return the camera of a CameraInfo's images, of the camera of its matrices, which are those of the whole sensor.

    Parameters
    ----------
    binning
        How many pixels are merged into one, across and down; 0 is 1.
    corner_px, size_px
        The region of interest before pixels are merged; a size of 0 reaches to the end of the sensor.

    Raises
    ------
    VfoaError
        If the region is not on the sensor.
    """
    if max(binning) <= 1 and not any((*corner_px, *size_px)):
        return camera
    to_part, part_px = np.eye(3), [0, 0]
    for axis, (merged, corner, side, whole) in enumerate(zip(binning, corner_px, size_px, camera.size_px, strict=True)):
        merged, side = max(merged, 1), side or whole - corner
        if corner < 0 or side < merged or corner + side > whole:
            raise VfoaError(
                f"{where}: roi: found {side} pixels from {corner} on, binning {merged}; expected a part of the "
                f"{whole} pixels of {('width', 'height')[axis]}"
            )
        to_part[axis, axis], to_part[axis, 2] = 1 / merged, (0.5 - corner) / merged - 0.5
        part_px[axis] = side // merged
    return replace(camera, size_px=(part_px[0], part_px[1]), k=to_part @ camera.k, p=to_part @ camera.p)


def ros_camera(document: Document, where: str) -> RawCamera:
    """Return one camera. P of a pair's right one holds -fx B; without it the two have no baseline.

    Raises
    ------
    VfoaError
        If a name is missing, a matrix has another number of entries, or the distortion model is unknown.
    """
    expect_names(document, _ROS_NAMES, where, "ROS's camera_info")

    def whole(table: Document, *names: str) -> tuple[int, int]:
        first, second = (int(numbers(table.get(name, 0), f"{where}: {name}", 1)[0]) for name in names)
        return first, second

    values = {role: document[name] for role, name in zip("KDRP", _ROS_NAMES[:4], strict=True)}
    size_px = whole(document, "image_width", "image_height")
    camera = camera_of_ros(str(document.get("distortion_model", "")), size_px, values, where)
    region = roi if isinstance(roi := document.get("roi"), Mapping) else {}
    corner_px, part_px = whole(region, "x_offset", "y_offset"), whole(region, "width", "height")
    return part_of_sensor(camera, whole(document, "binning_x", "binning_y"), corner_px, part_px, where)


def ros_pair(left: Document, right: Document, where: tuple[str, str], baseline_m: float | None) -> RawCalibration:
    """Return the cameras of two files (``where``), with this baseline if it is not None.

    Raises the errors of :func:`ros_camera` and :func:`harness.sources.rectification.pair_of_infos`.
    """
    first, second = map(ros_camera, (left, right), where)
    return pair_of_infos(first, second, " and ".join(where), baseline_m)


def camera_of_ros(model: str, size_px: tuple[int, int], values: Mapping[str, Any], where: str) -> RawCamera:
    """Return a camera with ROS's or Foxglove's name of a distortion model, and its K, D, R and P; raises VfoaError.

    With coefficients of 0 every model is that of a lens without distortion: simulators write ``pinhole``.
    """
    d = numbers(values["D"], f"{where}: D")
    if model not in MODELS:
        if d.any():
            raise VfoaError(
                f"{where}: found the distortion model {model!r}; expected one of {', '.join(filter(None, MODELS))}"
            )
        model, d = "", d[:0]
    k, r, p = (
        numbers(values[name], f"{where}: {name}", 3 * columns).reshape(3, columns)
        for name, columns in (("K", 3), ("R", 3), ("P", 4))
    )
    return RawCamera(size_px=size_px, k=k, d=d, r=r, p=p, model=MODELS[model])


def expect_names(document: Document, names: tuple[str, ...], where: str, expected: str) -> None:
    """Raise a :class:`VfoaError` for the first name that a document does not have."""
    if missing := next((name for name in names if name not in document), None):
        raise VfoaError(f"{where}: no {missing}; expected {expected}")


def named_numbers(table: Any, names: tuple[str, ...], where: str, expected: str) -> list[float]:
    """The numbers of these names; a :class:`VfoaError` for the first that is missing, or no number."""
    values = table if isinstance(table, Mapping) else {}
    expect_names(values, names, where, expected)
    return [float(numbers(values[name], f"{where}: {name}", 1)[0]) for name in names]


# EuRoC's sensor.yaml, one file per camera, and Kalibr's camera chain

_KALIBR_CAMERA = re.compile(r"cam\d+")
_KALIBR_MODELS: dict[str, Model] = {
    "radtan": "plumb_bob",
    "radial-tangential": "plumb_bob",
    "equidistant": "equidistant",
    "none": "plumb_bob",
    "rational_polynomial": "plumb_bob",
}
_RATIONAL = "rational_polynomial"
"""OpenCV's model, which Kalibr does not have: programs that write its chain from another calibration do."""


def euroc_pair(left: Document, right: Document, where: tuple[str, str]) -> RawCalibration:
    """Return the two cameras of a recording; ``where`` are their files, ``T_BS`` is body_from_camera, metres.

    Raises
    ------
    VfoaError
        If a key is missing or wrong, the sizes differ, or a camera is not a pinhole with a known distortion.
    """
    pairs = tuple(zip((left, right), where, strict=True))
    first, second = (
        _pinhole(document, "distortion_coefficients", place, "EuRoC's sensor.yaml") for document, place in pairs
    )
    body_from_left, body_from_right = (pose_of(document["T_BS"], f"{place}: T_BS") for document, place in pairs)
    right_from_left = np.linalg.inv(body_from_right) @ body_from_left
    return rectify_pose(first, second, right_from_left[:3, :3], right_from_left[:3, 3], " and ".join(where))


def kalibr_chain(document: Document) -> Document | None:
    """The cameras of Kalibr in a document, or in its only table of them (D-Robotics' ``stereo0``); None without any.

    Another table of ``cam0`` and ``cam1`` may have something else of them, such as their serial numbers.
    """
    tables = (value for value in document.values() if isinstance(value, Mapping))
    inner = [table for table in tables if _is_kalibr_chain(table, "distortion_model")]
    return document if _is_kalibr_chain(document) else inner[0] if len(inner) == 1 else None


def _is_kalibr_chain(document: Document, *keys: str) -> bool:
    """Whether a table has a camera by Kalibr's name for it, with these keys."""
    cameras = (value for name, value in document.items() if _KALIBR_CAMERA.fullmatch(str(name)))
    return any(isinstance(camera, Mapping) and camera.keys() >= {*keys} for camera in cameras)


def kalibr_pair(document: Document, cameras: tuple[int, int], where: str) -> RawCalibration:
    """Return two cameras of the chain, left and right, by their numbers.

    ``T_cn_cnm1`` transforms points of the preceding camera into this camera's frame, metres. Chains for OpenVINS have
    ``T_imu_cam`` in its place, which transforms points of the camera into the IMU's frame; others its inverse,
    ``T_cam_imu``.

    Raises
    ------
    VfoaError
        If a camera or a key is missing, or a camera's model is not pinhole with radtan, equidistant or none.
    """
    chain = {name: value for name, value in document.items() if _KALIBR_CAMERA.fullmatch(str(name))}

    def camera(number: int) -> Document:
        if not isinstance(values := chain.get(f"cam{number}"), Mapping):
            raise VfoaError(f"{where}: no cam{number}; expected one of {', '.join(sorted(chain))}")
        return values

    program = "Kalibr's camera chain"
    left, right = (
        _pinhole(camera(number), "distortion_coeffs", f"{where}: cam{number}", program) for number in cameras
    )
    pose = _kalibr_pose({number: camera(number) for number in range(min(cameras), max(cameras) + 1)}, cameras, where)
    return rectify_pose(left, right, pose[:3, :3], pose[:3, 3], where)


def _kalibr_pose(chain: Mapping[int, Document], cameras: tuple[int, int], where: str) -> Float:
    """right_from_left (4, 4), by the steps from camera to camera, or by the poses of both in the frame of an IMU."""
    left, right = cameras

    def transform(number: int, name: str) -> Float:
        expect_names(chain[number], (name,), f"{where}: cam{number}", "Kalibr's camera chain")
        return pose_of(chain[number][name], f"{where}: cam{number}: {name}")

    if "T_cn_cnm1" not in chain[max(cameras)]:
        if all("T_imu_cam" in chain[number] for number in cameras):
            return np.linalg.inv(transform(right, "T_imu_cam")) @ transform(left, "T_imu_cam")
        if all("T_cam_imu" in chain[number] for number in cameras):
            return transform(right, "T_cam_imu") @ np.linalg.inv(transform(left, "T_cam_imu")).astype(float)
    last_from_first: Float = np.eye(4)
    for number in range(min(cameras) + 1, max(cameras) + 1):
        last_from_first = transform(number, "T_cn_cnm1") @ last_from_first
    return last_from_first if left < right else np.linalg.inv(last_from_first).astype(float)


def _pinhole(camera: Document, coefficients: str, where: str, program: str) -> RawCamera:
    """A camera without R and P; ``coefficients`` is the key of its distortion coefficients."""
    expect_names(camera, ("distortion_model",), where, program)
    if (distortion := str(camera["distortion_model"])) != _RATIONAL:
        expect_names(camera, ("camera_model",), where, program)
    model = str(camera.get("camera_model", "pinhole"))
    if model != "pinhole" or distortion not in _KALIBR_MODELS:
        raise VfoaError(
            f"{where}: model {model}-{distortion}; expected pinhole with one of {', '.join(_KALIBR_MODELS)}"
        )
    expect_names(camera, ("intrinsics", "resolution"), where, program)
    d = np.zeros(0)
    if distortion != "none":
        expect_names(camera, (coefficients,), where, program)
        d = numbers(camera[coefficients], f"{where}: {coefficients}", 8 if distortion == _RATIONAL else 4)
    fx, fy, cx, cy = numbers(camera["intrinsics"], f"{where}: intrinsics", 4)
    width, height = numbers(camera["resolution"], f"{where}: resolution", 2)
    k: Float = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return RawCamera(size_px=(int(width), int(height)), k=k, d=d, model=_KALIBR_MODELS[distortion])
