"""Messages of cameras in ROS 1, ROS 2 and of Foxglove in protobuf and JSON: types, decoding, contents."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, Literal

import mcap_protobuf.decoder
from mcap.records import Schema
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from harness.sources.calibration_files.documents import camera_of_ros, part_of_sensor
from harness.sources.recordings import orbbec, zed
from harness.sources.recordings.image_message import ImageMessage
from harness.sources.rectification import RawCamera, motion_of
from vfoa.errors import VfoaError, reported_as
from vfoa.geometry import rotation_of
from vfoa.types import Float

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
    "foxglove_msgs/msg/FrameTransform": "transforms",
    "foxglove_msgs/msg/FrameTransforms": "transforms",
    "ffmpeg_image_transport_msgs/msg/FFMPEGPacket": "video",
    "tf2_msgs/msg/TFMessage": "transforms",
    "realsense2_camera_msgs/msg/Extrinsics": "extrinsics",
}
_FOXGLOVE: dict[str, Kind] = {
    f"foxglove.{name.rpartition('/')[2]}": kind for name, kind in _ROS.items() if name.startswith("foxglove_msgs/")
}
_KINDS: dict[str, dict[str, Kind]] = {
    "cdr": _ROS,
    "ros1": _ROS,
    "protobuf": _FOXGLOVE,
    "json": _FOXGLOVE,
    zed.ENCODING: {zed.IMAGES: "compressed"},
    orbbec.ENCODING: {orbbec.IMAGE: "raw", orbbec.PROFILE: "calibration"},
}

_POSES = frozenset(
    {
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "geometry_msgs/msg/TransformStamped",
        "nav_msgs/msg/Odometry",
        "tf2_msgs/msg/TFMessage",
        "tf/msg/tfMessage",
    }
)

BY_NAME = "by name"
"""Schema encoding of a ROS 2 message without a definition in the recording: the standard definition is used."""

_SCHEMAS = {"cdr": ("ros2msg", "ros2idl", BY_NAME), "ros1": ("ros1msg", BY_NAME)}
_STANDARD = {"cdr": Stores.LATEST, "ros1": Stores.ROS1_NOETIC}


Codec = Literal["h264", "hevc", "vp9", "av1"]

_CODECS: dict[Codec, tuple[str, ...]] = {
    "h264": ("h264", "x264", "avc"),
    "hevc": ("h265", "hevc", "x265"),
    "vp9": ("vp9",),
    "av1": ("av1",),
}
"""Words in a packet's description, such as Foxglove's ``h265``, FFmpeg's ``libx264`` or ``hevc_nvenc;yuv420p``."""


def codec_of(form: str) -> Codec | None:
    """The codec of a video that a packet's description names; None for a picture."""
    return next((codec for codec, words in _CODECS.items() if any(word in form.lower() for word in words)), None)


Content = bytes | memoryview
"""What a message holds: bytes of its own, or a part of the chunk that it is in."""

READ = "messages of ROS 1, of ROS 2 (cdr), of Foxglove in protobuf or JSON, or of the ZED's SDK"
"""What is read, for errors."""


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
        return _KINDS.get(self.message_encoding, {}).get(self.name)

    @property
    def encoding(self) -> str:
        """The encodings of messages and schema, as an error lists them: ``flatbuffer (flatbuffer)``."""
        return f"{self.message_encoding} ({self.schema_encoding or 'no schema'})"

    @property
    def is_unread_image(self) -> bool:
        """Whether it carries images in an encoding that is not read, such as Foxglove's in FlatBuffers."""
        named = {kinds.get(name) for kinds in _KINDS.values() for name in (self.name, ros_name(self.name))}
        return self.kind is None and not IMAGES.isdisjoint(named)

    @property
    def is_pose(self) -> bool:
        """Whether it carries poses of bodies or of coordinate frames."""
        return self.name in _POSES and self.schema_encoding in _SCHEMAS.get(self.message_encoding, ())

    @property
    def is_ros(self) -> bool:
        """Whether its messages are ROS's, in either serialisation."""
        return self.message_encoding in _SCHEMAS

    @property
    def has_stamps(self) -> bool:
        """Whether its messages say when an image was taken; those of some SDKs are logged with that time."""
        return not self.is_zed and not self.is_orbbec

    @property
    def is_zed(self) -> bool:
        """Whether its messages are images of the ZED's SDK, which have both views."""
        return self.message_encoding == zed.ENCODING

    @property
    def is_orbbec(self) -> bool:
        """Whether its messages are images or calibrations of Orbbec's SDK."""
        return self.message_encoding == orbbec.ENCODING


