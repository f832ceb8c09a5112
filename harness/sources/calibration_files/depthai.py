"""The calibration in an OAK camera's memory, as DepthAI writes it (``CalibrationHandler.eepromToJsonFile``).

``cameraData`` has a camera for each socket. Its extrinsics take points to the frame of another socket, centimetres::

    x_to = rotationMatrix x_own + translation

so that the two cameras of a pair meet in a frame that both lead to. ``stereoRectificationData`` names the pair. Its
rotations are those of OpenCV's ``stereoRectify``, which are computed anew: they lack the rectified matrices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from harness.sources.calibration_files.documents import Document, numbers
from harness.sources.rectification import ImageSize, RawCalibration, RawCamera, check_motion, motion_of, rectify_pose
from vfoa.errors import VfoaError
from vfoa.types import Float

_METRES = 0.01
_FISHEYE = 1
"""``cameraType`` of a fisheye lens, of which four coefficients count."""

_PAIR = {"left": 1, "right": 2}
"""The usual sockets of the pair, CAM_B and CAM_C."""


def is_depthai(document: Document) -> bool:
    """Whether a document is of this kind."""
    return isinstance(document.get("cameraData"), list)


def depthai_pair(document: Document, size: ImageSize, where: str) -> RawCalibration:
    """Return the stereo pair of a camera, for images of whole sensors or of their middle rows.

    Parameters
    ----------
    size
        Gives (width, height) of the images. 1280 x 720 of 1280 x 800 pixels lack 40 rows above and below, as in
        DepthAI's ``getCameraIntrinsics``.

    Raises
    ------
    VfoaError
        If a camera or a key is missing or wrong, or the cameras are no pair.
    """
    cameras = _cameras(document, where)
    named = document.get("stereoRectificationData")
    sockets = [_socket(named, side, usual, cameras, where) for side, usual in _PAIR.items()]
    size_px = size()
    left, right = (_without_rows(_lens(cameras[number], f"{where}: camera {number}"), size_px) for number in sockets)
    ways = [_ways(cameras, number, where) for number in sockets]
    if (common := next((number for number in ways[0] if number in ways[1]), None)) is None:
        raise VfoaError(
            f"{where}: found no common camera in the extrinsics of cameras {sockets[0]} and {sockets[1]}; expected "
            "toCameraSocket of each to lead to one camera"
        )
    common_from_right = check_motion(ways[1][common], f"{where}: camera {sockets[1]}: extrinsics")
    right_from_left = np.linalg.inv(common_from_right) @ ways[0][common]
    return rectify_pose(left, right, right_from_left[:3, :3], right_from_left[:3, 3] * _METRES, where)


def _cameras(document: Document, where: str) -> dict[int, Document]:
    """The cameras by socket."""
    try:
        return {int(number): dict(camera) for number, camera in document["cameraData"]}
    except (TypeError, ValueError):
        raise VfoaError(f"{where}: cameraData: expected pairs of a socket's number and its camera") from None


def _socket(named: Any, side: str, usual: int, cameras: Mapping[int, Document], where: str) -> int:
    """The socket of a side: that of the file, or the usual one where it names none (-1)."""
    found = named.get(f"{side}CameraSocket", -1) if isinstance(named, Mapping) else -1
    number = usual if found == -1 else found
    if not isinstance(number, int) or number not in cameras:
        raise VfoaError(f"{where}: no {side} camera (socket {number}); found {', '.join(map(str, cameras)) or 'none'}")
    return int(number)


def _value(camera: Any, key: str, where: str) -> Any:
    if not isinstance(camera, Mapping) or key not in camera:
        raise VfoaError(f"{where}: no {key}; expected DepthAI's calibration")
    return camera[key]


def _lens(camera: Document, where: str) -> RawCamera:
    """A camera without R and P."""
    width, height = (int(numbers(_value(camera, key, where), f"{where}: {key}", 1)[0]) for key in ("width", "height"))
    k = numbers(_value(camera, "intrinsicMatrix", where), f"{where}: intrinsicMatrix", 9).reshape(3, 3)
    d = numbers(_value(camera, "distortionCoeff", where), f"{where}: distortionCoeff")
    if camera.get("cameraType", 0) == _FISHEYE:
        return RawCamera(size_px=(width, height), k=k, d=d[:4], model="equidistant")
    return RawCamera(size_px=(width, height), k=k, d=d)


def _without_rows(camera: RawCamera, size_px: tuple[int, int]) -> RawCamera:
    """The camera of images that are wider for their height than its own: without as many rows above as below."""
    width, height = camera.size_px
    kept = min(height, round(size_px[1] * width / size_px[0]))
    k = camera.k.copy()
    k[1, 2] -= (height - kept) / 2
    return replace(camera, k=k, size_px=(width, kept))


def _ways(cameras: Mapping[int, Document], socket: int, where: str) -> dict[int, Float]:
    """The transforms (4, 4) from a camera to itself, to the one that its extrinsics lead to, and so on."""
    ways, here = {socket: np.eye(4)}, socket
    while here in cameras:
        place = f"{where}: camera {here}: extrinsics"
        extrinsics = _value(cameras[here], "extrinsics", f"{where}: camera {here}")
        there = int(numbers(_value(extrinsics, "toCameraSocket", place), f"{place}: toCameraSocket", 1)[0])
        if there in ways or there < 0:
            break
        rotation = numbers(_value(extrinsics, "rotationMatrix", place), f"{place}: rotationMatrix", 9).reshape(3, 3)
        shift = _value(extrinsics, "translation", place)
        step = motion_of(
            rotation, [numbers(_value(shift, axis, place), f"{place}: translation", 1)[0] for axis in "xyz"]
        )
        ways[there], here = step @ ways[here], there
    return ways
