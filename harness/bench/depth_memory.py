"""Peak memory of reading colour and measured depth from a recording, by its length and container."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import av
import numpy as np
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from harness.bench.mcap_memory import peak_mib
from harness.processes import spawning
from harness.report.formats import Table
from harness.sources.recordings.clip import RecordingClip
from harness.sources.recordings.topics import RecordingSettings

Form = Literal["bag", "db3", "mcap", "mcap, H.264"]
FORMS: tuple[Form, ...] = ("bag", "db3", "mcap", "mcap, H.264")
SHORT, LONG = 500, 5000

_WIDTH, _HEIGHT, _STEP_NS = 96, 64, 33_333_333
_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
_PACKET_TEXT = """std_msgs/Header header
int32 width
int32 height
string encoding
uint64 pts
uint8 flags
bool is_bigendian
uint8[] data"""


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthPeak:
    """Peaks in MiB of fresh processes that read all frames of a short and of a long recording."""

    form: Form
    short_frames: int
    long_frames: int
    short_mib: float
    long_mib: float


def measure_depth_memory(form: Form, short: int = SHORT, long: int = LONG) -> DepthPeak:
    """Write two recordings of colour and depth, and read each in a fresh process."""
    peaks = [_measure(form, frames) for frames in (short, long)]
    return DepthPeak(form=form, short_frames=short, long_frames=long, short_mib=peaks[0], long_mib=peaks[1])


def depth_memory_table(rows: list[DepthPeak]) -> Table:
    """One row per container."""
    first = rows[0]
    return Table(
        title="Peak memory while colour and measured depth are read, MiB",
        columns=("recording", f"{first.short_frames} frames", f"{first.long_frames} frames", "ratio"),
        rows=tuple(
            (row.form, f"{row.short_mib:.0f}", f"{row.long_mib:.0f}", f"{row.long_mib / row.short_mib:.3f}")
            for row in rows
        ),
        words=1,
        notes=(f"{_WIDTH} x {_HEIGHT} pixels, a calibration with each frame, each recording in a fresh process.",),
    )


def _measure(form: Form, frames: int) -> float:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("take.bag" if form == "bag" else "take")
        _write(path, form, frames)
        with spawning().Pool(1) as pool:
            return pool.apply(_read_all, (path,))


def _read_all(path: Path) -> float:
    clip = RecordingClip(RecordingSettings(recording=path.name), path.parent)
    for number in clip.frames:
        clip.frame(number)
    return peak_mib()


def _write(path: Path, form: Form, frames: int) -> None:
    """Write colour, raw or as H.264, with its calibration and aligned depth, by rosbags."""
    is_ros1 = form == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_PACKET_TEXT, _PACKET))
    plugin = StoragePlugin.SQLITE3 if form == "db3" else StoragePlugin.MCAP
    writer: Any = BagWriter(path) if is_ros1 else Bag2Writer(path, version=9, storage_plugin=plugin)
    coder = _Coder() if form == "mcap, H.264" else None
    with writer:
        connections: dict[str, Any] = {}
        for number in range(frames):
            for topic, kind, fields in _messages(number, store, is_ros1=is_ros1, coder=coder):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                message = store.types[kind](**fields)
                data = store.serialize_ros1(message, kind) if is_ros1 else store.serialize_cdr(message, kind)
                writer.write(connections[topic], (number + 1) * _STEP_NS, data)


def _messages(number: int, store: Any, *, is_ros1: bool, coder: _Coder | None) -> list[tuple[str, str, dict[str, Any]]]:
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](*divmod((number + 1) * _STEP_NS, 10**9))
    sequence = {"seq": number} if is_ros1 else {}
    header = types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="optical")
    k = np.array([80.0, 0, _WIDTH / 2, 0, 80.0, _HEIGHT / 2, 0, 0, 1])
    matrices = {"d": np.zeros(0), "k": k, "r": np.eye(3).ravel(), "p": np.insert(k.reshape(3, 3), 3, 0, 1).ravel()}
    named = {name.upper() if is_ros1 else name: value for name, value in matrices.items()}
    roi = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    size = {"height": _HEIGHT, "width": _WIDTH}
    binning = {"binning_x": 0, "binning_y": 0, "roi": roi}
    colour = np.full((_HEIGHT, _WIDTH, 3), number % 251, np.uint8)
    depth = np.full((_HEIGHT, _WIDTH), 1000 + number % 1000, np.uint16)
    return [
        (
            "/camera/color/camera_info",
            "sensor_msgs/msg/CameraInfo",
            {"header": header, **size, "distortion_model": "plumb_bob", **named, **binning},
        ),
        _colour(header, colour) if coder is None else _packet(header, coder.code(number, colour)),
        ("/camera/aligned_depth_to_color/image_raw", "sensor_msgs/msg/Image", _image(header, depth, "16UC1")),
    ]


def _colour(header: Any, pixels: np.ndarray) -> tuple[str, str, dict[str, Any]]:
    return "/camera/color/image_raw", "sensor_msgs/msg/Image", _image(header, pixels, "rgb8")


def _packet(header: Any, packet: Any) -> tuple[str, str, dict[str, Any]]:
    data = {"data": np.frombuffer(bytes(packet), np.uint8), "flags": int(packet.is_keyframe), "pts": packet.pts}
    said = {"header": header, "width": _WIDTH, "height": _HEIGHT, "encoding": "h264", "is_bigendian": False}
    return "/camera/color/image_raw/ffmpeg", _PACKET, said | data


def _image(header: Any, pixels: np.ndarray, encoding: str) -> dict[str, Any]:
    return {
        "header": header,
        "height": _HEIGHT,
        "width": _WIDTH,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": pixels.nbytes // _HEIGHT,
        "data": pixels.view(np.uint8).ravel(),
    }


class _Coder:
    """H.264 that gives a packet for each image at once."""

    def __init__(self) -> None:
        context: Any = av.CodecContext.create("libx264", "w")
        context.width, context.height, context.pix_fmt = _WIDTH, _HEIGHT, "yuv420p"
        context.time_base, context.gop_size = Fraction(1, 30), 30
        context.options = {"preset": "ultrafast", "tune": "zerolatency"}
        self._context = context

    def code(self, number: int, pixels: np.ndarray) -> Any:
        frame = av.VideoFrame.from_ndarray(pixels, format="rgb24")
        frame.pts = number
        (packet,) = self._context.encode(frame)
        return packet