def ros_name(name: str) -> str:
    """ROS 2's name of a type: ``sensor_msgs/Image`` becomes ``sensor_msgs/msg/Image``."""
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name


def message_type(message_encoding: str, schema_encoding: str, name: str, schema: bytes) -> MessageType:
    """Return the type of a topic's messages.

    A definition of ROS without a field (it is empty, or the type's name alone) counts as one that is not there; a
    language that is not stated is that of ROS's definitions. The ZED's SDK calls a type by its camera, too.
    """
    if message_encoding == zed.ENCODING:
        name = name.rpartition("/")[2]
    if message_encoding in _SCHEMAS:
        name = ros_name(name)
        if not _has_field(schema):
            schema_encoding, schema = BY_NAME, b""
        elif not schema_encoding:
            schema_encoding = _SCHEMAS[message_encoding][0]
    return MessageType(message_encoding=message_encoding, schema_encoding=schema_encoding, name=name, schema=schema)


def _has_field(definition: bytes) -> bool:
    """Whether a line of a definition has a type and a name."""
    lines = (line.partition(b"#")[0].split() for line in definition.splitlines())
    return any(len(words) > 1 and words[0] != b"MSG:" for words in lines)


_PLAIN_CDR = (b"\0\0", b"\0\1")
"""First bytes of a message in XCDR1: big-endian, little-endian (OMG DDS-XTypes 1.3, table 59)."""


def fields_of(kind: MessageType, data: Content, where: str) -> Callable[[str], Any]:
    """Decode a message; the returned function gives its fields by name, in the spelling of ROS 2.

    ROS 1 and Foxglove write the matrices of a calibration in capitals, some scripts in JSON as ROS 2.
    """
    # rosbags supports only XCDR1; it would misread the other encapsulations, whose alignment differs
    if kind.message_encoding == "cdr" and data[:2] not in _PLAIN_CDR:
        raise ValueError(f"encapsulation {data[:2].hex()}; expected 0000 or 0001 (plain CDR)")
    message = _decoder(kind)(data)

    def field(name: str) -> Any:
        for spelling in (name, name.upper()):
            if hasattr(message, spelling):
                return getattr(message, spelling)
        raise VfoaError(f"{where}: a {kind.name} without {name!r}")

    return field


def transforms_in(kind: MessageType, data: bytes, where: str) -> Iterator[tuple[str, str, Float]]:
    """Frames (parent, child) and parent_from_child (4, 4) of each transform in a message of ROS or Foxglove.

    Raises
    ------
    VfoaError
        If the message is not of its type.
    """
    with reading(kind, where):
        field = fields_of(kind, data, where)
        if kind.name.endswith("FrameTransform"):
            motion = motion_in(field("rotation"), field("translation"))
            yield str(field("parent_frame_id")), str(field("child_frame_id")), motion
            return
        for moved in field("transforms"):
            if _is_flat(kind):
                motion = motion_in(moved.rotation, moved.translation)
                yield str(moved.parent_frame_id), str(moved.child_frame_id), motion
            else:
                # tf's old names began with a slash
                parent, child = (str(n).removeprefix("/") for n in (moved.header.frame_id, moved.child_frame_id))
                yield parent, child, motion_in(moved.transform.rotation, moved.transform.translation)


def motion_in(rotation: Any, translation: Any) -> Float:
    """The motion (4, 4) of a message's quaternion and translation, metres."""
    return motion_of(
        rotation_of([float(getattr(rotation, axis)) for axis in "xyzw"]),
        [float(getattr(translation, axis)) for axis in "xyz"],
    )


