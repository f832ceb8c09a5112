"""YAML and XML as plain values: OpenCV's FileStorage, and ordinary YAML.

OpenCV's own reader is not used: a damaged file makes it end the whole process.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
import yaml

from harness.files.io import read_bytes
from harness.files.parsing import parse_xml, parse_yaml
from vfoa.errors import VfoaError
from vfoa.types import Float

SUFFIXES = frozenset({".yml", ".yaml", ".xml"})

_OPENCV_HEAD = re.compile(rb"^%YAML:[^\n]*", re.MULTILINE)
"""OpenCV writes "%YAML:1.0", which is not a valid YAML directive."""


def read_document(path: Path) -> dict[str, Any]:
    """Return the values of a file's top level by name; OpenCV's matrices become arrays.

    Raises
    ------
    VfoaError
        If it cannot be read or parsed, or is no table of names.
    """
    document = _read_xml(path) if path.suffix.lower() == ".xml" else _read_yaml(path)
    if not isinstance(document, dict):
        raise VfoaError(f"{path}: holds no names; expected the calibration of OpenCV, ROS or Kalibr")
    return document


def numbers(value: Any, where: str, count: int | None = None) -> Float:
    """Return the numbers (count,) in a matrix, a (nested) list or a table with ``data``, row by row.

    Raises
    ------
    VfoaError
        If their number differs, or a value is no finite number.
    """
    given = value["data"] if isinstance(value, Mapping) and "data" in value else value
    try:
        found = np.asarray(given, dtype=np.float64).reshape(-1)  # also converts "1e-05", which YAML 1.1 reads as text
    except (TypeError, ValueError, OverflowError):
        raise VfoaError(f"{where}: found {given!r}; expected numbers") from None
    if (count is not None and found.size != count) or not np.isfinite(found).all():
        expected = "finite numbers" if count is None else f"{count} finite numbers"
        raise VfoaError(f"{where}: found {found.size} numbers; expected {expected}")
    return found


class _Loader(yaml.SafeLoader):
    """Reads YAML and OpenCV's matrices."""


def _matrix(loader: _Loader, node: yaml.Node) -> Float:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.constructor.ConstructorError(None, None, "an opencv-matrix that is no table", node.start_mark)
    try:
        return _shaped(loader.construct_mapping(node, deep=True))
    except (KeyError, TypeError, ValueError):
        raise yaml.constructor.ConstructorError(
            None, None, "an opencv-matrix whose data are not as many numbers as its size says", node.start_mark
        ) from None


for _kind in ("opencv-matrix", "opencv-nd-matrix"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _matrix)


def _read_yaml(path: Path) -> Any:
    data = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    return parse_yaml(_OPENCV_HEAD.sub(b"", data, count=1), path, _Loader)


def _read_xml(path: Path) -> dict[str, Any]:
    root = parse_xml(read_bytes(path), path)
    try:
        return {child.tag: _value(child) for child in root}
    except (LookupError, TypeError, ValueError):
        raise VfoaError(f"{path}: an opencv-matrix whose data are not as many numbers as its size says") from None


def _value(element: Element) -> Any:
    text = (element.text or "").strip()
    if element.get("type_id") in ("opencv-matrix", "opencv-nd-matrix"):
        parts = {child.tag: (child.text or "").split() for child in element}
        shape = {name: parts[name][0] for name in ("rows", "cols") if name in parts}
        return _shaped({**parts, **shape})
    if len(element):
        return [_value(child) for child in element]
    return text.strip('"')


def _shaped(matrix: Mapping[Any, Any]) -> Float:
    """The numbers of a matrix (rows, cols), or of one with any number of dimensions (sizes)."""
    shape = matrix["sizes"] if "sizes" in matrix else (matrix["rows"], matrix["cols"])
    # YAML does not know OpenCV's .Nan and .Inf
    numbers = [float(str(value).lower().replace(".nan", "nan").replace(".inf", "inf")) for value in matrix["data"]]
    return np.array(numbers).reshape([int(size) for size in shape])
