"""Recordings as Orbbec's SDK writes them: its messages, whose definitions in the file are of another layout."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rosbags.rosbag1 import Writer

Layout = Literal["content", "metadata first"]
"""What comes after the size of a row: the content; or the size of the metadata, and both as one array."""

DEFINITION = "Header header\nuint32 height\nuint64_t number"
METADATA = b"\1\2\3\4\5"


@dataclass(frozen=True, kw_only=True)
class Profile:
    """A stream's calibration; ``d`` are k1 to k6, p1, p2."""

    size_px: tuple[int, int]
    fx: float
    cx: float
    cy: float
    d: tuple[float, ...] = (0.0,) * 8
    model: int = 4
    rotation: Sequence[float] = (0.0,) * 9
    translation_mm: tuple[float, ...] = (0.0,) * 3

    def message(self) -> bytes:
        focal = self.fx, self.fx, self.cx, self.cy
        head = struct.pack("<BB9f3f", 2, 5, *self.rotation, *self.translation_mm)
        return _header(0) + head + struct.pack("<3H4f8fB", *self.size_px, 30, *focal, *self.d, self.model)


def image(layout: Layout, size_px: tuple[int, int], encoding: str, step: int, content: bytes) -> bytes:
    width, height = size_px
    head = _header(7) + struct.pack("<II", height, width) + _text(encoding) + struct.pack("<BI", 0, step)
    times = struct.pack("<4Q", 1, 2, 3, 4)
    if layout == "metadata first":
        return head + struct.pack("<II", len(METADATA), len(METADATA) + len(content)) + METADATA + content + times
    end = struct.pack("<f", 0.0) + times + struct.pack("<I", len(METADATA)) + METADATA + struct.pack("<I", 5)
    return head + struct.pack("<I", len(content)) + content + end


def write_sdk_bag(path: Path, images: Sequence[tuple[int, int, bytes]], profiles: dict[int, Profile]) -> Path:
    """Images are (log time in ns, number of the sensor, message); profiles are by the number of the stream."""
    with Writer(path) as writer:
        topics = {
            sensor: writer.add_connection(
                f"/cam/sensor_{sensor}/frameType_{sensor}", "sensor_msgs/msg/Image", msgdef=DEFINITION, md5sum="0" * 32
            )
            for sensor in sorted({sensor for _, sensor, _ in images})
        }
        for log_ns, sensor, message in images:
            writer.write(topics[sensor], log_ns, message)
        for stream, profile in profiles.items():
            topic = writer.add_connection(
                f"/cam/streamProfileType_{stream}",
                "custom_msg/msg/OBStreamProfileInfo",
                msgdef="Header header",
                md5sum="1" * 32,
            )
            writer.write(topic, images[0][0], profile.message())
    return path


def _header(seq: int) -> bytes:
    return struct.pack("<III", seq, 1738, 500) + _text("")


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()
