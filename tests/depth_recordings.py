"""Recordings of a depth camera, written by other libraries: rosbags (.bag, .db3, MCAP) and Foxglove's SDK."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import av
import cv2
import foxglove
import numpy as np
from foxglove.channels import CameraCalibrationChannel, CompressedVideoChannel, RawImageChannel
from foxglove.messages import CameraCalibration, CompressedVideo, RawImage, Timestamp
from numpy.typing import NDArray
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from harness.record.images import open_without_real_time

Format = Literal["bag", "bag bz2", "bag lz4", "db3", "mcap", "db3 zstd file", "db3 zstd message"]
FORMATS: tuple[Format, ...] = ("bag", "db3", "mcap")
DepthForm = Literal["raw", "64FC1", "png", "rvl", "32FC1", "32FC1 png", "32FC1 rvl"]

COLOUR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
INFO = "/camera/color/camera_info"
PACKET = """std_msgs/Header header
int32 width
int32 height
string encoding
uint64 pts
uint8 flags
bool is_bigendian
uint8[] data"""
EXTRINSICS = "std_msgs/Header header\nfloat64[9] rotation\nfloat64[3] translation"


@dataclass(frozen=True, kw_only=True)
class Lens:
    """A camera's calibration message."""

    width: int
    height: int
    fx: float
    cx: float
    cy: float
    d: Sequence[float] = ()


