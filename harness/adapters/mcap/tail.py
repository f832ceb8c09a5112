"""The end of a recording that is being written: its newest pairs, as the writer gets them to the file."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from mcap.records import Channel, Message, Schema

from harness.adapters.calibration_files.options import Options
from harness.adapters.calibration_files.read import read_cameras
from harness.adapters.mcap.clip import McapSettings
from harness.adapters.mcap.follow import follow_records
from harness.adapters.mcap.messages import MessageType, camera, message_type, stamp_ns
from harness.adapters.mcap.pixels import read_image
from harness.adapters.mcap.topics import Topic, are_rectified, find_camera, find_pair
from harness.adapters.rectification import Optics, RawCalibration, RawCamera, optics
from harness.live import Arrival
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame

_WAITING = 32
"""Images of one side that wait for one of the other."""


@dataclass(frozen=True, slots=True)
class _Taken:
    stamp_ns: int
    type: MessageType
    data: bytes


class McapTail:
    """A recording that grows, read behind its writer. Topics and calibration are found as in a finished one.

    A writer that gathers messages in chunks gets them to the file chunk by chunk: frames then come in bursts. What
    stands in the file already is passed over, up to its newest pair. The source ends with the recording.
    """

    rate_hz = None

    def __init__(self, path: Path, settings: McapSettings) -> None:
        self._path, self._settings = path, settings
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._topics: dict[str, Topic] = {}
        self._pair: tuple[Topic, Topic] | None = None
        self._calibrations: dict[str, RawCamera] = {}
        self._waiting: tuple[deque[_Taken], deque[_Taken]] = (deque(maxlen=_WAITING), deque(maxlen=_WAITING))
        self._optics: tuple[bytes, Optics] | None = None

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        """As :class:`harness.live.LiveSource`; numbers count the pairs, from 1, that come from now on."""
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
            self._find_pair()  # says what is missing

    def begin(self) -> None:
        """The writer does not wait."""

    def _take(self, record: Schema | Channel | Message) -> tuple[_Taken, _Taken] | None:
        """Take note of a record; the pair that it completes."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._channels[record.id] = record
            self._meet(record)
        elif (channel := self._channels.get(record.channel_id)) is not None:
            return self._hear(self._topics[channel.topic], record)
        return None

    def _meet(self, channel: Channel) -> None:
        if channel.topic in self._topics:
            return
        self._topics[channel.topic] = Topic(channel.topic, message_type(channel, self._schemas.get(channel.schema_id)))
        if self._pair is None:
            try:
                self._pair = self._find_pair()
            except VfoaError:  # the other topics may still come
                return

    def _find_pair(self) -> tuple[Topic, Topic]:
        return find_pair(self._topics.values(), self._settings.left, self._settings.right, str(self._path))

    def _hear(self, topic: Topic, message: Message) -> tuple[_Taken, _Taken] | None:
        where = f"{self._path}: {topic.name}"
        if topic.type.kind == "calibration":
            self._calibrations[topic.name] = camera(topic.type, message.data, where)
        if self._pair is None or topic not in self._pair:
            return None
        by_log = self._settings.stamps == "log"
        stamp = message.log_time if by_log else stamp_ns(topic.type, message.data, where)
        side = self._pair.index(topic)
        self._waiting[side].append(_Taken(stamp, topic.type, message.data))
        return self._joined(side)

    def _joined(self, side: int) -> tuple[_Taken, _Taken] | None:
        """The image that came last, on this side, with its partner; those that came before either wait no more."""
        own, others = self._waiting[side], self._waiting[1 - side]
        nearest = min(others, key=lambda other: abs(other.stamp_ns - own[-1].stamp_ns), default=None)
        if nearest is None or abs(nearest.stamp_ns - own[-1].stamp_ns) > self._settings.tolerance_ms * 1e6:
            return None
        last = own[-1]
        own.clear()
        while others.popleft() is not nearest:
            pass
        return (last, nearest) if side == 0 else (nearest, last)

    def _arrival(self, number: int, left: _Taken, right: _Taken) -> Arrival:
        calibrations = dict(self._calibrations)

        def read() -> StereoFrame:
            return self._frame(number, left, right, calibrations)

        return Arrival(number=number, time_ns=left.stamp_ns, arrived_s=time.monotonic(), read=read)

    def _frame(self, number: int, left: _Taken, right: _Taken, calibrations: dict[str, RawCamera]) -> StereoFrame:
        where = f"{self._path}: frame {number}"
        images = [read_image(taken.type, taken.data, where) for taken in (left, right)]
        if images[0].shape != images[1].shape:
            sizes = " and ".join(f"{image.shape[1]} x {image.shape[0]}" for image in images)
            raise VfoaError(f"{where}: left and right are {sizes} pixels; expected the same")
        found = self._optics_of(calibrations, (images[0].shape[1], images[0].shape[0]))
        first, second = found.rectify(*images)
        rig = found.calibration.rig(first.shape[1], first.shape[0])
        return StereoFrame(index=number, time_ns=left.stamp_ns, left=first, right=second, rig=rig)

    def _optics_of(self, calibrations: dict[str, RawCamera], size: tuple[int, int]) -> Optics:
        """Of the calibrations that had come with a pair; maps are computed only where they changed."""
        assert self._pair is not None
        settings = self._settings
        rectified = are_rectified(self._pair) if settings.rectified is None else settings.rectified
        if settings.calibration is not None:
            if self._optics is None:
                path = self._path.parent / settings.calibration
                self._optics = b"", optics(read_cameras([path], lambda: size, Options(rectified=rectified)))
            return self._optics[1]
        topics = [self._topics[name] for name in calibrations]
        named = (settings.left_info, settings.right_info)
        left, right = (
            calibrations[find_camera(topics, image, name, str(self._path)).name]
            for image, name in zip(self._pair, named, strict=True)
        )
        if self._optics is None or self._optics[0] != left.key + right.key:
            raw = RawCalibration(left=left, right=right, where=str(self._path))
            self._optics = left.key + right.key, optics(raw.rectified() if rectified else raw)
        return self._optics[1]
