"""A recording in MCAP that is being written: its newest frames, as the writer adds them to the file."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from threading import Event

from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from harness.files.io import unreadable
from harness.sources.live import Arrival
from harness.sources.recordings.depth_camera import RecordedOptics
from harness.sources.recordings.mcap_container import message_type
from harness.sources.recordings.mcap_files import HEAD, MAGIC, PARSED, parse_record, parts_of
from harness.sources.recordings.messages import IMAGES, MessageType, sight, stamp_ns
from harness.sources.recordings.pixels import read_depth, read_image
from harness.sources.recordings.topics import (
    Place,
    RecordingSettings,
    Streams,
    Topic,
    find_streams,
)
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame

_POLL_S = 0.005
"""Seconds between two checks for more data."""


def follow_records(path: Path, stopped: Event) -> Iterator[Schema | Channel | Message | None]:
    """Yield every record, and None whenever no further complete one is there yet.

    Ends with the file's footer, or soon after ``stopped`` is set. Damaged records are skipped.

    Raises
    ------
    VfoaError
        If the file cannot be opened, is not MCAP, or was truncated or replaced by a shorter one meanwhile.
    """
    at = 0
    while not stopped.is_set():
        kind, data = _read(path, at)
        if kind is None:
            yield None
            stopped.wait(_POLL_S)
            continue
        if kind in (Opcode.DATA_END, Opcode.FOOTER):
            return
        at += len(data) if kind == _START else HEAD.size + len(data)
        if kind in PARSED:
            yield from _told(kind, data)


_START = -1


def _read(path: Path, at: int) -> tuple[int | None, bytes]:
    """The kind and the content of the record at this offset; kind None if it is not complete."""
    try:
        with path.open("rb") as file:
            file.seek(at)
            if at == 0:
                return _start(path, file.read(len(MAGIC)))
            head = file.read(HEAD.size)
            if len(head) < HEAD.size:
                if path.stat().st_size < at:
                    raise VfoaError(f"{path}: is shorter than the part already read; expected a recording that grows")
                return None, b""
            opcode, length = HEAD.unpack(head)
            if opcode == 0 or path.stat().st_size < at + HEAD.size + length:  # 0: space allocated by a file system
                return None, b""
            return opcode, file.read(length)
    except OSError as error:
        raise unreadable(path, error) from None


def _start(path: Path, found: bytes) -> tuple[int | None, bytes]:
    if not MAGIC.startswith(found):
        raise VfoaError(f"{path}: not MCAP: it starts with {found!r}; expected {MAGIC!r}")
    return (_START, found) if found == MAGIC else (None, b"")


def _told(opcode: int, data: bytes) -> Iterator[Schema | Channel | Message]:
    """Yield the contents of a record; nothing if it is damaged."""
    with suppress(Exception):  # errors of struct, text decoding or decompression: all mean damage
        for part in parts_of(parse_record(opcode, data)):
            if isinstance(part, Schema | Channel | Message):
                yield part


_KEPT = 200
"""Most messages of transforms, more than static ones reach."""
_WAITING = 32
"""Most images of one side that wait for one of the other."""


@dataclass(frozen=True, slots=True)
class _Taken:
    stamp_ns: int
    type: MessageType
    data: bytes


@dataclass(slots=True)
class _Heard:
    """Messages by which cameras are calibrated, received so far."""

    data: dict[str, list[bytes]] = field(default_factory=dict)

    def keep(self, topic: Topic, data: bytes, most: int) -> None:
        """Keep the message; of more than ``most`` of a topic, the last ones."""
        kept = [*self.data.get(topic.name, []), data][-most:]
        self.data[topic.name], topic.places = kept, [Place(0, 0, 0, place) for place in range(len(kept))]

    def read(self, topic: Topic, place: Place) -> bytes:
        """Return a message that was kept."""
        return self.data[topic.name][place.place]


class McapTail:
    """A recording that grows, read while it is written. Topics and calibration are found as in a finished one.

    If the writer collects messages in chunks, frames arrive in bursts, chunk by chunk. Everything in the file before
    the newest frame is skipped. The source ends with the recording. A frame is a pair, or colour with measured depth.
    """

    rate_hz = None

    def __init__(self, path: Path, settings: RecordingSettings) -> None:
        self._path, self._settings = path, settings
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._topics: dict[str, Topic] = {}
        self._streams: Streams | None = None
        self._heard = _Heard()
        self._waiting: tuple[deque[_Taken], deque[_Taken]] = (deque(maxlen=_WAITING), deque(maxlen=_WAITING))
        self._optics: RecordedOptics | None = None

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        """As in :class:`harness.sources.live.LiveSource`; numbers count the pairs that arrive from now on, from 1."""
        number, newest, is_behind = 0, None, True
        for record in follow_records(self._path, stopped):
            if record is not None:
                pair = self._take(record)
                newest = pair or newest
            if newest is not None and (record is None or not is_behind):
                number += 1
                yield self._arrival(number, *newest)
                newest = None
            is_behind = is_behind and record is not None
        if newest is not None:
            yield self._arrival(number + 1, *newest)
        if self._streams is None and not stopped.is_set():
            self._find_streams()  # the error says what is missing

    def begin(self) -> None:
        """Do nothing: the writer does not wait."""

    def _take(self, record: Schema | Channel | Message) -> tuple[_Taken, _Taken] | None:
        """Process a record; return the pair that it completes."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._channels[record.id] = record
            kind = message_type(record, self._schemas.get(record.schema_id))
            self._topics.setdefault(record.topic, Topic(record.topic, kind))
        elif (channel := self._channels.get(record.channel_id)) is not None:
            return self._hear(self._topics[channel.topic], record)
        return None

    def _find_streams(self) -> Streams:
        """The two topics that make frames.

        Raises
        ------
        VfoaError
            If they have not arrived yet, or are no still images.
        """
        streams = find_streams(self._topics.values(), self._settings, str(self._path))
        if streams.right is not None:
            streams = replace(streams, depth=None)
        if video := next((topic for topic in streams.topics if topic.type.kind == "video"), None):
            raise VfoaError(
                f"{self._path}: {video.name} is a video; expected images, raw or compressed, for a live run"
            )
        return streams

    def _hear(self, topic: Topic, message: Message) -> tuple[_Taken, _Taken] | None:
        where = f"{self._path}: {topic.name}"
        if topic.type.kind == "calibration":
            self._heard.keep(topic, message.data, 1)
        elif topic.type.kind in ("transforms", "extrinsics"):
            self._heard.keep(topic, message.data, _KEPT)
        if topic.sight is None and topic.type.kind in (*IMAGES, "calibration"):
            self._note_first(topic, message, where)
        if self._streams is None or topic not in self._streams.topics:
            return None
        by_log = self._settings.stamps == "log"
        stamp = message.log_time if by_log else stamp_ns(topic.type, message.data, where)
        side = self._streams.topics.index(topic)
        self._waiting[side].append(_Taken(stamp, topic.type, message.data))
        return self._joined(side)

    def _note_first(self, topic: Topic, message: Message, where: str) -> None:
        """Read a topic's first message, which may complete the topics of the frames."""
        topic.sight = sight(topic.type, message.data, where)
        if topic.type.kind in IMAGES:
            topic.places = [Place(0, 0, 0, 0)]
        if self._streams is None:
            with suppress(VfoaError):  # the other topics may still arrive
                self._streams = self._find_streams()

    def _joined(self, side: int) -> tuple[_Taken, _Taken] | None:
        """The last image of this side with its partner; earlier images of both sides are dropped."""
        own, others = self._waiting[side], self._waiting[1 - side]
        nearest = min(others, key=lambda other: abs(other.stamp_ns - own[-1].stamp_ns), default=None)
        assert self._streams is not None
        tolerance_ns = self._settings.tolerance_ns(of_depth=self._streams.right is None)
        if nearest is None or abs(nearest.stamp_ns - own[-1].stamp_ns) > tolerance_ns:
            return None
        last = own[-1]
        own.clear()
        while others.popleft() is not nearest:
            pass
        return (last, nearest) if side == 0 else (nearest, last)

    def _arrival(self, number: int, left: _Taken, right: _Taken) -> Arrival:
        read = partial(self._frame, number, left, right)
        return Arrival(number=number, time_ns=left.stamp_ns, arrived_s=time.monotonic(), read=read)

    def _frame(self, number: int, left: _Taken, other: _Taken) -> StereoFrame:
        where, streams = f"{self._path}: frame {number}", self._streams
        assert streams is not None
        image, right, depth_m = read_image(left.type, left.data, where), None, None
        if streams.right is None:
            depth_m = read_depth(other.type, other.data, self._settings.depth_scale, where)
        else:
            right = read_image(other.type, other.data, where)
        try:
            if self._optics is None:
                topics = [topic for topic in self._topics.values() if topic.sight is not None or topic.places]
                size, folder = (image.shape[1], image.shape[0]), self._path.parent
                self._optics = RecordedOptics(
                    topics, streams, self._heard, self._settings, folder, lambda: size, str(self._path)
                )
            return self._optics.frame(number, (left.stamp_ns, other.stamp_ns), image, right, depth_m)
        except VfoaError as error:
            raise VfoaError(f"{where}: {str(error).removeprefix(f'{self._path}: ')}") from None
