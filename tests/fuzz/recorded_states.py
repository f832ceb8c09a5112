"""Recordings and their messages, as parsers of files."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from harness.sources.recordings import messages
from harness.sources.recordings.clip import RecordingClip
from harness.sources.recordings.depth_images import read_depth
from harness.sources.recordings.message_types import BY_NAME, MessageType
from harness.sources.recordings.rvl import decode_rvl
from harness.sources.recordings.settings import RecordingSettings
from tests.depth_recordings import compressed_depth, encode_rvl
from tests.fuzz import media_seeds as media
from vfoa.errors import VfoaError


def read_recording(path: Path) -> Any:
    clip = RecordingClip(RecordingSettings.model_validate({"recording": path.name}), path.parent)
    return [clip.frame(number) for number in list(clip.frames)[:4]]


def write_metadata(path: Path) -> None:
    media.depth_bag("db3")(path.parent / "unused.db3")
    (made,) = (path.parent / "made").rglob("metadata.yaml")
    path.write_bytes(made.read_bytes())


def read_with_metadata(path: Path) -> Any:
    """A folder with this metadata.yaml and a whole database."""
    folder = path.parent / "made" / "take_db3"
    if not folder.is_dir():
        write_metadata(path.parent / "whole" / path.name)
        os.rename(path.parent / "whole" / "made", path.parent / "made")
    (folder / path.name).write_bytes(path.read_bytes())
    try:
        return read_recording(folder)
    except VfoaError as error:  # names the folder
        raise VfoaError(f"{path}: {error}") from None


def _kind(name: str) -> MessageType:
    return MessageType(message_encoding="cdr", schema_encoding=BY_NAME, name=f"sensor_msgs/msg/{name}", schema=b"")


def _ros(path: Path, kind: str, **fields: Any) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    stamp = store.types["builtin_interfaces/msg/Time"](5, 7)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="optical")
    name = f"sensor_msgs/msg/{kind}"
    path.write_bytes(bytes(store.serialize_cdr(store.types[name](header=header, **fields), name)))


def _compressed(form: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        said, data = compressed_depth(media.shot(1).depth_mm, form)
        _ros(path, "CompressedImage", format=said, data=np.frombuffer(data, np.uint8))

    return write


def _raw(path: Path) -> None:
    depth = media.shot(1).depth_mm
    fields = {"encoding": "16UC1", "is_bigendian": 0, "step": 64, "data": np.frombuffer(depth.tobytes(), np.uint8)}
    _ros(path, "Image", height=24, width=32, **fields)


def _camera_info(path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    k, p = np.array([50.0, 0, 15.5, 0, 50, 11.5, 0, 0, 1]), np.arange(12.0)
    fields = {"d": np.zeros(5), "k": k, "r": np.eye(3).ravel(), "p": p, "binning_x": 0, "binning_y": 0}
    roi = store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    _ros(path, "CameraInfo", height=24, width=32, distortion_model="plumb_bob", roi=roi, **fields)


def _rvl(path: Path) -> None:
    depth = media.shot(1).depth_mm
    path.write_bytes(struct.pack("<HH", depth.shape[1], depth.shape[0]) + encode_rvl(depth))


MESSAGES: dict[str, Callable[[Path], None]] = {
    "depth in RVL": _compressed("rvl"),
    "depth in PNG": _compressed("png"),
    "inverse depth in PNG": _compressed("32FC1 png"),
    "raw depth": _raw,
    "camera info": _camera_info,
    "RVL": _rvl,
}
"""A message, or a part of one, each with what writes a whole one."""


def read_message(name: str) -> Callable[[Path], Any]:
    """Return a function that reads such a message from a file; the file's name stands for the topic's."""
    kind = _kind({"raw depth": "Image", "camera info": "CameraInfo"}.get(name, "CompressedImage"))

    def read(path: Path) -> Any:
        data, where = path.read_bytes(), str(path)
        if name == "RVL":
            return _decoded(data, where)
        if name == "camera info":
            return messages.camera(kind, data, where), messages.sight(kind, data, where)
        return messages.stamp_ns(kind, data, where), read_depth(kind, data, None, where)

    return read


def _decoded(data: bytes, where: str) -> Any:
    width, height = struct.unpack_from("<HH", data.ljust(4, b"\1"))
    try:
        return decode_rvl(data[4:], width, height)
    except ValueError as error:  # as its caller does
        raise VfoaError(f"{where}: {error}") from None
