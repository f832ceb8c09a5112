"""Cameras that people's scripts save as tables of numbers, by the names of the ZED's SDK or of librealsense."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from harness.sources.calibration_files.documents import Document
from harness.sources.calibration_files.image_size import image_size

_PRINCIPAL_POINTS = (("cx", "cy"), ("ppx", "ppy"))
_LENS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Coefficients in OpenCV's order."""
_COLUMNS = ("disto", "coeffs")
"""Their names in the SDKs, all in one list."""
_OF_OPENCV = ("brown_conrady", "plumb_bob", "none")
_OF_COLOUR, _OF_DEPTH = re.compile(r"rgb|colou?r", re.IGNORECASE), re.compile(r"depth|infra|ir(?![a-z])", re.IGNORECASE)
_OF_LEFT, _OF_RIGHT = re.compile(r"left", re.IGNORECASE), re.compile(r"right", re.IGNORECASE)
"""Of names of tables of cameras: depth is aligned with colour, and measured by the left one of two."""


def is_camera(value: object) -> bool:
    """Whether a value is a table of a camera's numbers."""
    return isinstance(value, Mapping) and {"fx", "fy"} <= value.keys()


def lifted(document: Document) -> dict[str, Any]:
    """The values of a document by their names as text, those of a table of cameras (``intrinsics``) beside them."""
    top = dict[str, Any]()
    for name, value in document.items():
        is_group = isinstance(value, Mapping) and sum(map(is_camera, value.values())) > 1
        top |= value if is_group else {name: value}
    return {str(name): value for name, value in top.items()}


def realsense_cameras(document: Document) -> list[str]:
    """The names of cameras in tables of their own, by a RealSense's names; ``intrinsics_left`` of a table in one."""
    tables = [(str(name), value) for name, value in document.items() if isinstance(value, Mapping)]
    tables += [(f"{name}_{inner}", below) for name, table in tables for inner, below in table.items()]
    return [name for name, table in tables if is_camera(table)]


def images_camera(top: Document, size_px: tuple[int, int] | None) -> str | None:
    """The table of the images' camera among the values of a document; None if it is not known.

    It is the only one; of colour, depth and infrared the one of this size, else colour; left beside right.
    """
    if "fx" in top:
        return None
    tables = {name: value for name, value in top.items() if is_camera(value)}
    for of_images, of_others in ((_OF_COLOUR, _OF_DEPTH), (_OF_LEFT, _OF_RIGHT)):
        if len(tables) > 1 and all(of_images.search(name) or of_others.search(name) for name in tables):
            sizes = {name: image_size(table, None, name) or size_px for name, table in tables.items()}
            fitting = [name for name in tables if sizes[name] == size_px] or [*tables]
            named = [name for name in fitting if of_images.search(name)]
            return (named or fitting)[0] if len(named or fitting) == 1 else None
    return next(iter(tables)) if len(tables) == 1 else None


def with_camera_table(document: Document, size_px: tuple[int, int] | None = None) -> Document:
    """The values of a document and of its table of the images' camera: ``{"intrinsics": {"fx": ...}}``."""
    top = lifted(document)
    name = images_camera(top, size_px)
    if name is None:
        return document
    return {**{name: value for name, value in top.items() if not is_camera(value)}, **top[name]}


def with_matrices(document: Document) -> dict[str, Any]:
    """The values of :func:`lifted`, with K and D in each table of a camera, beside its other values.

    The values of a document with a single camera are in one table. A camera whose lens is not one of OpenCV's stays as
    it is.
    """
    top = with_camera_table(document) if len(realsense_cameras(document)) == 1 else document
    if is_camera(top):
        return dict(_as_matrices(top))
    return {name: _as_matrices(value) if is_camera(value) else value for name, value in lifted(top).items()}


def _as_matrices(table: Document) -> Document:
    centre = next((names for names in _PRINCIPAL_POINTS if table.keys() >= {*names}), None)
    if centre is None:
        return table
    columns = [name for name in _COLUMNS if name in table]
    by_name = [name for name in _LENS if name in table]
    d = table[columns[0]] if columns else [table.get(name, 0.0) for name in _LENS[: 8 if "k4" in by_name else 5]]
    is_of_opencv = str(table.get("model", _OF_OPENCV[0])).removeprefix("distortion.").lower() in _OF_OPENCV
    if ("k4" in by_name and not {*by_name} >= {"p1", "p2", "k5", "k6"}) or not (is_of_opencv or _is_zero(d)):
        return table  # a fisheye lens, or RealSense's inverse model
    cx, cy = (table[name] for name in centre)
    lens = {"D": d} if columns or by_name else {}
    read = {"fx", "fy", *centre, *by_name, *columns}
    rest = {name: value for name, value in table.items() if name not in read}
    return {**rest, "K": [[table["fx"], 0, cx], [0, table["fy"], cy], [0, 0, 1]], **lens}


def _is_zero(coefficients: Any) -> bool:
    return isinstance(coefficients, list) and not any(coefficients)
