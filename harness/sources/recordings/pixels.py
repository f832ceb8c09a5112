"""Convert camera images, compressed or raw in the encodings of ROS and Foxglove, to RGB."""

from __future__ import annotations

import cv2
import numpy as np

from harness.sources.media.images import decode_rgb
from harness.sources.recordings.message_types import MessageType
from harness.sources.recordings.messages import CompressedPicture, RawPicture, picture
from vfoa.errors import VfoaError, did_you_mean
from vfoa.types import Image

# encoding -> bytes of one sample, samples of one pixel, OpenCV's conversion (None: RGB already)
_ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    "rgb8": (1, 3, None),
    "bgr8": (1, 3, cv2.COLOR_BGR2RGB),
    "8UC3": (1, 3, cv2.COLOR_BGR2RGB),
    "rgba8": (1, 4, cv2.COLOR_RGBA2RGB),
    "bgra8": (1, 4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, 1, cv2.COLOR_GRAY2RGB),
    "8UC1": (1, 1, cv2.COLOR_GRAY2RGB),
    "mono16": (2, 1, cv2.COLOR_GRAY2RGB),
    "yuv422": (1, 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (1, 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (1, 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (1, 2, cv2.COLOR_YUV2RGB_YUY2),
    "bayer_rggb8": (1, 1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr8": (1, 1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg8": (1, 1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg8": (1, 1, cv2.COLOR_BayerGRBG2RGB),
    "bayer_rggb16": (2, 1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr16": (2, 1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg16": (2, 1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg16": (2, 1, cv2.COLOR_BayerGRBG2RGB),
}


def read_image(kind: MessageType, data: bytes, where: str) -> Image:
    """Return the picture (H, W, 3) uint8 RGB in a message.

    Raises
    ------
    VfoaError
        If the message is not of its type, its picture is damaged, or for the reasons of :func:`rgb`.
    """
    content = picture(kind, data, where)
    return decode_rgb(content.data, where) if isinstance(content, CompressedPicture) else rgb(content, where)


def rgb(raw: RawPicture, where: str) -> Image:
    """Return the picture (H, W, 3) uint8 RGB. Gray is repeated, alpha dropped, 16 bits are cut to 8; YUV is BT.601.

    Raises
    ------
    VfoaError
        If the encoding is unknown, the data are too short for the size, or YUV has an odd width.
    """
    if raw.encoding not in _ENCODINGS:
        raise VfoaError(f"{where}: encoding {raw.encoding!r}; {did_you_mean(raw.encoding, _ENCODINGS)}")
    sample_bytes, samples, conversion = _ENCODINGS[raw.encoding]
    row_bytes = raw.width_px * samples * sample_bytes
    if raw.width_px <= 0 or raw.height_px <= 0 or raw.step < row_bytes or len(raw.data) < raw.step * raw.height_px:
        raise VfoaError(
            f"{where}: {raw.width_px} x {raw.height_px} pixels of {raw.encoding} in {len(raw.data)} bytes, "
            f"{raw.step} a row; expected at least {row_bytes} a row"
        )
    if samples == 2 and raw.width_px % 2:  # two pixels share their colour
        raise VfoaError(f"{where}: {raw.width_px} x {raw.height_px} pixels of {raw.encoding}; expected an even width")
    rows = np.frombuffer(raw.data, np.uint8, raw.step * raw.height_px).reshape(raw.height_px, raw.step)[:, :row_bytes]
    if sample_bytes == 2:
        rows = rows[:, 0 if raw.is_bigendian else 1 :: 2]
    pixels = np.ascontiguousarray(rows).reshape(raw.height_px, raw.width_px, samples)
    return pixels if conversion is None else np.asarray(cv2.cvtColor(pixels, conversion), dtype=np.uint8)
