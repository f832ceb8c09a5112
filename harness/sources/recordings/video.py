"""Videos whose packets are messages: frames in any order, each decoded from the preceding key frame."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator
from threading import Lock
from typing import Any, Literal

import av
import numpy as np

from harness.sources.media.images import MOST_PIXELS
from harness.sources.recordings.messages import CompressedPicture, MessageType, picture
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError
from vfoa.types import Image

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


_WAITING = 16
"""Most decoded frames that wait until they are requested: more than any codec holds back to reorder."""


_LATEST = 64
"""Most packets between a frame's own packet and the frame's appearance."""


class VideoDecoder:
    """Decodes the packets of one topic. Its memory does not grow with the video.

    The codec gets a packet's place in the order of writing as its time stamp, and returns it with the frame made from
    the packet. This identifies frames even if they come out in another order than their packets.

    Parameters
    ----------
    topic
        With all its packets.
    read
        Reads the message at a place.
    where
        The recording, for error messages.
    """

    def __init__(self, topic: Topic, read: Callable[[Topic, Place], bytes], where: str) -> None:
        self._topic, self._read, self._where = topic, read, f"{where}: {topic.name}"
        self._number = {place: number for number, (place, _) in enumerate(topic.packets)}
        self._keys = [number for number, (_, is_key) in enumerate(topic.packets) if is_key]
        self._reset()
        self._lock = Lock()

    def __getstate__(self) -> dict[str, Any]:
        return {
            "topic": self._topic,
            "read": self._read,
            "where": self._where,
            "number": self._number,
            "keys": self._keys,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._topic, self._read, self._where = state["topic"], state["read"], state["where"]
        self._number, self._keys, self._lock = state["number"], state["keys"], Lock()
        self._reset()

    @property
    def notes(self) -> tuple[str, ...]:
        """A note if packets may be missing: all codecs but H.265 silently decode on without them.

        A step of more than 1.5 times the median may be a lost packet, or an image that the camera dropped before it was
        coded, which does no harm: the stream alone cannot tell.
        """
        order = sorted((place.stamp_ns, number) for number, (place, _) in enumerate(self._topic.packets))
        steps = np.diff([stamp for stamp, _ in order])
        if steps.size == 0:
            return ()
        late = [order[at + 1][1] for at in np.flatnonzero(steps > 1.5 * np.median(steps))]
        gaps = [number for number in late if not self._topic.packets[number][1]]
        if not gaps:
            return ()
        doubtful = {each for number in gaps for each in range(number, self._next_key(number))}
        count = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
        return (
            f"{self._topic.name}: {count} in time before packets that need the ones before them; if packets were lost "
            f"there, the {len(doubtful)} images up to the next key frames are damaged",
        )

    def image(self, place: Place) -> Image:
        """Return the frame (H, W, 3) uint8 RGB of the packet at this place.

        Raises
        ------
        VfoaError
            If no key frame precedes it, or a packet between that and this one is damaged.
        """
        with self._lock:
            number = self._number[place]
            if number not in self._frames:
                self._move_to(number)
            while number not in self._frames:
                self._step()
                if number not in self._frames and self._is_lost(number):
                    self._reset()
                    raise VfoaError(
                        f"{self._where}: packet {number + 1} gives no frame: it is damaged, or one before it is lost"
                    )
            return self._frames[number]

    def _reset(self) -> None:
        self._codec: Any = None
        self._fed = -1
        self._pending: set[int] = set()
        self._frames: dict[int, Image] = {}

    def _move_to(self, number: int) -> None:
        """Prepare the decoder to reach this frame: continue, or restart at the preceding key frame."""
        at = bisect.bisect_right(self._keys, number) - 1
        if at < 0:
            raise VfoaError(
                f"{self._where}: the video begins without a key frame: packet {number + 1} cannot be decoded; expected "
                + (f"start_s in [source] after packet {self._keys[0] + 1}" if self._keys else "a key frame")
            )
        key = self._keys[at]
        comes = number in self._pending or number > self._fed
        if self._codec is None or not comes or key > self._fed + 1:
            self._reset()
            self._fed = key - 1

    def _next_key(self, number: int) -> int:
        """The first packet after this one at which a decoder can begin; the end if there is none."""
        at = bisect.bisect_right(self._keys, number)
        return self._keys[at] if at < len(self._keys) else len(self._topic.packets)

    def _is_lost(self, number: int) -> bool:
        """Whether the decoder is past this packet and will not return its frame any more."""
        return (
            self._codec is None or (number <= self._fed and number not in self._pending) or self._fed > number + _LATEST
        )

    def _step(self) -> None:
        """Feed one packet or, after the last one, flush the codec."""
        number = self._fed + 1
        is_end = number >= len(self._topic.packets)
        try:
            frames = self._codec.decode(None) if is_end else self._feed(number)
        except av.FFmpegError as error:
            self._reset()
            problem = f"packet {number + 1} is damaged, or larger than {MOST_PIXELS} pixels: {error.strerror}"
            raise VfoaError(f"{self._where}: {problem}") from None
        for frame in frames:
            self._keep(frame)
        if is_end:
            self._codec, self._fed = None, -1
            self._pending.clear()

    def _feed(self, number: int) -> list[Any]:
        place, _ = self._topic.packets[number]
        content = picture(self._topic.type, self._read(self._topic, place), self._where)
        assert isinstance(content, CompressedPicture)
        if not content.data:  # the codec would take an empty packet for the end
            self._reset()
            raise VfoaError(f"{self._where}: packet {number + 1} is empty")
        if self._codec is None:
            codec = codec_of(content.form, self._where)
            # FFmpeg's own av1 needs a graphics card
            self._codec = av.CodecContext.create("libdav1d" if codec == "av1" else codec, "r")
            self._codec.thread_count = 1  # threads would each hold a frame back
            self._codec.options = {"max_pixels": str(MOST_PIXELS)}  # a packet of 100 kB can claim gigabytes
        packet = av.Packet(content.data)
        packet.pts = packet.dts = number
        self._fed = number
        self._pending.add(number)
        return list(self._codec.decode(packet))

    def _keep(self, frame: Any) -> None:
        self._pending.discard(frame.pts)
        if frame.is_corrupt:
            return
        self._frames[frame.pts] = np.asarray(frame.to_ndarray(format="rgb24"), dtype=np.uint8)
        while len(self._frames) > _WAITING:
            self._frames.pop(next(iter(self._frames)))
