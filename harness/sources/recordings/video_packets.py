"""Packets of compressed videos: their codec, and whether a decoder can begin with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

from harness.sources.recordings.message_types import MessageType
from harness.sources.recordings.messages import CompressedPicture, picture
from vfoa.errors import VfoaError

Codec = Literal["h264", "hevc", "vp9", "av1"]

_NAMES: dict[str, Codec] = {
    "h264": "h264",
    "x264": "h264",
    "avc": "h264",
    "h265": "hevc",
    "hevc": "hevc",
    "x265": "hevc",
}
_NAMES |= {"vp9": "vp9", "av1": "av1"}


def codec_of(form: str, where: str) -> Codec:
    """The codec that a packet names: Foxglove's ``h265``, FFmpeg's ``libx264`` or ``hevc_nvenc;yuv420p``.

    Raises
    ------
    VfoaError
        If it is another one.
    """
    for name, codec in _NAMES.items():
        if name in form.lower():
            return codec
    raise VfoaError(f"{where}: a video in {form!r}; expected h264, h265, vp9 or av1")


def begins_video(kind: MessageType, data: bytes, where: str) -> bool:
    """Whether a decoder can begin with this packet.

    Raises
    ------
    VfoaError
        If the message is no packet, or its codec is not supported.
    """
    packet = picture(kind, data, where)
    if not isinstance(packet, CompressedPicture):
        raise VfoaError(f"{where}: expected packets of a video")
    codec = codec_of(packet.form, where)
    return _BEGINS[codec](packet.data) if packet.is_key is None else packet.is_key


def _h264_begins(data: bytes) -> bool:
    """An IDR slice (type 5) or the parameters before it (7); ITU-T H.264, table 7-1."""
    return any(header & 31 in (5, 7) for header in _nal_headers(data))


def _hevc_begins(data: bytes) -> bool:
    """A random access picture (16 to 21) or the parameters before it (32, 33); ITU-T H.265, table 7-1."""
    return any(header >> 1 & 63 in (16, 17, 18, 19, 20, 21, 32, 33) for header in _nal_headers(data))


def _nal_headers(data: bytes) -> Iterator[int]:
    """The first byte of each unit of a byte stream (annex B)."""
    at = data.find(b"\0\0\1")
    while 0 <= at < len(data) - 3:
        yield data[at + 3]
        at = data.find(b"\0\0\1", at + 3)


def _vp9_begins(data: bytes) -> bool:
    """The frame type in the uncompressed header; VP9 bitstream specification 6.2."""
    if not data or data[0] >> 6 != 2:
        return False
    profile = (data[0] >> 5 & 1) | (data[0] >> 4 & 1) << 1
    shift = 2 if profile == 3 else 3  # profile 3 has a reserved bit before show_existing_frame
    return data[0] >> shift & 1 == 0 and data[0] >> (shift - 1) & 1 == 0


def _av1_begins(data: bytes) -> bool:
    """A sequence header among the units of the packet; AV1 specification 5.3."""
    at = 0
    while at < len(data):
        header = data[at]
        if header >> 3 & 15 == 1:
            return True
        if not header >> 1 & 1:  # without a size: the last unit
            return False
        at += 2 if header >> 2 & 1 else 1
        size, at = _leb128(data, at)
        at += size
    return False


def _leb128(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for place, byte in enumerate(data[at : at + 8]):
        value |= (byte & 127) << 7 * place
        if not byte & 128:
            return value, at + place + 1
    return value, len(data)


_BEGINS: dict[Codec, Callable[[bytes], bool]] = {
    "h264": _h264_begins,
    "hevc": _hevc_begins,
    "vp9": _vp9_begins,
    "av1": _av1_begins,
}
