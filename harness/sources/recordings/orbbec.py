"""Recordings of Orbbec's SDK and OrbbecViewer (``.bag``): of a Femto Bolt, a Gemini.

/cam/sensor_2/frameType_2     images, logged at the times when they were taken: 1 is infrared, 2 colour, 3 depth
/cam/streamProfileType_2      the calibration of the images; that of depth has the pose colour_from_depth

Here the topics have the names of Orbbec's driver for ROS (``/camera/color/image_raw``). The messages have other fields
than the definitions in the file say. They are read as the SDK writes them
(https://github.com/orbbec/OrbbecSDK_v2: src/media/ros/RosbagWriter.cpp): after the size of a row, an image has its
content, or, in some versions, the size of its metadata and then both as one array.
"""

from __future__ import annotations

import re
import struct

import numpy as np

from harness.sources.recordings.image_message import ImageMessage
from harness.sources.rectification import RawCamera, motion_of
from vfoa.errors import VfoaError
from vfoa.types import Float

ENCODING = "orbbec"
IMAGE, PROFILE = "sensor_msgs/msg/Image", "custom_msg/msg/OBStreamProfileInfo"
DEPTH_INFO = "/camera/depth/camera_info"

_TOPIC = re.compile(r"/cam/(?:sensor_(?P<sensor>\d+)/frameType_\d+|streamProfileType_(?P<stream>\d+))")
_SENSORS = {"1": "ir", "2": "color", "3": "depth", "6": "left_ir", "7": "right_ir"}
"""OBSensorType and OBStreamType of libobsensor/h/ObTypes.h, and the driver's names of them."""

_HEAD, _SIZE, _LAYOUT = struct.Struct("<III"), struct.Struct("<I"), struct.Struct("<BI")
_AFTER_BOTH = struct.calcsize("<4Q")  # the number and three times, where metadata and content are one array
_PROFILE = struct.Struct("<BB9f3f3H4f8fB")
_FISHEYE = 5
_MOST_TURN = 0.05
"""Most by which a recorded rotation may differ from one: those of a Femto Bolt are scaled by .994 in places."""


def name_of(topic: str) -> str | None:
    """Return the driver's name of a topic; None if it has no images or calibrations of the SDK."""
    found = _TOPIC.fullmatch(topic)
    sensor = None if found is None else _SENSORS.get(found["sensor"] or found["stream"])
    if found is None or sensor is None:
        return None
    return f"/camera/{sensor}/{'image_raw' if found['sensor'] else 'camera_info'}"


def image_of(data: bytes) -> ImageMessage:
    """Return the image in a message.

    Raises
    ------
    ValueError, struct.error
        If the message is of another layout.
    """
    _, at = _text(data, _HEAD.size)
    height, width = struct.unpack_from("<II", data, at)
    form, at = _text(data, at + 8)
    is_bigendian, step = _LAYOUT.unpack_from(data, at)
    at += _LAYOUT.size
    first, second = struct.unpack_from("<II", data, at)
    if at + 8 + second + _AFTER_BOTH == len(data):  # the size of the metadata, and that of metadata and content
        begin, end = at + 8 + first, at + 8 + second
    else:
        begin, end = at + 4, at + 4 + first
    if not begin < end <= len(data):
        raise ValueError(f"{len(data)} bytes with an image from byte {begin} to {end}")
    form, content = form.lower(), data[begin:end]
    size_px = None if form == "mjpg" else (width, height)
    return ImageMessage(form=form, data=content, size_px=size_px, step=step, is_bigendian=bool(is_bigendian))


def camera_of(data: bytes, where: str) -> RawCamera:
    """Return the camera of a calibration; its coefficients are k1 to k6, p1, p2, or k1 to k4 of a fisheye lens.

    Raises
    ------
    VfoaError
        If it is not set.
    struct.error
        If the message is of another layout.
    """
    *_, width, height, _, fx, fy, cx, cy, k1, k2, k3, k4, k5, k6, p1, p2, model = _profile(data)
    if min(width, height, fx, fy) <= 0:
        raise VfoaError(f"{where}: found {width} x {height} pixels and fx {fx:g}; expected a calibration that is set")
    size_px, k = (int(width), int(height)), np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if model == _FISHEYE:
        return RawCamera(size_px=size_px, k=k, d=np.array([k1, k2, k3, k4]), model="equidistant")
    return RawCamera(size_px=size_px, k=k, d=np.array([k1, k2, p1, p2, k3, k4, k5, k6]))


def colour_from_depth(data: bytes, where: str) -> Float | None:
    """Return the motion (4, 4), metres, in the calibration of depth; None if colour was not recorded beside it.

    Raises
    ------
    VfoaError
        If it is far from a rotation and a translation.
    """
    values = _profile(data)
    linear, moved_mm = np.reshape(values[2:11], (3, 3)), np.array(values[11:14])
    if not linear.any():
        return None
    u, _, v = np.linalg.svd(linear)
    rotation = u @ v
    if np.linalg.det(rotation) < 0 or np.abs(rotation - linear).max() > _MOST_TURN:
        raise VfoaError(f"{where}: rotationMatrix: found {linear.tolist()}; expected a rotation")
    return motion_of(rotation, moved_mm / 1000)


def _profile(data: bytes) -> tuple[float, ...]:
    _, at = _text(data, _HEAD.size)
    return _PROFILE.unpack_from(data, at)


def _text(data: bytes, at: int) -> tuple[str, int]:
    """The text at a place, and where it ends."""
    (size,) = _SIZE.unpack_from(data, at)
    end = at + _SIZE.size + size
    return data[at + _SIZE.size : end].decode(), end
