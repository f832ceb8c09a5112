"""Single messages of cameras, as no writer at hand writes them."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest

from harness.sources.recordings.messages import MessageType, camera, picture, stamp_ns
from tests.recordings import CAMERA_INFO, HEADER, IMAGE
from vfoa.errors import VfoaError

IMAGE_TYPE = MessageType(
    message_encoding="cdr",
    schema_encoding="ros2msg",
    name="sensor_msgs/msg/Image",
    schema=(IMAGE + HEADER).encode(),
)
CAMERA_TYPE = MessageType(
    message_encoding="cdr",
    schema_encoding="ros2msg",
    name="sensor_msgs/msg/CameraInfo",
    schema=(CAMERA_INFO + HEADER).encode(),
)
SIZES = {"i": 4, "I": 4, "d": 8, "B": 1}


def cdr(order: str, *fields: tuple[str, Any]) -> bytes:
    """Fields by their struct letters, or text, in XCDR1: each aligned to its size after the four bytes of the head."""
    body = b""

    def put(letter: str, value: Any) -> None:
        nonlocal body
        body += bytes(-len(body) % SIZES[letter])
        body += struct.pack(f"{order}{letter}", value)

    for letter, value in fields:
        if letter == "s":
            put("I", len(value) + 1)
            body += value.encode() + b"\0"
        else:
            put(letter, value)
    return (b"\0\1\0\0" if order == "<" else b"\0\0\0\0") + body


def image(order: str, frame_id: str = "") -> bytes:
    pixels = [("B", value) for value in (1, 2, 255, 3, 4, 255)]
    head = [("i", 7), ("I", 9), ("s", frame_id)]
    return cdr(order, *head, ("I", 2), ("I", 2), ("s", "mono8"), ("B", 1), ("I", 3), ("I", 6), *pixels)


def camera_info(order: str) -> bytes:
    head = [("i", 7), ("I", 9), ("s", "x")]
    d, k, r = [0.1, 0.2, 0.0, 0.0], np.diag([90.0, 90, 1]).ravel(), np.eye(3).ravel()
    p = np.eye(3, 4).ravel()
    matrices = [("d", float(value)) for value in (*k, *r, *p)]
    tail = [("I", 0)] * 6 + [("B", 0)]
    lens = [("s", "plumb_bob"), ("I", 4), *(("d", value) for value in d)]
    return cdr(order, *head, ("I", 48), ("I", 64), *lens, *matrices, *tail)


@pytest.mark.parametrize("frame_id", ["", "a", "camera_left"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_both_byte_orders_of_cdr_are_read(order: str, frame_id: str) -> None:
    data = image(order, frame_id)
    assert stamp_ns(IMAGE_TYPE, data, "x") == 7_000_000_009
    found = picture(IMAGE_TYPE, data, "x")
    assert (found.size_px, found.step, found.form, found.frame_id) == ((2, 2), 3, "mono8", frame_id)
    assert found.is_bigendian
    assert found.data == bytes([1, 2, 255, 3, 4, 255])
    camera_ = camera(CAMERA_TYPE, camera_info(order), "x")
    assert camera_.size_px == (64, 48)
    assert camera_.d.tolist() == [0.1, 0.2, 0.0, 0.0]
    assert camera_.k[0, 0] == 90


@pytest.mark.parametrize("kind", ["0006", "0007", "0009", "000b", "0002", "0003"])
def test_another_encapsulation_is_refused_rather_than_misread(kind: str) -> None:
    data = bytes.fromhex(kind) + camera_info("<")[2:]
    with pytest.raises(VfoaError, match=rf"x: .*CameraInfo .*{kind}.*0000 or 0001"):
        camera(CAMERA_TYPE, data, "x")
