"""The message types that are read, and the purpose of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["raw", "compressed", "video", "calibration", "transforms", "extrinsics"]
IMAGES: frozenset[Kind] = frozenset({"raw", "compressed", "video"})

_ROS: dict[str, Kind] = {
    "sensor_msgs/msg/Image": "raw",
    "sensor_msgs/msg/CompressedImage": "compressed",
    "sensor_msgs/msg/CameraInfo": "calibration",
    "foxglove_msgs/msg/RawImage": "raw",
    "foxglove_msgs/msg/CompressedImage": "compressed",
    "foxglove_msgs/msg/CompressedVideo": "video",
    "foxglove_msgs/msg/CameraCalibration": "calibration",
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket": "video",
    "tf2_msgs/msg/TFMessage": "transforms",
    "foxglove_msgs/msg/FrameTransform": "transforms",
    "foxglove_msgs/msg/FrameTransforms": "transforms",
    "realsense2_camera_msgs/msg/Extrinsics": "extrinsics",
}
_FOXGLOVE: dict[str, Kind] = {
    f"foxglove.{name.rpartition('/')[2]}": kind for name, kind in _ROS.items() if name.startswith("foxglove_msgs/")
}
_FAMILIES: dict[str, dict[str, Kind]] = {"cdr": _ROS, "ros1": _ROS, "protobuf": _FOXGLOVE, "json": _FOXGLOVE}

BY_NAME = "by name"
"""Schema encoding of a ROS 2 message without a definition in the recording: the standard definition is used."""

_SCHEMAS = {"cdr": ("ros2msg", "ros2idl", BY_NAME), "ros1": ("ros1msg",)}


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageType:
    """The encoding of a topic's messages, sufficient to decode them in another process.

    ROS's types have their ROS 2 names (``sensor_msgs/msg/Image``) in ROS 1, too.
    """

    message_encoding: str
    schema_encoding: str
    name: str
    schema: bytes

    @property
    def kind(self) -> Kind | None:
        """The camera data that it carries; None: other data, or a schema in a language that is not supported."""
        if self.schema_encoding not in _SCHEMAS.get(self.message_encoding, (self.schema_encoding,)):
            return None
        return _FAMILIES.get(self.message_encoding, {}).get(self.name)

    @property
    def is_ros(self) -> bool:
        """Whether its messages are ROS's, in either serialisation."""
        return self.message_encoding in _SCHEMAS


def ros_name(name: str) -> str:
    """ROS 2's name of a type: ``sensor_msgs/Image`` becomes ``sensor_msgs/msg/Image``."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name
