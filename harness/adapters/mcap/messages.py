"""Messages of cameras, of three families: ROS 2 (CDR), Foxglove's in protobuf, Foxglove's in JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import mcap_protobuf.decoder
import mcap_ros2.decoder
import numpy as np
from mcap.records import Channel, Schema

from harness.adapters.rectification import MODELS, RawCamera
from vfoa.errors import VfoaError

Kind = Literal["raw", "compressed", "calibration"]

_KINDS: dict[tuple[str, str], Kind] = {
    ("cdr", "sensor_msgs/msg/Image"): "raw",
    ("cdr", "sensor_msgs/msg/CompressedImage"): "compressed",
    ("cdr", "sensor_msgs/msg/CameraInfo"): "calibration",
    ("protobuf", "foxglove.RawImage"): "raw",
    ("protobuf", "foxglove.CompressedImage"): "compressed",
    ("protobuf", "foxglove.CameraCalibration"): "calibration",
    ("json", "foxglove.RawImage"): "raw",
    ("json", "foxglove.CompressedImage"): "compressed",
    ("json", "foxglove.CameraCalibration"): "calibration",
}

_PLAIN_CDR = (b"\0\0", b"\0\1")
"""How a message in XCDR1 begins: big-endian, little-endian (OMG DDS-XTypes 1.3, table 59)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RawPicture:
    """Pixels as a driver sent them: ``step`` bytes a row, ``encoding`` as ROS and Foxglove name it."""

    width_px: int
    height_px: int
    encoding: str
    step: int
    is_bigendian: bool
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageType:
    """How a channel's messages are written, enough to decode them in another process."""

    message_encoding: str
    schema_encoding: str
    name: str
    schema: bytes

    @property
    def kind(self) -> Kind | None:
        """What a camera sends by it; None: something else, or a schema nobody here decodes (ROS 2's IDL)."""
        if self.message_encoding == "cdr" and self.schema_encoding != "ros2msg":
            return None
        return _KINDS.get((self.message_encoding, self.name))


def message_type(channel: Channel, schema: Schema | None) -> MessageType:
    """The type of a channel's messages; a channel may have no schema."""
    return MessageType(
        message_encoding=channel.message_encoding,
        schema_encoding="" if schema is None else schema.encoding,
        name="no schema" if schema is None else schema.name,
        schema=b"" if schema is None else schema.data,
    )


def stamp_ns(kind: MessageType, data: bytes, where: str) -> int:
    """When the picture was taken: the header's stamp, nanoseconds.

    Raises
    ------
    VfoaError
        If the message is not of its type, or an image's stamp was not set.
    """
    with _reading(kind, where):
        stamp = _stamp_ns(kind, _decode(kind, data))
    if stamp == 0 and kind.kind != "calibration":  # a calibration sent once may hold for all times
        raise VfoaError(
            f"{where}: a {kind.name} without time stamp; expected one, left and right are joined by it "
            '(stamps = "log" in [source] joins them by the time of recording)'
        )
    return stamp


def picture(kind: MessageType, data: bytes, where: str) -> RawPicture | bytes:
    """The pixels of a raw image, or the bytes of a compressed one.

    Raises
    ------
    VfoaError
        If the message is not of its type.
    """
    with _reading(kind, where):
        field = _fields(kind, data, where)
        if kind.kind == "compressed":
            return bytes(field("data"))
        return RawPicture(
            width_px=int(field("width")),
            height_px=int(field("height")),
            encoding=str(field("encoding")),
            step=int(field("step")),
            is_bigendian=kind.message_encoding == "cdr" and bool(field("is_bigendian")),
            data=bytes(field("data")),
        )