class Messages:
    """Writes messages of cameras into one bag or recording of rosbags, whatever its format."""

    def __init__(self, writer: Any, *, is_ros1: bool) -> None:
        self._writer, self._is_ros1 = writer, is_ros1
        self._store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
        self._store.register(get_types_from_msg(PACKET, "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"))
        self._store.register(get_types_from_msg(EXTRINSICS, "realsense2_camera_msgs/msg/Extrinsics"))
        if is_ros1:
            transforms = "geometry_msgs/TransformStamped[] transforms"
            self._store.register(get_types_from_msg(transforms, "tf2_msgs/msg/TFMessage"))
        self._connections: dict[tuple[str, str], Any] = {}

    def image(
        self, topic: str, stamp_ns: int, pixels: NDArray[Any], encoding: str, frame: str = "optical", log_ns: int = 0
    ) -> None:
        self.write(
            topic,
            "sensor_msgs/msg/Image",
            log_ns or stamp_ns,
            header=self.header(stamp_ns, frame),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=pixels.nbytes // pixels.shape[0],
            data=np.frombuffer(pixels.tobytes(), np.uint8),
        )

    def compressed(self, topic: str, stamp_ns: int, form: str, data: bytes, frame: str = "optical") -> None:
        header = self.header(stamp_ns, frame)
        content = np.frombuffer(data, np.uint8)
        self.write(topic, "sensor_msgs/msg/CompressedImage", stamp_ns, header=header, format=form, data=content)

    def packet(self, topic: str, stamp_ns: int, encoding: str, data: bytes, *, is_key: bool, log_ns: int) -> None:
        self.write(
            topic,
            "ffmpeg_image_transport_msgs/msg/FFMPEGPacket",
            log_ns,
            header=self.header(stamp_ns, "optical"),
            width=0,
            height=0,
            encoding=encoding,
            pts=0,
            flags=int(is_key),
            is_bigendian=False,
            data=np.frombuffer(data, np.uint8),
        )

    def camera(self, topic: str, stamp_ns: int, lens: Lens, frame: str = "optical") -> None:
        k = np.array([lens.fx, 0, lens.cx, 0, lens.fx, lens.cy, 0, 0, 1.0])
        p = np.insert(k.reshape(3, 3), 3, 0.0, axis=1).ravel()
        matrices = {"d": np.array(lens.d, np.float64), "k": k, "r": np.eye(3).ravel(), "p": p}
        roi = self._store.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        self.write(
            topic,
            "sensor_msgs/msg/CameraInfo",
            stamp_ns,
            header=self.header(stamp_ns, frame),
            height=lens.height,
            width=lens.width,
            distortion_model="plumb_bob",
            **{name.upper() if self._is_ros1 else name: value for name, value in matrices.items()},
            binning_x=0,
            binning_y=0,
            roi=roi,
        )

    def transform(
        self,
        topic: str,
        stamp_ns: int,
        parent: str,
        child: str,
        translation: Sequence[float],
        quaternion: Sequence[float],
    ) -> None:
        fields = self._moved(stamp_ns, parent, child, translation, quaternion)
        stamped = self._store.types["geometry_msgs/msg/TransformStamped"](**fields)
        self.write(topic, "tf2_msgs/msg/TFMessage", stamp_ns, transforms=[stamped])

    def moved(
        self,
        topic: str,
        stamp_ns: int,
        parent: str,
        child: str,
        translation: Sequence[float],
        quaternion: Sequence[float],
    ) -> None:
        """One transform on a topic of its own."""
        fields = self._moved(stamp_ns, parent, child, translation, quaternion)
        self.write(topic, "geometry_msgs/msg/TransformStamped", stamp_ns, **fields)

    def _moved(
        self, stamp_ns: int, parent: str, child: str, translation: Sequence[float], quaternion: Sequence[float]
    ) -> dict[str, Any]:
        types = self._store.types
        moved = types["geometry_msgs/msg/Transform"](
            translation=types["geometry_msgs/msg/Vector3"](*map(float, translation)),
            rotation=types["geometry_msgs/msg/Quaternion"](*map(float, quaternion)),
        )
        return {"header": self.header(stamp_ns, parent), "child_frame_id": child, "transform": moved}

    def pose(
        self,
        topic: str,
        stamp_ns: int,
        frame: str,
        position: Sequence[float],
        quaternion: Sequence[float],
        log_ns: int = 0,
        kind: Literal["PoseStamped", "PoseWithCovarianceStamped", "Odometry"] = "PoseStamped",
    ) -> None:
        types = self._store.types
        pose = types["geometry_msgs/msg/Pose"](
            position=types["geometry_msgs/msg/Point"](*map(float, position)),
            orientation=types["geometry_msgs/msg/Quaternion"](*map(float, quaternion)),
        )
        fields: dict[str, Any] = {"header": self.header(stamp_ns, frame), "pose": pose}
        if kind != "PoseStamped":
            fields["pose"] = types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=np.zeros(36))
        if kind == "Odometry":
            still = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
            twist = types["geometry_msgs/msg/Twist"](linear=still, angular=still)
            fields["twist"] = types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36))
            fields["child_frame_id"] = "base_link"
        package = "nav_msgs" if kind == "Odometry" else "geometry_msgs"
        self.write(topic, f"{package}/msg/{kind}", log_ns or stamp_ns, **fields)

    def extrinsics(
        self, topic: str, stamp_ns: int, rotation: NDArray[np.float64], translation: Sequence[float]
    ) -> None:
        self.write(
            topic,
            "realsense2_camera_msgs/msg/Extrinsics",
            stamp_ns,
            header=self.header(stamp_ns, ""),
            rotation=rotation.T.ravel().copy(),
            translation=np.array(translation, np.float64),
        )

    def header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self._store.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
        sequence = {"seq": 0} if self._is_ros1 else {}
        return self._store.types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id=frame)

    def advertise(self, topic: str, kind: str) -> None:
        """List a topic, whether or not a message follows."""
        if (topic, kind) not in self._connections:
            self._connections[topic, kind] = self._writer.add_connection(topic, kind, typestore=self._store)

    def write(self, topic: str, kind: str, log_ns: int, **fields: Any) -> None:
        self.advertise(topic, kind)
        message = self._store.types[kind](**fields)
        serialize = self._store.serialize_ros1 if self._is_ros1 else self._store.serialize_cdr
        self._writer.write(self._connections[topic, kind], log_ns, serialize(message, kind))


