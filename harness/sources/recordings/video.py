"""Videos whose packets are messages: frames in any order, each decoded from the preceding key frame."""

from __future__ import annotations

import bisect
from collections.abc import Callable
from threading import Lock
from typing import Any

import av
import numpy as np

from harness.sources.media.film import DECODING, RgbConverter
from harness.sources.media.images import MOST_PIXELS
from harness.sources.recordings.messages import Content, MessageType, codec_of, picture
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError
from vfoa.types import Image


def begins_video(kind: MessageType, data: Content, where: str) -> bool:
    """Whether a decoder can begin with this packet.

    Raises
    ------
    VfoaError
        If the message cannot be decoded, or its codec is not supported.
    """
    packet = picture(kind, data, where)
    decoder = _decoder(packet.form, where)
    if packet.is_key is not None or not packet.data:
        return bool(packet.is_key)
    return any(parsed.is_keyframe for parsed in [*decoder.parse(packet.data), *decoder.parse(b"")])


def _decoder(form: str, where: str) -> Any:
    """A decoder of the codec that a packet names."""
    if (codec := codec_of(form)) is None:
        raise VfoaError(f"{where}: found a video in {form!r}; expected h264, h265, vp9 or av1")
    return av.CodecContext.create("libdav1d" if codec == "av1" else codec, "r")  # FFmpeg's av1 needs a graphics card


_GAP_STEPS = 1.75
"""Least steps (median) between the stamps of two images of which one in between may be lost."""


MOST_REORDERED = 16
"""Most decoded frames that wait until they are requested: more than any codec holds back to reorder."""


_LATEST = 64
"""Most packets between a frame's own packet and the frame's appearance."""

_MOST_STARTS = 3
"""Key frames before a frame from which decoding is tried. A coder that refreshes its images part by part (x264's
intra-refresh) has none after the first: a decoder may begin where a refresh does, and gives frames once that is done,
within two refreshes."""


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
        return {name: self.__dict__[name] for name in ("_topic", "_read", "_where", "_number", "_keys")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lock = Lock()
        self._reset()

    def image(self, place: Place) -> Image:
        """Return the frame (H, W, 3) uint8 RGB of the packet at this place.

        Raises
        ------
        VfoaError
            If no key frame precedes it, or a packet between that and this one is damaged.
        """
        with self._lock:
            number = self._number[place]
            before = bisect.bisect_right(self._keys, number)
            if not before:
                raise VfoaError(
                    f"{self._where}: the video begins without a key frame: packet {number + 1} cannot be decoded; "
                    "expected "
                    + (f"start_s in [source] after packet {self._keys[0] + 1}" if self._keys else "a key frame")
                )
            for key in reversed(self._keys[max(before - _MOST_STARTS, 0) : before]):
                if self._decodes(number, key):
                    return self._frames[number]
            raise VfoaError(
                f"{self._where}: packet {number + 1} gives no frame: it is damaged, or one before it is lost"
            )

    def notes(self) -> list[str]:
        """A note on the images that follow a gap of the video's stamps, without a key frame between.

        If a packet was lost there (over a network, or in a damaged part of the file), most decoders give images all the
        same, which are wrong up to the next key frame.
        """
        packets, topic = sorted(self._topic.packets), self._topic
        if len(packets) < 2 or not topic.type.has_stamps:  # an SDK loses images, but no packets
            return []
        steps_ns = np.diff([place.stamp_ns for place, _ in packets])
        are_gaps = (steps_ns > _GAP_STEPS * np.median(steps_ns)).tolist()
        is_doubtful, doubtful = False, set[Place]()
        for is_gap, (place, is_key) in zip(are_gaps, packets[1:], strict=True):
            is_doubtful = not is_key and (is_doubtful or is_gap)
            if is_doubtful:
                doubtful.add(place)
        if not (count := len(doubtful.intersection(topic.places))):
            return []
        return [
            f"{topic.name}: {count} of {len(topic.places)} images follow a gap of the video's stamps without a key "
            "frame between: they are damaged if packets were lost there"
        ]

    def _reset(self) -> None:
        self._codec: Any = None
        self._rgb = RgbConverter()
        self._fed = -1
        self._pending: set[int] = set()
        self._frames: dict[int, Image] = {}

    def _decodes(self, number: int, key: int) -> bool:
        """Whether the decoder gives this frame, continued or begun at this key frame."""
        if number not in self._frames:
            self._move_to(number, key)
        while number not in self._frames:
            self._step()
            if number not in self._frames and self._is_lost(number):
                self._reset()
                return False
        return True

    def _move_to(self, number: int, key: int) -> None:
        """Prepare the decoder to reach this frame: continue, or restart at the key frame."""
        comes = number in self._pending or number > self._fed
        if self._codec is None or not comes or key > self._fed + 1:
            self._reset()
            self._fed = key - 1

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
        if not content.data:  # the codec would take an empty packet for the end
            self._reset()
            raise VfoaError(f"{self._where}: packet {number + 1} is empty")
        if self._codec is None:
            self._codec = _decoder(content.form, self._where)
            self._codec.thread_count = 1  # threads would each hold a frame back
            self._codec.options = DECODING
        packet = av.Packet(content.data)
        packet.pts = packet.dts = number
        self._fed = number
        self._pending.add(number)
        return list(self._codec.decode(packet))

    def _keep(self, frame: Any) -> None:
        self._pending.discard(frame.pts)
        if frame.is_corrupt:
            return
        self._frames[frame.pts] = self._rgb(frame)
        while len(self._frames) > MOST_REORDERED:
            self._frames.pop(next(iter(self._frames)))
