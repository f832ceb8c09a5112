"""Calibrations in NumPy's archives, JSON and MATLAB's files, and the kinds of files that are refused by name."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.io import opened, read_bytes
from harness.files.parsing import check_archive, parse_json
from vfoa.errors import VfoaError, reported_as

SAVE = 'np.savez("stereo.npz", K1=K1, D1=D1, K2=K2, D2=D2, R=R, T=T, image_size=(width, height))'
"""What users of Python save instead of another kind of file."""

_MATLAB = (
    "a file of MATLAB without matrices that can be read (of version 7.3, or with objects alone)",
    "expected what jsonencode(toStruct(stereoParams)) returns, in a file .json (or, of a struct with K1 D1 K2 D2 R T, "
    "jsonencode of that)",
)
FROM_PICKLE = 'np.savez("stereo.npz", **pickle.loads(pathlib.Path("FILE").read_bytes()))'
FROM_ARRAYS = 'np.savez("stereo.npz", **{path.stem: np.load(path) for path in pathlib.Path().glob("*.npy")})'
_PICKLE = (
    "a pickle of Python, which could run any code",
    f"expected the same matrices by {SAVE}; of a dict that you have saved yourself, {FROM_PICKLE}",
)
_HDF5 = "a file of HDF5", f"expected the same matrices by {SAVE}"
_ONE_ARRAY = (
    "one array of NumPy",
    f"expected all matrices of the pair by {SAVE}; of a folder of arrays with such names, {FROM_ARRAYS}",
)
_TOML = (
    "a file in TOML (Anipose, FreeMoCap and Pose2Sim save the poses of cameras in a room so)",
    f"expected the pair by {SAVE}, of R0 t0 and R1 t1, the rotations (cv2.Rodrigues) and translations of its left and "
    'right camera: R = R1 @ R0.T, T = t1 - R @ t0 (not in metres: calibration_unit = "mm")',
)
_MAPS = (
    "rectification maps of initUndistortRectifyMap, from which the cameras are not known",
    "expected the matrices that they were made from: K1 D1 K2 D2 with R T or R1 R2 P1 P2",
)

_BY_SUFFIX = {
    **dict.fromkeys((".pkl", ".pickle", ".p", ".joblib"), _PICKLE),
    **dict.fromkeys((".h5", ".hdf5"), _HDF5),
    ".npy": _ONE_ARRAY,
    ".toml": _TOML,
}
_BY_HEAD = (
    (re.compile(rb"\x80[\x02-\x05]"), _PICKLE),
    (re.compile(rb"MATLAB 7"), _MATLAB),
    (re.compile(rb"\x89HDF"), _HDF5),
    (re.compile(rb"\x93NUMPY"), _ONE_ARRAY),
)
FOREIGN_SUFFIXES = frozenset(_BY_SUFFIX)
_TEXT_SUFFIXES = frozenset({".yml", ".yaml", ".xml", ".json"})
_MAP_NAME = re.compile(
    rb"\b(?:\w*stereo_?map\w*|(?:left|right|l|r)?_?map_?(?:[12xylr]|left|right)\w*)\b", re.IGNORECASE
)
_LENS_NAME = re.compile(rb"\b(?:[KMP]_?(?:1|l|left)|\w*(?:mtx|camera_?matrix|dist)\w*)\b", re.IGNORECASE)
_HEAD_BYTES = 2**16


def refuse_foreign_calibration(path: Path) -> None:
    """Raise a :class:`VfoaError` that names the kind of a file that holds a calibration in a form that is not read."""
    head = head_of(path)
    by_head = next((kind for start, kind in _BY_HEAD if start.match(head)), None)
    if kind := by_head or _BY_SUFFIX.get(path.suffix.lower()):
        raise _refusal(path, kind)
    if path.suffix.lower() in _TEXT_SUFFIXES and _holds_maps_alone(head):
        raise _refusal(path, _MAPS)


def _holds_maps_alone(names: bytes) -> bool:
    return bool(_MAP_NAME.search(names)) and not _LENS_NAME.search(names)


def head_of(path: Path) -> bytes:
    """The first bytes of a file."""
    with opened(path) as file:
        return file.read(_HEAD_BYTES)


def _refusal(path: Path, kind: tuple[str, str]) -> VfoaError:
    what, expected = kind
    return VfoaError(f"{path}: {what}; {expected}")


def read_archive(path: Path) -> dict[str, Any]:
    """Return the arrays of a NumPy archive by name.

    Raises
    ------
    VfoaError
        If it is no such archive, or holds objects of Python or rectification maps.
    """
    data = read_bytes(path)
    check_archive(data, path)
    # errors of the archive, and of each array's header, which is Python
    with reported_as(f"{path}: not a .npz file"), np.load(io.BytesIO(data), allow_pickle=False) as file:
        if _holds_maps_alone(" ".join(file.files).encode()):
            raise _refusal(path, _MAPS)
        try:
            return {name: file[name] for name in file.files if not _MAP_NAME.fullmatch(name.encode())}
        except ValueError as error:
            if "allow_pickle" not in str(error):
                raise
            raise _refusal(path, ("holds objects of Python (a dict or a list)", f"expected matrices: {SAVE}")) from None


_MOST_NUMBERS = 1000
"""Larger matrices of a file of MATLAB are no camera's, and are not read."""


def read_mat(path: Path) -> dict[str, Any]:
    """Return the small matrices of a file of MATLAB by name; its objects and structs are not read.

    Raises
    ------
    VfoaError
        If it is no such file, or has none.
    """
    from scipy.io import loadmat, whosmat  # slow to import

    try:
        held = [(name, math.prod(shape), kind) for name, shape, kind in whosmat(path)]
        names = [name for name, size, kind in held if size <= _MOST_NUMBERS and kind in ("double", "single")]
        matrices = loadmat(path, variable_names=names) if names else {}
    except Exception as error:  # of the reader, which has no common base
        raise _refusal(path, _MATLAB) from error
    if not names:
        raise _refusal(path, _MATLAB)
    return {name: matrices[name] for name in names}


def read_json(path: Path) -> Any:
    """Return a JSON document; the matrices of cv2.FileStorage become arrays.

    Raises
    ------
    VfoaError
        If it is not JSON, or a matrix has not as many numbers as its size says.
    """
    document = parse_json(read_bytes(path), path)
    if not isinstance(document, Mapping):
        return document
    return {name: _matrix(value, f"{path}: {name}") for name, value in document.items()}


def _matrix(value: Any, where: str) -> Any:
    if not (isinstance(value, Mapping) and str(value.get("type_id", "")).startswith("opencv-")):
        return value
    with reported_as(f"{where}: an opencv-matrix whose data do not have rows x cols numbers"):
        shape = value["sizes"] if "sizes" in value else (value["rows"], value["cols"])
        return np.array(value["data"], np.float64).reshape([int(size) for size in shape])