@contextmanager
def messages(folder: Path, kind: Format, name: str = "take") -> Iterator[tuple[Path, Messages]]:
    """A new recording in a folder: its path, and what writes into it."""
    if kind.startswith("bag"):
        path = folder / f"{name}.bag"
        ros1_bag = BagWriter(path)
        if kind != "bag":
            ros1_bag.set_compression(BagWriter.CompressionFormat[kind.removeprefix("bag ").upper()])
        with ros1_bag as writer:
            yield path, Messages(writer, is_ros1=True)
        return
    path = folder / f"{name}_{kind.replace(' ', '_')}"
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    bag = Bag2Writer(path, version=9, storage_plugin=plugin)
    if "zstd" in kind:
        mode = CompressionMode.FILE if kind.endswith("file") else CompressionMode.MESSAGE
        bag.set_compression(mode, CompressionFormat.ZSTD)
    with bag as writer:
        yield path, Messages(writer, is_ros1=False)


@dataclass(frozen=True, kw_only=True)
class Shot:
    """One frame of a depth camera: colour (H, W, 3) RGB, depth (H, W) uint16 millimetres."""

    stamp_ns: int
    colour: NDArray[np.uint8]
    depth_mm: NDArray[np.uint16]
    lens: Lens


def write_take(folder: Path, kind: Format, shots: Iterable[Shot], depth: DepthForm = "raw", name: str = "take") -> Path:
    """Colour and aligned depth under RealSense's names, calibrations with each image."""
    with messages(folder, kind, name) as (path, write):
        for shot in shots:
            write.camera(INFO, shot.stamp_ns, shot.lens)
            write.image(COLOUR, shot.stamp_ns, shot.colour, "rgb8")
            write_depth(write, shot, depth)
    return path


def write_depth(write: Messages, shot: Shot, form: DepthForm) -> None:
    metres = shot.depth_mm.astype(np.float32) / 1000
    if form == "raw":
        write.image(DEPTH, shot.stamp_ns, shot.depth_mm, "16UC1")
    elif form in ("32FC1", "64FC1"):
        known = np.where(metres > 0, metres, np.float32(np.nan))
        write.image(DEPTH, shot.stamp_ns, known.astype(np.float64) if form == "64FC1" else known, form)
    else:
        form_text, data = compressed_depth(shot.depth_mm, form)
        write.compressed(f"{DEPTH}/compressedDepth", shot.stamp_ns, form_text, data)


def compressed_depth(depth_mm: NDArray[np.uint16], form: DepthForm) -> tuple[str, bytes]:
    """The message's format and data as ROS's compressed_depth_image_transport writes them."""
    transport = form.rpartition(" ")[2]
    coded = _rvl if transport == "rvl" else _png
    if not form.startswith("32FC1"):
        return f"16UC1; compressedDepth {transport}", struct.pack("<iff", 0, 0, 0) + coded(depth_mm)
    # 32FC1: inverse depth in 16 bits, as the transport quantises it up to 10 m
    a = 100.0 * (100.0 + 1)
    b = 1 - a / 10.0
    metres = depth_mm.astype(np.float64) / 1000
    with np.errstate(divide="ignore"):
        counts = np.where((metres > 0) & (metres < 10.0), np.floor(a / metres + b), 0)
    return f"32FC1; compressedDepth {transport}", struct.pack("<iff", 0, a, b) + coded(
        np.clip(counts, 0, 65535).astype(np.uint16)
    )


def _rvl(counts: NDArray[np.uint16]) -> bytes:
    """Wilson's CompressRVL after the size, number by number."""
    nibbles: list[int] = []

    def put(number: int) -> None:
        while number > 7:
            nibbles.append(number & 7 | 8)
            number >>= 3
        nibbles.append(number)

    values, before = counts.ravel().tolist(), 0
    while values:
        zeros = next((n for n, value in enumerate(values) if value), len(values))
        count = next((n for n, value in enumerate(values[zeros:]) if not value), len(values) - zeros)
        put(zeros)
        put(count)
        for value in values[zeros : zeros + count]:
            step, before = value - before, value
            put(2 * step if step >= 0 else -2 * step - 1)
        values = values[zeros + count :]
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{nibble:x}" for nibble in nibbles[at : at + 8]), 16) for at in range(0, len(nibbles), 8)]
    return struct.pack(f"<II{len(words)}I", counts.shape[1], counts.shape[0], *words)


