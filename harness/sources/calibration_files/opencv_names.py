"""The names that people give to OpenCV's matrices: ``cameraMatrixLeft``, ``mtx_l``, ``{"left": {"K": ...}}`` are K1."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from harness.sources.calibration_files.documents import METRES, Document
from vfoa.errors import VfoaError, listed

_OF_A_CAMERA = {
    "K": (
        *("k", "m", "mtx", "mat", "cm", "matrix", "cameramatrix", "cameramat", "cammatrix", "cammat", "cammtx"),
        *("intrinsic", "intrinsics", "intrinsicmatrix"),
    ),
    "D": (
        *("d", "dist", "distcoef", "distcoefs", "distcoeff", "distcoeffs", "distcoefficient", "distcoefficients"),
        *("distortion", "distortioncoeffs", "distortioncoefficients", "distortionparams"),
    ),
    "R": ("r", "rect", "rectification", "rectificationmatrix"),
    "P": ("p", "proj", "projmat", "projmatrix", "projection", "projectionmatrix"),
}
_OF_THE_PAIR = {
    "R": ("r", "rot", "rotation", "rotationmatrix", "rotationmat", "rotationofcamera2"),
    "T": ("t", "trans", "trns", "translation", "translationvector", "translationvec", "translationofcamera2"),
}
_TABLES_OF_THE_PAIR = (
    *("", "stereo", "extrinsic", "extrinsics"),
    *("stereoparams", "stereocalibration", "stereoextrinsic", "stereoextrinsics"),
)
"""Where R and T are in a file with a table for each camera; "" is beside them."""
_WITH_UNIT = {
    f"{table}{name}{unit}": unit_m
    for table in _TABLES_OF_THE_PAIR
    for name in _OF_THE_PAIR["T"]
    for unit, unit_m in METRES.items()
}
"""The unit of a translation whose name says it, by that name."""
_TABLES_OF_A_CAMERA = ("{}", "{}cam", "{}camera", "cam{}", "camera{}")
_ROLES = {
    **{f"{table}{name}": role for role in "RT" for name in _OF_THE_PAIR[role] for table in _TABLES_OF_THE_PAIR},
    **{f"{name}stereo": role for role in "RT" for name in _OF_THE_PAIR[role]},
    **dict.fromkeys(_WITH_UNIT, "T"),
} | {
    spelling: f"{role}{sides[0]}"
    for role, names in _OF_A_CAMERA.items()
    for name in names
    for sides in (("1", "l", "left"), ("2", "r", "right"))
    for spelling in (
        *(f"{name}{side}" for side in sides),
        *(f"{table.format(sides[2])}{name}" for table in _TABLES_OF_A_CAMERA),
    )
}
"""The role of each bare name: ``cameramatrixleft`` is K1. Names of camera 2 are MATLAB's."""
_ROLES_ALONE = {name: role for role, names in _OF_A_CAMERA.items() for name in names}
"""The role of each bare name without a side."""
_NUMBERED_TABLE = re.compile(r"(?:cam|camera)([012])")
"""The bare name of a table of a camera."""
_NUMBERED = re.compile(rf"({'|'.join(_ROLES_ALONE)})([012])")
"""The bare name of a matrix with the number of its camera."""


def role_of(name: object) -> str | None:
    """What a name of a pair means: K1, D1, R1, P1, those of the second camera, or R or T of the pair."""
    return _ROLES.get(bare_name(name))


def role_alone(name: object) -> str | None:
    """What a name without a side means: K, D, R or P of a single camera."""
    return _ROLES_ALONE.get(bare_name(name))


def names_unit(name: object) -> bool:
    """Whether it is the name of a translation with its unit."""
    return bare_name(name) in _WITH_UNIT


def bare_name(name: object) -> str:
    """A name in lower case, without underscores and hyphens."""
    return str(name).lower().replace("_", "").replace("-", "")


def one_level(document: Document) -> Iterator[tuple[str, Any]]:
    """The values by name, those of a table by both names: ``{"left": {"K": ...}}`` is ``left_K``.

    Tables of two cameras by their numbers are numbered from 1: ``{"cam0": {"K": ...}, "cam1": ...}`` has ``K1``.
    """
    numbered = {name: int(match[1]) for name in document if (match := _NUMBERED_TABLE.fullmatch(bare_name(name)))}
    from_1 = {name: number - min(numbered.values()) + 1 for name, number in numbered.items()}
    is_pair = {*from_1.values()} == {1, 2}
    for name, value in document.items():
        if isinstance(value, Mapping) and "data" not in value and role_of(name) is None:
            for inner, below in value.items():
                yield f"{inner}{from_1[name]}" if is_pair and name in from_1 else f"{name}_{inner}", below
        else:
            yield str(name), value


def numbered_from_1(values: Document, where: str) -> Document:
    """The values by name, those of cameras 0 and 1 by the names of 1 and 2."""
    numbered = {name: match for name in values if (match := _NUMBERED.fullmatch(bare_name(name)))}
    if "0" not in (present := {match[2] for match in numbered.values()}):
        return values
    if "2" in present:
        raise VfoaError(f"{where}: found {listed([*numbered], 8)} of three cameras; expected those of the pair alone")
    return {
        f"{match[1]}{int(match[2]) + 1}" if (match := numbered.get(name)) else name: value
        for name, value in values.items()
    }


def stated_unit_m(name: str) -> float | None:
    """The unit in the name of a translation or a baseline; None of any other name."""
    plain = bare_name(name)
    of_baselines = (unit_m for unit, unit_m in METRES.items() if plain.endswith(f"baseline{unit}"))
    return next(of_baselines, _WITH_UNIT.get(plain))


def is_of_one_camera(name: str) -> bool:
    """Whether a name is that of a camera matrix, or of a focal length in pixels, without a number or a side."""
    return role_alone(name) == "K" or re.fullmatch(r"(?:.*[_.])?fx(?:_px)?", name.lower()) is not None


def merged(documents: Sequence[Document]) -> dict[str, Any]:
    """The values of several files; those of the first two by the names of left and right if each has one camera."""
    has_one = [any(role_alone(name) == "K" for name in document) for document in documents[:2]]
    sides = ["left_", "right_"] if has_one == [True, True] else []
    sides += [""] * (len(documents) - len(sides))
    pairs = zip(sides, documents, strict=True)
    return {f"{side}{name}": value for side, document in pairs for name, value in document.items()}
