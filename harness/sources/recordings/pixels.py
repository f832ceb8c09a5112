"""Images and depth maps in messages, raw and compressed."""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from harness.sources.media.images import collect_greatest, decode, decode_rgb, is_collecting
from harness.sources.media.maps import default_counts_per_m, depth_map
from harness.sources.recordings.image_message import ImageMessage
from harness.sources.recordings.messages import MessageType, codec_of, picture
from harness.sources.recordings.rvl import decode_rvl
from vfoa.errors import VfoaError, check_known
from vfoa.types import Image, Map

# encoding -> bytes of one sample, samples of one pixel, OpenCV's conversion (None: RGB already)
_ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    **{
        f"{name}{8 * sample_bytes}{channels}": (sample_bytes, samples, conversion)
        for name, channels, samples, conversion in (
            ("rgb", "", 3, None),
            ("bgr", "", 3, cv2.COLOR_BGR2RGB),
            ("rgba", "", 4, cv2.COLOR_RGBA2RGB),
            ("bgra", "", 4, cv2.COLOR_BGRA2RGB),
            ("mono", "", 1, cv2.COLOR_GRAY2RGB),
            ("", "UC1", 1, cv2.COLOR_GRAY2RGB),  # OpenCV's types, whose colours are BGR
            ("", "UC3", 3, cv2.COLOR_BGR2RGB),
            ("", "UC4", 4, cv2.COLOR_BGRA2RGB),
        )
        for sample_bytes in (1, 2)
    },
    "yuv422": (1, 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (1, 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (1, 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (1, 2, cv2.COLOR_YUV2RGB_YUY2),
    **{
        f"bayer_{order}{8 * sample_bytes}": (sample_bytes, 1, getattr(cv2, f"COLOR_Bayer{order.upper()}2RGB"))
        for order in ("rggb", "bggr", "gbrg", "grbg")
        for sample_bytes in (1, 2)
    },
}
_SEMIPLANAR = {"nv12": cv2.COLOR_YUV2RGB_NV12, "nv21": cv2.COLOR_YUV2RGB_NV21}
"""YUV 4:2:0: all of the luma, then the interleaved colours of two by two pixels, in half as many rows."""


def read_image(kind: MessageType, data: bytes, where: str) -> Image:
    """Return the picture (H, W, 3) uint8 RGB in a message.

    Raises
    ------
    VfoaError
        If the message is not of its type, its picture is damaged, or for the reasons of :func:`rgb`.
    """
    content = picture(kind, data, where)
    if content.size_px is None and codec_of(content.form) is not None:
        raise VfoaError(
            f"{where}: a packet of a video ({content.form}) on a topic that began with a picture; expected one of them"
        )
    return _decoded(content, where) if content.size_px is None else rgb(content, where)


_MOSAIC = re.compile(r"(bayer_[rgb]{4})(?:8|16); *\w+ compressed *(?:bayer_\w+)?")
"""Format of a compressed mosaic: compressed_image_transport keeps it, and names the encoding before and after."""


def _decoded(content: ImageMessage, where: str) -> Image:
    """The picture (H, W, 3) uint8 RGB of a compressed one; the colours of a mosaic that was compressed as gray."""
    if (mosaic := _MOSAIC.fullmatch(content.form)) is None:
        return decode_rgb(content.data, where)
    samples = decode(content.data, where, cv2.IMREAD_UNCHANGED)
    if samples.ndim != 2:
        return decode_rgb(content.data, where)
    form, size_px = f"{mosaic[1]}{8 * samples.itemsize}", (samples.shape[1], samples.shape[0])
    data = samples.astype(samples.dtype.newbyteorder("<")).tobytes()
    return rgb(replace(content, form=form, size_px=size_px, step=len(data) // len(samples), data=data), where)


def rgb(raw: ImageMessage, where: str) -> Image:
    """Return the picture (H, W, 3) uint8 RGB. Gray is repeated, alpha dropped, 16 bits are cut to 8; YUV is BT.601.

    Raises
    ------
    VfoaError
        If the encoding is unknown, the data are too short for the size, or YUV has an odd width (or height, if two rows
        share their colours).
    """
    check_known(raw.form, (*_ENCODINGS, *_SEMIPLANAR), f"{where}: encoding")
    if raw.form in _SEMIPLANAR:
        return _of_planes(raw, where)
    sample_bytes, samples, conversion = _ENCODINGS[raw.form]
    rows = _rows(raw, samples * sample_bytes, where)
    height, width = len(rows), rows.shape[1] // (samples * sample_bytes)
    if samples == 2 and width % 2:  # two pixels share their colour
        raise VfoaError(f"{where}: {width} x {height} pixels of {raw.form}; expected an even width")
    if sample_bytes == 2:
        if is_collecting():
            samples_16 = np.ascontiguousarray(rows).view(">u2" if raw.is_bigendian else "<u2")
            collect_greatest(samples_16.astype(np.uint16))
        rows = rows[:, 0 if raw.is_bigendian else 1 :: 2]
    pixels = np.ascontiguousarray(rows).reshape(height, width, samples)
    return pixels if conversion is None else np.asarray(cv2.cvtColor(pixels, conversion), dtype=np.uint8)


def _of_planes(raw: ImageMessage, where: str) -> Image:
    width, height = raw.size_px or (0, 0)
    if width % 2 or height % 2:
        raise VfoaError(f"{where}: {width} x {height} pixels of {raw.form}; expected an even width and height")
    planes = np.ascontiguousarray(_rows(raw, 1, where, height * 3 // 2))
    return np.asarray(cv2.cvtColor(planes, _SEMIPLANAR[raw.form]), dtype=np.uint8)


def _rows(raw: ImageMessage, pixel_bytes: int, where: str, count: int | None = None) -> NDArray[np.uint8]:
    """The bytes of the pixels (count, W pixel_bytes), without what fills the rows; ``count`` is H if not given."""
    width, height = raw.size_px or (0, 0)
    row_bytes, count = width * pixel_bytes, height if count is None else count
    if min(width, height) <= 0 or raw.step < row_bytes or len(raw.data) < raw.step * count:
        raise VfoaError(
            f"{where}: {width} x {height} pixels of {raw.form} in {len(raw.data)} bytes, {raw.step} per row; expected "
            f"at least {row_bytes} per row, {count} rows"
        )
    return np.frombuffer(raw.data, np.uint8, raw.step * count).reshape(count, raw.step)[:, :row_bytes]


DEPTH_FORMS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4", "64FC1": "f8"}
"""The encodings of raw depth, and their samples."""

_HEADER = struct.Struct("<iff")  # format, A, B: compressed_depth_image_transport, compression_common.h
_PNG = b"\x89PNG\r\n\x1a\n"
INFRARED = "infra|[/_]ir(?![a-z])"
"""Names of topics in infrared, in lower case, as a pattern; a robot may be called iRobot."""
_NO_DEPTH = re.compile(f"{INFRARED}|confidence|amplitude|thermal|disparity")


def may_be_depth(name: str, header: ImageMessage | None) -> bool:
    """Whether a topic's name, and the header of its first image, fit a depth image."""
    name = name.lower()
    if header is None or _NO_DEPTH.search(name):
        return False
    form = header.form
    if form in ("16UC1", "32FC1", "64FC1") or "compressedDepth" in form:
        return True
    # Under a name of depth, "png" images are depth, too; a "jpeg" can only be a picture of depth.
    return "depth" in name and (form == "mono16" or ("png" in form.lower() and "8" not in form))


def read_depth(kind: MessageType, data: bytes, counts_per_m: float | None, where: str) -> Map:
    """Read the depth (H, W) in metres from a message.

    ``counts_per_m`` is the sensor's unit; None: integers are millimetres, floating point numbers metres.

    Raises
    ------
    VfoaError
        If the message is not of its type, or its image is damaged or of another encoding.
    """
    content = picture(kind, data, where)
    counts = _compressed_depth(content, where) if content.size_px is None else _raw_depth(content, where)
    return depth_map(counts, counts_per_m or default_counts_per_m(counts))


def _raw_depth(raw: ImageMessage, where: str) -> NDArray[Any]:
    if raw.form not in DEPTH_FORMS:
        raise VfoaError(f"{where}: a depth image in {raw.form!r}; expected one of: {', '.join(DEPTH_FORMS)}")
    sample = np.dtype(DEPTH_FORMS[raw.form]).newbyteorder(">" if raw.is_bigendian else "<")
    return np.ascontiguousarray(_rows(raw, sample.itemsize, where)).view(sample)


def _compressed_depth(content: ImageMessage, where: str) -> NDArray[Any]:
    if "compressedDepth" not in content.form:
        return _png(content.data, where)
    encoding, _, transport = (part.strip() for part in content.form.partition(";"))
    is_quantised = encoding.upper() == "32FC1"
    if content.data.startswith(_PNG) and not is_quantised:  # of a script; only quantised depth needs the header
        return _png(content.data, where)
    if len(content.data) < _HEADER.size:
        raise VfoaError(f"{where}: compressedDepth of {len(content.data)} bytes; expected a header of {_HEADER.size}")
    _, a, b = _HEADER.unpack_from(content.data)
    read = decode_rvl if "rvl" in transport.lower() else _png
    counts = read(content.data[_HEADER.size :], where)
    if not is_quantised:
        return counts
    # quantised inverse depth: z = A / (v - B), 0 is unknown
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        return np.where(counts > 0, np.float32(a) / (counts.astype(np.float32) - np.float32(b)), np.float32(0))


def _png(body: bytes, where: str) -> NDArray[Any]:
    image = decode(body, f"{where}: a compressed depth image", cv2.IMREAD_UNCHANGED)
    if image.ndim != 2 or image.dtype != np.uint16:
        kind = f"{image.dtype.name} with shape {image.shape}"
        raise VfoaError(f"{where}: a compressed depth image: found {kind}; expected one channel of 16 bits in PNG")
    return image