def reading(kind: MessageType, where: str) -> AbstractContextManager[None]:
    """Turn every error in the block into one :class:`VfoaError`: the message does not match its topic's schema."""
    return reported_as(f"{where}: not a {kind.name} in {kind.message_encoding}")


@lru_cache(maxsize=64)
def _decoder(kind: MessageType) -> Callable[[Content], Any]:
    if kind.is_ros:
        return _ros_decoder(kind)
    if kind.message_encoding == "json":
        return _from_json
    schema = Schema(id=1, name=kind.name, encoding=kind.schema_encoding, data=kind.schema)
    decoder = mcap_protobuf.decoder.DecoderFactory().decoder_for(kind.message_encoding, schema)
    if decoder is None:
        raise ValueError(f"no decoder for a schema in {kind.schema_encoding!r}")
    return lambda data: decoder(bytes(data))


_OMITTED = {"timestamp": SimpleNamespace(sec=0, nsec=0), "frame_id": "", "format": "", "distortion_model": ""}
_OMITTED |= dict.fromkeys("DRP", ())
"""Values of fields that scripts leave out of messages in JSON: the same that protobuf has for them."""


def _from_json(data: Content) -> Any:
    """A message whose objects have their keys as attributes."""
    message = json.loads(bytes(data), object_hook=lambda fields: SimpleNamespace(**fields))
    return SimpleNamespace(**_OMITTED | vars(message))


def _ros_decoder(kind: MessageType) -> Callable[[Content], Any]:
    definitions, store = _definitions_of(kind), get_typestore(Stores.EMPTY)
    store.register({name: fields for name, fields in definitions.items() if name not in store.types})
    if kind.message_encoding == "cdr":
        return lambda data: store.deserialize_cdr(data, kind.name)

    def decode(data: Content) -> Any:
        with suppress(SerdeError):
            return store.deserialize_ros1(data, kind.name)
        return store.deserialize_ros1(data[:-_REALSENSE_BYTES], kind.name)

    return decode


_REALSENSE_BYTES = 4
"""RealSense's SDK appends the unit of depth to each image, which the definition in the file does not have."""


@lru_cache(maxsize=256)
def layout_of(kind: MessageType) -> str:
    """Text that two definitions of a type share if they lay out its messages alike, whatever their comments and blanks.

    Empty for messages that are not read, and for protobuf, whose fields have numbers; the definition itself if it
    cannot be parsed, which :func:`reading` reports.
    """
    if kind.kind is None or not kind.is_ros:
        return ""
    try:
        definitions = _definitions_of(kind)
    except Exception:  # of the parser, which has errors of its own
        return kind.schema.decode(errors="replace")
    return repr([(name, fields) for name, (_, fields) in definitions.items()])


def _definitions_of(kind: MessageType) -> Typesdict:
    """The definitions of a type of ROS and of those that it needs: the recording's own, else the standard ones."""
    text, own = kind.schema.decode(), Typesdict()
    if kind.schema_encoding != BY_NAME:
        is_idl = kind.schema_encoding == "ros2idl"
        own = get_types_from_idl(text) if is_idl else get_types_from_msg(text, kind.name)
    standard = get_typestore(_STANDARD[kind.message_encoding]).fielddefs
    needed, waiting = Typesdict(), [kind.name]
    for name in waiting:
        definition = own.get(name) or standard.get(name)
        if definition is None:
            raise ValueError(f"the recording has no definition of {name}; expected it in the schema of the topic")
        needed[name] = definition
        fields = definition[1]
        waiting += [other for _, description in fields for other in _named_types(description) if other not in waiting]
    return needed


def _named_types(description: Any) -> Iterator[str]:
    """The names of the types in the description of a field: its own, or that of its elements."""
    node, content = description
    if node == Nodetype.NAME:
        yield content
    elif node in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        yield from _named_types(content[0])


def stamp_ns(kind: MessageType, data: Content, where: str) -> int:
    """Time at which the picture was taken: the header's stamp, nanoseconds; 0 if it was not set.

    Raises
    ------
    VfoaError
        If the message is not of its type.
    """
    with reading(kind, where):
        field = fields_of(kind, data, where)
        return _nanoseconds(field("timestamp") if _is_flat(kind) else field("header").stamp)


