"""MCAP recordings of a stereo camera, written by the libraries' own writers."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2.writer import Writer as Ros2Writer
from numpy.typing import NDArray

Family = Literal["ros2", "protobuf", "json"]
Pixels = Literal["raw", "png", "jpeg"]

HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
IMAGE = """std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data"""
COMPRESSED_IMAGE = """std_msgs/Header header
string format
uint8[] data"""
CAMERA_INFO = """std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
sensor_msgs/RegionOfInterest roi
================================================================================
MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify"""
ROS2 = {"Image": IMAGE, "CompressedImage": COMPRESSED_IMAGE, "CameraInfo": CAMERA_INFO}


@dataclass(frozen=True, kw_only=True)
class Camera:
    """The content of one camera's calibration message."""

    width: int
    height: int
    k: list[float]
    p: list[float]
    d: tuple[float, ...] = ()
    r: tuple[float, ...] = (1, 0, 0, 0, 1, 0, 0, 0, 1)
    model: str = "plumb_bob"


def rectified_camera(width: int, height: int, fx: float, cx: float, cy: float, baseline_m: float = 0.0) -> Camera:
    return Camera(
        width=width,
        height=height,
        k=[fx, 0, cx, 0, fx, cy, 0, 0, 1],
        p=[fx, 0, cx, -fx * baseline_m, 0, fx, cy, 0, 0, 0, 1, 0],
    )


class Recorder:
    """Writes camera messages of one family; by default the stamp is also the log time."""

    def __init__(self, family: Family, writer: Any) -> None:
        self._family, self.writer = family, writer
        self._ids: dict[str, Any] = {}
        self._log_ns: int | None = None

    def picture(
        self,
        topic: str,
        stamp_ns: int,
        image: NDArray[np.uint8],
        pixels: Pixels = "raw",
        *,
        log_ns: int | None = None,
    ) -> None:
        self._log_ns = log_ns
        if pixels == "raw":
            self.raw(topic, stamp_ns, image.shape[1], image.shape[0], "rgb8", image.shape[1] * 3, image.tobytes())
        else:
            options = [cv2.IMWRITE_JPEG_QUALITY, 95] if pixels == "jpeg" else []
            done, coded = cv2.imencode(f".{pixels}", np.ascontiguousarray(image[..., ::-1]), options)
            assert done
            self.compressed(topic, stamp_ns, pixels, coded.tobytes())

    def raw(
        self, topic: str, stamp_ns: int, width: int, height: int, encoding: str, step: int, data: bytes, big: int = 0
    ) -> None:
        fields = {"width": width, "height": height, "encoding": encoding, "step": step, "data": data}
        if self._family == "ros2":
            fields["is_bigendian"] = big
        self._write(topic, "Image" if self._family == "ros2" else "RawImage", RawImage, stamp_ns, fields)

    def compressed(self, topic: str, stamp_ns: int, form: str, data: bytes) -> None:
        self._write(topic, "CompressedImage", CompressedImage, stamp_ns, {"format": form, "data": data})

    def camera(
        self,
        topic: str,
        stamp_ns: int,
        camera: Camera,
        binning: int = 0,
        region: tuple[int, int, int, int] = (0, 0, 0, 0),
        *,
        log_ns: int | None = None,
    ) -> None:
        self._log_ns = log_ns
        matrices = {"D": list(camera.d), "K": camera.k, "R": list(camera.r), "P": camera.p}
        fields = {"width": camera.width, "height": camera.height, "distortion_model": camera.model}
        if self._family == "ros2":
            roi = dict(zip(("x_offset", "y_offset", "width", "height"), region, strict=True)) | {"do_rectify": False}
            fields |= {name.lower(): value for name, value in matrices.items()}
            self._write(
                topic,
                "CameraInfo",
                None,
                stamp_ns,
                fields | {"binning_x": binning, "binning_y": binning, "roi": roi},
            )
        else:
            self._write(topic, "CameraCalibration", CameraCalibration, stamp_ns, fields | matrices)

    def _write(self, topic: str, name: str, protobuf: Any, stamp_ns: int, fields: dict[str, Any]) -> None:
        sec, nanosec = divmod(stamp_ns, 10**9)
        log_ns = stamp_ns if self._log_ns is None else self._log_ns
        if self._family == "ros2":
            if name not in self._ids:
                self._ids[name] = self.writer.register_msgdef(f"sensor_msgs/msg/{name}", ROS2[name] + HEADER)
            header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "camera"}
            self.writer.write_message(topic, self._ids[name], {"header": header, **fields}, log_time=log_ns)
        else:
            if topic not in self._ids:
                definition = build_file_descriptor_set(protobuf).SerializeToString()
                language = ("jsonschema", b"{}") if self._family == "json" else ("protobuf", definition)
                schema = self.writer.register_schema(f"foxglove.{name}", *language)
                self._ids[topic] = self.writer.register_channel(topic, self._family, schema)
            if self._family == "json":
                coded = {key: base64.b64encode(value).decode() for key, value in fields.items() if key == "data"}
                stamp = {"timestamp": {"sec": sec, "nsec": nanosec}}
                message = json.dumps({**stamp, "frame_id": "camera", **fields, **coded}).encode()
            else:
                stamped = protobuf(timestamp=Timestamp(seconds=sec, nanos=nanosec), **fields)
                message = stamped.SerializeToString()
            self.writer.add_message(self._ids[topic], log_ns, message, log_ns)


@contextmanager
def recorder(path: Path, family: Family = "ros2", **options: Any) -> Iterator[Recorder]:
    """Opens a recording; options are those of the library's writer (chunk size, compression)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        writer: Any = (Ros2Writer if family == "ros2" else Writer)(file, **options)
        if family != "ros2":
            writer.start()
        yield Recorder(family, writer)
        writer.finish()


def write_pairs(
    path: Path,
    pairs: Iterable[tuple[int, NDArray[np.uint8], NDArray[np.uint8], Camera, Camera]],
    family: Family = "ros2",
    pixels: Pixels = "raw",
    **options: Any,
) -> Path:
    """Records (stamp, left, right, left camera, right camera) under /stereo, calibrations with each image."""
    with recorder(path, family, **options) as record:
        for stamp_ns, left, right, left_camera, right_camera in pairs:
            for side, image, camera in (("left", left, left_camera), ("right", right, right_camera)):
                record.camera(f"/stereo/{side}/camera_info", stamp_ns, camera)
                record.picture(f"/stereo/{side}/image_raw", stamp_ns, image, pixels)
    return path
