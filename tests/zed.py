"""Recordings in the layout of the ZED's SDK, as others found it in files of a ZED 2i and a ZED X."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

SERIAL = 38486288
START_NS, STEP_NS = 1_738_434_526_000_000_007, 40_000_000
OTHER_CLOCK_NS = 5_145_757_361_000


def stamp(number: int) -> int:
    return START_NS + number * STEP_NS


def strips(image: NDArray[np.uint8], count: int = 4) -> bytes:
    """YUYV as gray JPEG, one below the other."""
    yuyv = cv2.cvtColor(image, cv2.COLOR_RGB2YUV_YUY2).reshape(len(image), -1)
    coded = [cv2.imencode(".jpg", part, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes() for part in np.split(yuyv, count)]
    return struct.pack(f"<{count}Q", *map(len, coded)) + b"".join(coded)


def message(content: bytes) -> bytes:
    return struct.pack("<II", len(content) + 60, len(content)) + content + bytes(56)


def write_svo2(path: Path, messages: Sequence[bytes], *, cameras: Sequence[int] = (SERIAL,)) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 16)
        writer.start(library="libmcap stereolabs")
        note = writer.register_schema("sl_type", "jsonschema", b"{}")
        for name in ("svo_header", "svo_footer"):
            channel = writer.register_channel(name, "json", note)
            writer.add_message(channel, OTHER_CLOCK_NS, json.dumps({"version": "2.0.5"}).encode(), OTHER_CLOCK_NS)
        for serial in cameras:
            topic = f"Camera_SN{serial}/side_by_side"
            channel = writer.register_channel(
                topic, "zed_sdk_encoded", writer.register_schema(topic, "zed_sdk_encoded", b"")
            )
            sensors = writer.register_channel(f"Camera_SN{serial}/sensors", "json", note)
            for number, data in enumerate(messages):
                writer.add_message(channel, stamp(number), data, stamp(number))
                writer.add_message(sensors, stamp(number) + 5, b'{"data": ""}', stamp(number) + 5)
        writer.finish()
    return path
