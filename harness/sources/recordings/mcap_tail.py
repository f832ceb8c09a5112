"""A recording in MCAP that is being written: its newest frames, as the writer adds them to the file."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event

from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from harness.files.io import unreadable
from harness.sources.live import Arrival
from harness.sources.recordings.cameras import PairCameras
from harness.sources.recordings.depth_camera import DepthCamera
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

    def keep(self, topic: Topic, data: bytes) -> None:
        """Keep one more message, up to a number that static transforms do not reach."""
        kept = self.data.setdefault(topic.name, [])
        if len(kept) < _KEPT:
            topic.places.append(Place(0, 0, 0, len(kept)))
            kept.append(data)

    def keep_last(self, topic: Topic, data: bytes) -> None:
        """Keep only this message of the topic."""
        topic.places = [Place(0, 0, 0, 0)]
        self.data[topic.name] = [data]

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
        self._pair: tuple[Topic, Topic] | None = None
        self._is_depth = False
        self._depth_camera: DepthCamera | None = None
        self._heard = _Heard()
        self._waiting: tuple[deque[_Taken], deque[_Taken]] = (deque(maxlen=_WAITING), deque(maxlen=_WAITING))
        self._cameras: PairCameras | None = None

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
        if self._pair is None and not stopped.is_set():
            self._find_pair()  # the error says what is missing

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

    def _find_pair(self) -> tuple[Topic, Topic]:
        """The two topics that make frames.

        Raises
        ------
        VfoaError
            If they have not arrived yet, or are no still images.
        """
        streams = find_streams(self._topics.values(), self._settings, str(self._path))
        other = streams.right or streams.depth
        assert other is not None
        for topic in (streams.left, other):
            if topic.type.kind == "video":
                raise VfoaError(
                    f"{self._path}: {topic.name} is a video; expected images, raw or compressed, for a live run"
                )
        self._is_depth = streams.right is None
        return streams.left, other

    def _hear(self, topic: Topic, message: Message) -> tuple[_Taken, _Taken] | None:
        where = f"{self._path}: {topic.name}"
        if topic.type.kind == "calibration":
            self._heard.keep_last(topic, message.data)
        elif topic.type.kind in ("transforms", "extrinsics"):
            self._heard.keep(topic, message.data)
        if topic.sight is None and topic.type.kind in (*IMAGES, "calibration"):
            self._note_first(topic, message, where)
        if self._pair is None or topic not in self._pair:
            return None
        by_log = self._settings.stamps == "log"
        stamp = message.log_time if by_log else stamp_ns(topic.type, message.data, where)
        side = self._pair.index(topic)
        self._waiting[side].append(_Taken(stamp, topic.type, message.data))
        return self._joined(side)

    def _note_first(self, topic: Topic, message: Message, where: str) -> None:
        """Read a topic's first message, which may complete the topics of the frames."""
        topic.sight = sight(topic.type, message.data, where)
        if topic.type.kind in IMAGES:
            topic.places = [Place(0, 0, 0, 0)]
        if self._pair is None:
            with suppress(VfoaError):  # the other topics may still arrive
                self._pair = self._find_pair()

    def _joined(self, side: int) -> tuple[_Taken, _Taken] | None:
        """The last image of this side with its partner; earlier images of both sides are dropped."""
        own, others = self._waiting[side], self._waiting[1 - side]
        nearest = min(others, key=lambda other: abs(other.stamp_ns - own[-1].stamp_ns), default=None)
        if nearest is None or abs(nearest.stamp_ns - own[-1].stamp_ns) > self._settings.tolerance_ns(
            of_depth=self._is_depth
        ):
            return None
        last = own[-1]
        own.clear()
        while others.popleft() is not nearest:
            pass
        return (last, nearest) if side == 0 else (nearest, last)

    def _arrival(self, number: int, left: _Taken, right: _Taken) -> Arrival:
        def read() -> StereoFrame:
            return self._frame(number, left, right)

        return Arrival(number=number, time_ns=left.stamp_ns, arrived_s=time.monotonic(), read=read)

    def _frame(self, number: int, left: _Taken, right: _Taken) -> StereoFrame:
        where = f"{self._path}: frame {number}"
        if self._is_depth:
            return self._depth_frame(number, left, right, where)
        images = [read_image(taken.type, taken.data, where) for taken in (left, right)]
        if images[0].shape != images[1].shape:
            sizes = " and ".join(f"{image.shape[1]} x {image.shape[0]}" for image in images)
            raise VfoaError(f"{where}: left and right are {sizes} pixels; expected the same")
        if self._cameras is None:
            size = (images[0].shape[1], images[0].shape[0])
            self._cameras = PairCameras(*self._calibrated(), self._path.parent, lambda: size, str(self._path))
        found = self._cameras.at(left.stamp_ns, right.stamp_ns)
        first, second = found.rectify(*images)
        rig = found.calibration.rig(first.shape[1], first.shape[0])
        return StereoFrame(index=number, time_ns=left.stamp_ns, left=first, right=second, rig=rig)

    def _calibrated(self) -> tuple[list[Topic], Streams, _Heard, RecordingSettings]:
        """The topics that have arrived, those of the frames, the messages that calibrate them, and the settings."""
        assert self._pair is not None
        left, other = self._pair
        streams = Streams(left=left, right=None if self._is_depth else other, depth=other if self._is_depth else None)
        topics = [topic for topic in self._topics.values() if topic.sight is not None or topic.places]
        return topics, streams, self._heard, self._settings

    def _depth_frame(self, number: int, colour: _Taken, depth: _Taken, where: str) -> StereoFrame:
        if self._depth_camera is None:
            self._depth_camera = DepthCamera(*self._calibrated(), str(self._path))
        image = read_image(colour.type, colour.data, where)
        depth_m = read_depth(depth.type, depth.data, self._settings.depth_scale, where)
        left, measured, rig = self._depth_camera.view(image, depth_m, colour.stamp_ns)
        return StereoFrame(index=number, time_ns=colour.stamp_ns, left=left, depth_m=measured, rig=rig)