def _png(counts: NDArray[np.uint16]) -> bytes:
    done, coded = cv2.imencode(".png", counts)
    assert done
    return coded.tobytes()


Coder = Literal["libx264", "libx265", "libvpx-vp9", "libsvtav1"]


@dataclass
class Encoder:
    """Encodes images into packets, one per image, in the order of their numbers."""

    coder: Coder
    width: int
    height: int
    options: dict[str, str] = field(default_factory=dict)
    gop: int = 10

    def packets(self, images: Sequence[NDArray[np.uint8]]) -> list[tuple[int, bytes, bool]]:
        """(number of the image, data, whether it is a key frame) in the order of decoding."""
        context: Any = av.CodecContext.create(self.coder, "w")
        context.width, context.height, context.pix_fmt = self.width, self.height, "yuv420p"
        context.time_base, context.framerate, context.gop_size = Fraction(1, 25), Fraction(25), self.gop
        context.options = self.options
        open_without_real_time(context)
        found: list[Any] = []
        for number, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts = number
            found += context.encode(frame)
        found += context.encode(None)
        return [(packet.pts, bytes(packet), packet.is_keyframe) for packet in found]


CODERS: dict[str, tuple[Coder, dict[str, str]]] = {
    "h264": ("libx264", {"preset": "ultrafast", "tune": "zerolatency", "crf": "12"}),
    "h265": ("libx265", {"preset": "ultrafast", "x265-params": "log-level=error:bframes=0:crf=12", "crf": "12"}),
    "vp9": ("libvpx-vp9", {"deadline": "realtime", "lag-in-frames": "0", "crf": "15", "b": "0", "cpu-used": "8"}),
    "av1": ("libsvtav1", {"preset": "6", "crf": "2", "svtav1-params": "pred-struct=2:lookahead=0:lp=1:aq-mode=0"}),
}
"""Coders by Foxglove's names, with options for little delay and high quality. AV1 without delay can wait for ever."""


def write_video_take(path: Path, codec: str, packets: Sequence[tuple[int, bytes, bool]], shots: Sequence[Shot]) -> Path:
    """Colour as packets of a video and aligned depth, by Foxglove's SDK (protobuf), under Azure Kinect's names."""
    context = foxglove.Context()
    with foxglove.open_mcap(path, context=context):
        video = CompressedVideoChannel("/rgb/video", context=context)
        raw = RawImageChannel("/depth_to_rgb/image", context=context)
        info = CameraCalibrationChannel("/rgb/calibration", context=context)
        for number, data, _ in packets:
            shot = shots[number]
            lens, stamp_ns = shot.lens, shot.stamp_ns
            seconds, nanoseconds = divmod(stamp_ns, 10**9)
            head: dict[str, Any] = {"timestamp": Timestamp(sec=seconds, nsec=nanoseconds), "frame_id": "rgb"}
            size = {"width": lens.width, "height": lens.height}
            k = [lens.fx, 0, lens.cx, 0, lens.fx, lens.cy, 0, 0, 1]
            r, p = [1.0, 0, 0, 0, 1, 0, 0, 0, 1], [0.0] * 12
            info.log(CameraCalibration(**head, **size, K=k, R=r, P=p), log_time=stamp_ns)
            video.log(CompressedVideo(**head, data=data, format=codec), log_time=stamp_ns)
            pixels = {"encoding": "16UC1", "step": 2 * lens.width, "data": shot.depth_mm.tobytes()}
            raw.log(RawImage(**head, **size, **pixels), log_time=stamp_ns)
    return path
