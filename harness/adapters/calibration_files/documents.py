"""YAML and XML as plain values: OpenCV's FileStorage and everybody else's YAML."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from harness.files import read_bytes
from vfoa.errors import VfoaError
from vfoa.types import Float

SUFFIXES = frozenset({".yml", ".yaml", ".xml"})


def read_document(path: Path) -> dict[str, Any]:
    """The values of a file's top level by name; OpenCV's matrices as arrays.

    Raises
    ------
    VfoaError
        If it cannot be read or parsed, or is no table of names.
    """
    data = read_bytes(path)
    is_opencv = path.suffix.lower() == ".xml" or data.startswith(b"%YAML") or b"opencv-matrix" in data
    document = _read_opencv(path) if is_opencv else _read_yaml(path, data)
    if not isinstance(document, dict):
        raise VfoaError(f"{path}: holds no names; expected the calibration of OpenCV, ROS or Kalibr")
    return document


def numbers(value: Any, where: str, count: int | None = None) -> Float:
    """The numbers (count,) in a matrix, a (nested) list or a table with ``data``, row by row.

    Raises
    ------
    VfoaError
        If there are others, or something is no finite number.
    """
    given = value["data"] if isinstance(value, Mapping) and "data" in value else value
    try:
        found = np.asarray(given, dtype=np.float64).reshape(-1)  # also of "1e-05", which YAML 1.1 takes for a word
    except (TypeError, ValueError):
        raise VfoaError(f"{where}: found {given!r}; expected numbers") from None
    if (count is not None and found.size != count) or not np.isfinite(found).all():
        expected = "finite numbers" if count is None else f"{count} finite numbers"
        raise VfoaError(f"{where}: found {found.size} numbers; expected {expected}")
    return found


def _read_yaml(path: Path, data: bytes) -> Any:
    try:
        return yaml.safe_load(data)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f":{mark.line + 1}"
        problem = getattr(error, "problem", None) or "cannot be parsed"
        raise VfoaError(f"{path}{line}: not YAML: {problem}") from None


def _read_opencv(path: Path) -> dict[str, Any]:
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        try:
            return {name: _value(storage.getNode(name)) for name in storage.root().keys()}  # noqa: SIM118
        finally:
            storage.release()
    except (cv2.error, SystemError):  # OpenCV's binding raises the latter where parsing failed
        raise VfoaError(f"{path}: cannot be parsed; expected YAML or XML as OpenCV's FileStorage writes it") from None


def _value(node: Any) -> Any:
    if node.isString():
        return node.string()
    if node.isInt() or node.isReal():
        return node.real()
    if node.isSeq():
        return [_value(node.at(place)) for place in range(node.size())]
    try:
        return node.mat()
    except cv2.error:  # a table of OpenCV's that is no matrix
        return None
