"""Depth in messages: raw, as PNG, and as the ``compressedDepth`` of ROS's image transport."""

from __future__ import annotations

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from harness.sources.media.depth_maps import default_counts_per_m, depth_map
from harness.sources.media.images import MOST_PIXELS, decode
from harness.sources.recordings.message_types import MessageType
from harness.sources.recordings.messages import CompressedPicture, RawPicture, Sight, picture
from harness.sources.recordings.rvl import decode_rvl
from vfoa.errors import VfoaError
from vfoa.types import Map

_RAW = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
_HEADER = struct.Struct("<iff")  # format, A, B: compressed_depth_image_transport, compression_common.h
_SIZE = struct.Struct("<II")  # columns and rows before a stream of RVL
_NO_DEPTH = ("infra", "/ir", "confidence", "amplitude", "thermal", "disparity")


def may_be_depth(name: str, said: Sight | None) -> bool:
    """Whether a topic's name, and the description of its first image, fit a depth image."""
    lower = name.lower()
    if said is None or any(word in lower for word in _NO_DEPTH):
        return False
    is_named = "depth" in lower
    return (
        said.form in ("16UC1", "32FC1") or (said.form == "mono16" and is_named) or _is_compressed(said.form, is_named)
    )


def _is_compressed(form: str, is_named: bool) -> bool:
    # A "png" image whose topic is named after depth is depth; a "jpeg" can only be a picture of depth.
    return "compressedDepth" in form or (is_named and "png" in form.lower() and "8" not in form)


def read_depth(kind: MessageType, data: bytes, counts_per_m: float | None, where: str) -> Map:
    """Read the depth (H, W) in metres from a message.

    ``counts_per_m`` is the sensor's unit; None: integers are millimetres, floating point numbers metres.

    Raises
    ------
    VfoaError
        If the message is not of its type, or its image is damaged or of another encoding.
    """
    content = picture(kind, data, where)
    counts = _raw(content, where) if isinstance(content, RawPicture) else _compressed(content, where)
    return depth_map(counts, counts_per_m or default_counts_per_m(counts))


def _raw(raw: RawPicture, where: str) -> NDArray[Any]:
    if raw.encoding not in _RAW:
        raise VfoaError(f"{where}: a depth image in {raw.encoding!r}; expected one of: {', '.join(_RAW)}")
    sample = np.dtype(_RAW[raw.encoding]).newbyteorder(">" if raw.is_bigendian else "<")
    row_bytes = raw.width_px * sample.itemsize
    if min(raw.width_px, raw.height_px) <= 0 or raw.step < row_bytes or len(raw.data) < raw.step * raw.height_px:
        raise VfoaError(
            f"{where}: {raw.width_px} x {raw.height_px} pixels of {raw.encoding} in {len(raw.data)} bytes, "
            f"{raw.step} a row; expected at least {row_bytes} a row"
        )
    rows = np.frombuffer(raw.data, np.uint8, raw.step * raw.height_px).reshape(raw.height_px, raw.step)
    return np.ascontiguousarray(rows[:, :row_bytes]).view(sample)


def _compressed(content: CompressedPicture, where: str) -> NDArray[Any]:
    encoding, _, transport = (part.strip() for part in content.form.partition(";"))
    if "compressedDepth" not in content.form:
        return _png(content.data, where)
    if len(content.data) < _HEADER.size:
        raise VfoaError(f"{where}: compressedDepth of {len(content.data)} bytes; expected a header of {_HEADER.size}")
    _, a, b = _HEADER.unpack_from(content.data)
    body = content.data[_HEADER.size :]
    counts = _rvl(body, where) if "rvl" in transport.lower() else _png(body, where)
    if encoding != "32FC1":
        return counts
    with np.errstate(
        divide="ignore", over="ignore", invalid="ignore"
    ):  # quantised inverse depth: z = A / (v - B), 0 is unknown
        return np.where(counts > 0, np.float32(a) / (counts.astype(np.float32) - np.float32(b)), np.float32(0))


def _rvl(body: bytes, where: str) -> NDArray[np.uint16]:
    if len(body) < _SIZE.size:
        raise VfoaError(f"{where}: compressedDepth rvl without a size; expected columns and rows before the stream")
    columns, rows = _SIZE.unpack_from(body)
    if not 0 < columns * rows <= MOST_PIXELS:
        raise VfoaError(f"{where}: compressedDepth rvl of {columns} x {rows} pixels in {len(body)} bytes")
    try:
        return decode_rvl(body[_SIZE.size :], columns, rows)
    except ValueError as error:
        raise VfoaError(f"{where}: compressedDepth rvl: {error}") from None


def _png(body: bytes, where: str) -> NDArray[Any]:
    image = decode(body, f"{where}: a compressed depth image", cv2.IMREAD_UNCHANGED)
    if image.ndim != 2 or image.dtype != np.uint16:
        found = f"{image.dtype.name} with shape {image.shape}"
        raise VfoaError(f"{where}: a compressed depth image: found {found}; expected one channel of 16 bits in PNG")
    return image