def camera(kind: MessageType, data: bytes, where: str) -> RawCamera:
    """The calibration of one camera.

    Raises
    ------
    VfoaError
        If the distortion model is unknown, or the matrices have another number of entries.
    """
    with _reading(kind, where):
        field = _fields(kind, data, where)
        model = str(field("distortion_model"))
        if model not in MODELS:
            known = ", ".join(filter(None, MODELS))
            raise VfoaError(f"{where}: distortion model {model!r}; expected one of {known}")
        if kind.message_encoding == "cdr":
            _check_full_size(field, where)
        names = ("k", "d", "r", "p") if kind.message_encoding == "cdr" else ("K", "D", "R", "P")
        k, d, r, p = (np.array(field(name), dtype=np.float64).reshape(-1) for name in names)
        if (k.size, r.size, p.size) != (9, 9, 12):
            raise VfoaError(f"{where}: found {k.size}, {r.size}, {p.size} numbers in K, R, P; expected 9, 9, 12")
        return RawCamera(
            size_px=(int(field("width")), int(field("height"))),
            k=k.reshape(3, 3),
            d=d,
            r=r.reshape(3, 3),
            p=p.reshape(3, 4),
            model=MODELS[model],
        )


def _check_full_size(field: Callable[[str], Any], where: str) -> None:
    """ROS's calibration is of the whole sensor; what binning or a region of interest makes of it is not done here."""
    roi, binning = field("roi"), (int(field("binning_x")), int(field("binning_y")))
    if max(binning) > 1 or int(roi.x_offset) or int(roi.y_offset):
        raise VfoaError(
            f"{where}: binning {binning}, region of interest from ({roi.x_offset}, {roi.y_offset}); "
            "expected the whole image, or calibration = (a file) in [source]"
        )


def _stamp_ns(kind: MessageType, message: Any) -> int:
    """0 where a message in JSON has none, as one that was not set in the others."""
    if kind.message_encoding == "cdr":
        return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)
    if kind.message_encoding == "json":
        time = message.get("timestamp", {})
        return int(time.get("sec", 0)) * 10**9 + int(time.get("nsec", 0))
    return int(message.timestamp.seconds) * 10**9 + int(message.timestamp.nanos)


def _fields(kind: MessageType, data: bytes, where: str) -> Callable[[str], Any]:
    message = _decode(kind, data)
    if kind.message_encoding != "json":
        return lambda name: getattr(message, name)

    def field(name: str) -> Any:
        if name not in message:
            raise VfoaError(f"{where}: a {kind.name} without {name!r}; found {', '.join(message)}")
        return base64.b64decode(message[name], validate=True) if name == "data" else message[name]

    return field


@contextmanager
def _reading(kind: MessageType, where: str) -> Iterator[None]:
    """Whatever goes wrong in the block: the message is not what its channel says."""
    try:
        yield
    except VfoaError:
        raise
    except Exception as error:  # of three decoders, and of fields that are missing or of another kind
        text = (str(error) or type(error).__name__).splitlines()[0]
        raise VfoaError(f"{where}: not a {kind.name} in {kind.message_encoding}: {text}") from None


def _decode(kind: MessageType, data: bytes) -> Any:
    # The decoder knows XCDR1 alone, and takes the other encapsulations, whose alignment differs, for it.
    if kind.message_encoding == "cdr" and data[:2] not in _PLAIN_CDR:
        raise ValueError(f"encapsulation {data[:2].hex()}; expected 0000 or 0001 (plain CDR)")
    return _decoder(kind)(data)


@lru_cache(maxsize=64)
def _decoder(kind: MessageType) -> Callable[[bytes], Any]:
    if kind.message_encoding == "json":
        return json.loads
    module = mcap_ros2.decoder if kind.message_encoding == "cdr" else mcap_protobuf.decoder
    schema = Schema(id=1, name=kind.name, encoding=kind.schema_encoding, data=kind.schema)
    decoder = module.DecoderFactory().decoder_for(kind.message_encoding, schema)
    if decoder is None:
        raise ValueError(f"no decoder for a schema in {kind.schema_encoding!r}")
    return decoder
