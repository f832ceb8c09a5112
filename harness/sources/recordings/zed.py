"""Recordings of the ZED's SDK (``.svo2``), which are MCAP.

svo_header, svo_footer              JSON: the camera, and the times of all messages; both are logged by another clock
Camera_SN38486288/side_by_side      images of both views, not rectified, logged at the times when they were taken
Camera_SN38486288/sensors           JSON: the IMU

An image's message is two sizes (32 bits: of all that follows, and of the content), the content, and 56 bytes about the
frame. The content is a packet of H.264 or H.265, or strips: the sizes of all (64 bits each), then each strip as a gray
JPEG, whose pixels are the bytes of YUYV.

Stereolabs has not published the format. This is what others found in files of a ZED 2i and a ZED X:
https://radarml.github.io/open-svo2/format and https://nes.is-a.dev/out/2025/svo2.html.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable

import cv2
import numpy as np

from harness.sources.media.images import decode
from harness.sources.recordings.image_message import ImageMessage

ENCODING = "zed_sdk_encoded"
IMAGES = "side_by_side"

_TOPIC = re.compile(rf"Camera_SN(\d+)/{IMAGES}")
_NOTES = ("svo_header", "svo_footer")
_SIZES = struct.Struct("<II")
_START_CODE = re.compile(rb"\x00{2,3}\x01")
_JPEG = b"\xff\xd8\xff"
_HEVC_UNITS = frozenset({0, 1, *range(16, 22), *range(32, 36), 39, 40})
"""Types of units with which a packet of H.265 begins: slices, parameter sets, delimiters, notes (ITU-T H.265)."""


def serials(topics: Iterable[str]) -> list[str]:
    """Return the serial number of each camera whose images a recording has, by the names of its topics."""
    return [found[1] for name in topics if (found := _TOPIC.fullmatch(name))]


def is_of_another_clock(topic: str) -> bool:
    """Whether the log times of a topic are not on the clock of the images."""
    return topic in _NOTES


def image_of(data: bytes, where: str) -> ImageMessage:
    """Return the image in a message: a packet of h264 or h265, or pixels in yuyv.

    Raises
    ------
    VfoaError
        If a strip is damaged.
    ValueError
        If the message is of another layout.
    """
    _, size = _SIZES.unpack_from(data)
    content = data[_SIZES.size : _SIZES.size + size]
    if len(content) < size:
        raise ValueError(f"{len(content)} bytes of content; expected {size}")
    if start := _START_CODE.match(content):
        return ImageMessage(form=_codec(content[start.end() :]), data=content)
    pixels = np.vstack(_strips(data[_SIZES.size :], where))
    height, step = pixels.shape
    return ImageMessage(form="yuyv", data=pixels.tobytes(), size_px=(step // 2, height), step=step)


def _codec(unit: bytes) -> str:
    """H.264 or H.265, by the two bytes with which the first unit begins: in H.265 the second one is 1."""
    is_hevc = unit[1:2] == b"\1" and not unit[0] & 0x81 and unit[0] >> 1 in _HEVC_UNITS
    return "h265" if is_hevc else "h264"


def _strips(content: bytes, where: str) -> list[np.ndarray]:
    """The strips (H, 2 W) uint8 from top to bottom: their sizes, as many as there are strips, come first."""
    at = content.find(_JPEG)
    if at <= 0 or at % 8:
        raise ValueError("neither a packet of H.264 or H.265 nor strips in JPEG; expected one of them")
    strips = []
    for number, size in enumerate(struct.unpack_from(f"<{at // 8}Q", content), 1):
        strips.append(decode(content[at : at + size], f"{where}: strip {number}", cv2.IMREAD_GRAYSCALE))
        at += size
    return strips
