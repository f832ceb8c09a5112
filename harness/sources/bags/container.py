"""A bag of ROS 1 (``.bag``) or ROS 2 (``.db3``, a folder with ``metadata.yaml``) as a container of messages."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from pathlib import Path
from threading import Lock
from typing import Any

from rosbags.interfaces import Connection, MessageDefinitionFormat

from harness.sources.bags.files import bag_parts, data_files, open_reader
from harness.sources.recordings.index import Index, TopicIndex, Window
from harness.sources.recordings.message_types import BY_NAME, MessageType, ros_name
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError

_ALWAYS = frozenset({"calibration", "transforms", "extrinsics", "video"})
"""Kinds of messages that are also read from outside of a window."""

_SCHEMAS = {MessageDefinitionFormat.IDL: "ros2idl", MessageDefinitionFormat.NONE: BY_NAME}


class BagContainer:
    """A bag of one or several parts (see :class:`harness.sources.recordings.containers.Container`).

    A message is found by its log time and its position among its topic's messages of that time.
    """

    def __init__(self, path: Path) -> None:
        self._parts = bag_parts(path)
        self.files = tuple(file for part in self._parts for file in data_files(part))
        self._begin()

    def __getstate__(self) -> dict[str, Any]:
        return {"_parts": self._parts, "files": self.files}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self._parts, self.files = state["_parts"], state["files"]
        self._begin()

    def _begin(self) -> None:
        self._readers: dict[Path, Any] = {}
        self._lock = Lock()  # a reader has one position, and several threads read frames
        weakref.finalize(self, _close, self._readers)

    def span_ns(self) -> tuple[int, int] | None:
        """Log times from the bags' own indexes."""
        readers = [reader for part in self._parts if (reader := self._reader(part)).message_count]
        return (min(r.start_time for r in readers), max(r.end_time for r in readers) - 1) if readers else None

    def index(self, window: Window | None, *, by_log_time: bool) -> Index:
        """Read all messages of cameras; other topics are counted by the bag's index."""
        topics = TopicIndex(self._parts, window, by_log_time=by_log_time)
        losses = [loss for number in range(len(self._parts)) for loss in self._index_part(number, topics, window)]
        return Index(topics=topics.sorted(), losses=tuple(losses))

    def read(self, topic: Topic, place: Place) -> bytes:
        """Read one message by its log time."""
        part = self._parts[place.file]
        try:
            with self._lock:
                reader = self._reader(part)
                found = reader.messages(_of_topic(reader, topic.name), place.offset, place.offset + 1)
                return bytes([data for _, _, data in found][place.place])
        except VfoaError:
            raise
        except Exception as error:  # errors of struct, SQLite, the decompressors, or an index outside of the list
            text = (str(error) or type(error).__name__).splitlines()[0]
            raise VfoaError(f"{part}: {topic.name} at {place.offset} ns can no longer be read: {text}") from None

    def _reader(self, part: Path) -> Any:
        if part not in self._readers:
            self._readers[part] = open_reader(part)
        return self._readers[part]

    def _index_part(self, number: int, topics: TopicIndex, window: Window | None) -> Iterator[str]:
        """Add the content of one part to the topics; yield a note for each unreadable part of it."""
        reader = self._reader(self._parts[number])
        kinds: dict[str, list[Connection]] = {"always": [], "images": []}
        for connection in reader.connections:
            topic = topics.meet(connection.topic, _message_type(connection))
            if topic.type.kind is None:
                topic.count += connection.msgcount
            else:
                kinds["always" if topic.type.kind in _ALWAYS else "images"].append(connection)
        bounds = {
            "always": (None, None),
            "images": (None, None) if window is None else (window.start_ns, window.end_ns),
        }
        for kind, connections in kinds.items():
            if connections:
                yield from self._index_messages(number, reader.messages(connections, *bounds[kind]), topics)

    def _index_messages(self, number: int, messages: Iterator[Any], topics: TopicIndex) -> Iterator[str]:
        last: dict[str, tuple[int, int]] = {}
        log_ns: int | None = None
        while True:
            try:
                connection, time_ns, data = next(messages)
                if not isinstance(time_ns, int) or data is None:
                    raise TypeError(f"{connection.topic}: found a message without its time or content")
            except StopIteration:
                return
            except Exception as error:  # as above
                text = (str(error) or type(error).__name__).splitlines()[0]
                after = "at its start" if log_ns is None else f"after {log_ns} ns"
                yield f"{self._parts[number].name}: damaged {after} ({text}): everything after it is lost"
                return
            log_ns = time_ns
            before_ns, before = last.get(connection.topic, (None, 0))
            place = before + 1 if before_ns == log_ns else 0
            last[connection.topic] = log_ns, place
            topics.add(topics.topics[connection.topic], log_ns, bytes(data), (number, log_ns, place))


def _close(readers: dict[Path, Any]) -> None:
    for reader in readers.values():
        reader.close()


def _of_topic(reader: Any, name: str) -> list[Connection]:
    return [connection for connection in reader.connections if connection.topic == name]


def _message_type(connection: Connection) -> MessageType:
    is_ros1 = not hasattr(connection.ext, "serialization_format")
    return MessageType(
        message_encoding="ros1" if is_ros1 else "cdr",
        schema_encoding="ros1msg" if is_ros1 else _SCHEMAS.get(connection.msgdef.format, "ros2msg"),
        name=ros_name(connection.msgtype),
        schema=connection.msgdef.data.encode(),
    )