_TIMES = (("sec", "nanosec"), ("seconds", "nanos"), ("sec", "nsec"))
"""Names of seconds and nanoseconds in ROS, protobuf and JSON, in which some write them by ROS's names."""


def _nanoseconds(stamp: Any) -> int:
    names = next((names for names in _TIMES if all(hasattr(stamp, name) for name in names)), None)
    values = (stamp,) if names is None else [getattr(stamp, name) for name in names]
    if names is None or any(value != int(value) for value in values):
        shown = ", ".join(map(repr, values))
        raise ValueError(f'found the time stamp {shown}; expected whole sec and nsec (or stamps = "log" in [source])')
    seconds, fraction_ns = map(int, values)
    return seconds * 10**9 + fraction_ns


def picture(kind: MessageType, data: Content, where: str) -> ImageMessage:
    """Return the content of an image's message, or of a packet of a video.

    Raises
    ------
    VfoaError
        If the message is not of its type.
    """
    with reading(kind, where):
        if kind.is_zed:
            return zed.image_of(bytes(data), where)
        if kind.is_orbbec:
            return orbbec.image_of(bytes(data))
        field = fields_of(kind, data, where)
        frame_id = str(field("frame_id") if _is_flat(kind) else field("header").frame_id)
        is_raw, is_ffmpeg = kind.kind == "raw", kind.name.startswith("ffmpeg_image_transport_msgs/")
        form = str(field("encoding" if is_raw or is_ffmpeg else "format"))
        return ImageMessage(
            form=_encoding(form) if is_raw else form,
            frame_id=frame_id.removeprefix("/"),  # tf's old names began with a slash
            data=_bytes(field("data")),
            size_px=(int(field("width")), int(field("height"))) if is_raw else None,
            step=int(field("step")) if is_raw else 0,
            is_bigendian=is_raw and not _is_flat(kind) and bool(field("is_bigendian")),
            is_key=bool(int(field("flags")) & 1) if is_ffmpeg else None,  # FFmpeg's AV_PKT_FLAG_KEY
        )


_SHORT = {**{name: f"{name}8" for name in ("rgb", "bgr", "rgba", "bgra", "mono")}, "z16": "16UC1"}
_OPENCV = re.compile(r"\d+[usf]c\d")


def _encoding(name: str) -> str:
    """An encoding as ROS spells it; scripts also write ``RGB8``, ``16uc1``, ``bgr``, or ``Z16`` after librealsense."""
    name = name.lower()
    return name.upper() if _OPENCV.fullmatch(name) else _SHORT.get(name, name)


def _bytes(data: Any) -> bytes:
    """The bytes of a field; in JSON they are base64, or numbers."""
    return base64.b64decode(data, validate=True) if isinstance(data, str) else bytes(data)


def camera(kind: MessageType, data: bytes, where: str) -> RawCamera:
    """Return the calibration of one camera.

    Raises
    ------
    VfoaError
        If the distortion model is unknown, or the matrices have another number of entries.
    """
    with reading(kind, where):
        if kind.is_orbbec:
            return orbbec.camera_of(data, where)
        field = fields_of(kind, data, where)
        size_px = int(field("width")), int(field("height"))
        values = {name: field(name.lower()) for name in "KDRP"}
        if _is_flat(kind):  # Foxglove has no zeros for what is not set, as ROS has
            values |= {name: [0.0] * count for name, count in (("R", 9), ("P", 12)) if not len(values[name])}
        camera = camera_of_ros(str(field("distortion_model")), size_px, values, where)
        if _is_flat(kind):
            return camera
        roi, binning = field("roi"), (int(field("binning_x")), int(field("binning_y")))
        corner_px, part_px = (int(roi.x_offset), int(roi.y_offset)), (int(roi.width), int(roi.height))
        return part_of_sensor(camera, binning, corner_px, part_px, where)


def _is_flat(kind: MessageType) -> bool:
    """Whether stamp and frame are fields of the message itself, as in Foxglove's types, and not of a header."""
    return not kind.is_ros or kind.name.startswith("foxglove_msgs/")
