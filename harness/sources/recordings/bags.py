"""Bags of ROS 1 (``.bag``) and ROS 2 (``.db3``, a folder with ``metadata.yaml``), read by rosbags, as containers."""

from __future__ import annotations

import weakref
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import zstandard
from rosbags.interfaces import Connection, MessageDefinitionFormat
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1.reader import Header, RecordType
from rosbags.rosbag2 import Reader as Ros2Reader

from harness.files.io import read_bytes
from harness.files.parsing import parse_yaml
from harness.sources.recordings import orbbec
from harness.sources.recordings.containers import (
    MOST_BYTES,
    TooLargeError,
    TopicIndex,
    files_in,
    starts_with,
    unpack,
    unpack_message,
    zstd_size,
)
from harness.sources.recordings.messages import BY_NAME, Content, MessageType, codec_of, message_type, picture
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError, first_line, reported_as

_ROS1 = b"#ROSBAG V2.0"
_SQLITE = b"SQLite format 3\0"
_REINDEX = "the recorder was killed; write the index with rosbag reindex"
_DAMAGED = "it is cut off, damaged, or without its -wal or -journal file: copy it again from the recorder, with these"
_ADVICE = {
    "not indexed": _REINDEX,
    "index looks damaged": _REINDEX,
    "malformed": _DAMAGED,
    "not a database": _DAMAGED,
    "missing tables": "it is empty: a recorder writes to FILE-wal first; copy that file from the recorder, too",
    "database files are missing": "copy them into the folder; if they have other names now, `ros2 bag reindex FOLDER` "
    "writes metadata.yaml again",
}
"""What to do, by words of the errors of rosbags and SQLite."""
_MOST_COMPRESSION = 1000
"""Most times that a recording's file is larger without compression: the dark images of a camera fill a tenth."""


def data_files(part: Path) -> tuple[Path, ...]:
    """The files that hold a part's messages."""
    if part.is_file():
        return (part,)
    names = _metadata(part).get("relative_file_paths")
    names = names if isinstance(names, list) else []
    return tuple(part / Path(name).name for name in names if isinstance(name, str))


def open_reader(part: Path) -> Any:
    """Return an open reader of rosbags, which decompresses to no more than headers state, within limits.

    Raises
    ------
    VfoaError
        If the part cannot be read; the message says what to do, if that is known.
    """
    reader: Any = None
    try:
        if part.is_file() and starts_with(part, _ROS1):
            reader = Ros1Reader(part)
            reader.open()
            _bound_chunks(reader)
        else:
            _check_packed_files(part)
            reader = Ros2Reader(part)
            reader.open()
            _bound_messages(reader)
        _check_connections(reader)
    except Exception as error:  # errors of rosbags, struct, SQLite, YAML, or the decompressors
        with suppress(Exception):  # one that is not open cannot be closed
            reader.close()
        text = first_line(error).rstrip(".")
        advice = next((f"; {advice}" for words, advice in _ADVICE.items() if words in text), "")
        raise VfoaError(f"{part}: cannot be read as a bag: {text}{advice}") from None
    return reader


def _bound_chunks(reader: Any) -> None:
    """Decompress each chunk of a ROS 1 bag to the size in its header; the library would decompress it to any."""
    for place, chunk in reader.chunks.items():
        reader.bio.seek(place)
        header = Header.read(reader.bio, RecordType.CHUNK)
        stated = partial(unpack, compression=header.get_string("compression"), size=header.get_uint32("size"))
        reader.chunks[place] = chunk._replace(decompressor=stated)


def _check_packed_files(part: Path) -> None:
    """Reject files that the library would decompress onto the disk, if they are packed too densely."""
    for path in data_files(part) if _metadata(part).get("compression_mode") == "file" else ():
        most = max(_MOST_COMPRESSION * path.stat().st_size, MOST_BYTES)
        with path.open("rb") as file:
            size = zstd_size(file.read(64))
            if size is None:
                file.seek(0)
                size = sum(len(chunk) for chunk in zstandard.ZstdDecompressor().read_to_iter(file) if chunk)
        if size > most:
            raise ValueError(f"{path.name} unpacks to {size} bytes; expected at most {most}")


def _bound_messages(reader: Any) -> None:
    """Decompress messages of a ROS 2 bag to the size in their heads; the library would decompress them to any.

    Messages tell themselves whether they are compressed, since a file may be without its ``metadata.yaml``.
    """
    packed = reader.messages
    if reader.compression_mode == "message":
        reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)

    def messages(*which: Any) -> Iterator[tuple[Any, int, Content]]:
        for connection, time_ns, data in packed(*which):
            yield connection, time_ns, unpack_message(data)

    reader.messages = messages


def _check_connections(reader: Any) -> None:
    """Check names, types, counts and definitions: a bag's metadata is YAML, where they can be anything."""
    for connection in reader.connections:
        topic, kind, count = connection.topic, connection.msgtype, connection.msgcount
        if not all(map(isinstance, (topic, kind, count, connection.msgdef.data), (str, str, int, str))):
            raise TypeError(
                f"its list of topics is damaged: found {topic!r} of the type {kind!r} with {count!r} messages; "
                "expected two texts, a number, and the type's definition"
            )


def bag_parts(path: Path) -> tuple[Path, ...]:
    """The parts of a bag, in the order of reading: files, or a folder with ``metadata.yaml``; none if it is not a bag.

    A bag is a ROS 1 bag, a SQLite file, or a folder of these; a folder of uncompressed MCAP is not a bag.
    """
    if path.is_file():
        return (path,) if starts_with(path, _ROS1) or starts_with(path, _SQLITE) else ()
    if not path.is_dir():
        return ()
    noted = _metadata(path)
    if noted.get("storage_identifier") == "sqlite3" or noted.get("compression_mode"):
        return (path,)
    # A killed recorder leaves no metadata.yaml; ROS 1 never writes one.
    for suffix in (".bag", ".db3"):
        if files := files_in(path, suffix):
            return files
    return ()


def _metadata(folder: Path) -> dict[str, Any]:
    """Metadata written by ``ros2 bag record``; empty if missing or unreadable."""
    try:
        path = folder / "metadata.yaml"
        noted = parse_yaml(read_bytes(path), path)["rosbag2_bagfile_information"]
        mode = str(noted.get("compression_mode") or "").lower()
        return {**noted, "compression_mode": "" if mode == "none" else mode}
    except (VfoaError, KeyError, TypeError, ValueError, AttributeError):
        return {}


_ALWAYS = frozenset({"calibration", "transforms", "extrinsics", "video"})
"""Kinds of messages that are also read from outside of a window."""

_SCHEMAS = {MessageDefinitionFormat.IDL: "ros2idl", MessageDefinitionFormat.NONE: BY_NAME}


class BagContainer:
    """A bag of one or several parts (see :class:`harness.sources.recordings.containers.Container`).

    A message is found by its log time and its position among its topic's messages of that type and time.
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

    def types(self) -> Iterator[tuple[str, MessageType]]:
        """Topics by the bags' own indexes."""
        for part in self._parts:
            for connection in self._reader(part).connections:
                yield _name(connection), _message_type(connection)

    def poses(self, losses: list[str]) -> Iterator[tuple[int, str, MessageType, int, bytes]]:
        """Messages in the order of their log times."""
        for number, part in enumerate(self._parts):
            reader = self._reader(part)
            kinds = {connection.id: _message_type(connection) for connection in reader.connections}
            wanted = [connection for connection in reader.connections if kinds[connection.id].is_pose]
            messages = reader.messages(wanted) if wanted else iter(())
            for connection, log_ns, data in self._readable(number, messages, losses):
                yield number, _name(connection), kinds[connection.id], log_ns, data

    def span_ns(self) -> tuple[int, int] | None:
        """Log times from the bags' own indexes."""
        readers = [reader for part in self._parts if (reader := self._reader(part)).message_count]
        return (min(r.start_time for r in readers), max(r.end_time for r in readers) - 1) if readers else None

    def index(self, window: range | None, *, by_log_time: bool) -> TopicIndex:
        """Read all messages of cameras; other topics are counted by the bag's index."""
        topics = TopicIndex(self._parts, window, by_log_time=by_log_time)
        topics.losses = [
            loss for number in range(len(self._parts)) for loss in self._index_part(number, topics, window)
        ]
        return topics.sorted()

    def read(self, topic: Topic, place: Place) -> bytes:
        """Read one message by its log time."""
        part = self._parts[place.file]
        # errors of struct, SQLite, the decompressors, or an index outside of the list
        with reported_as(f"{part}: {topic.name} at {place.offset} ns can no longer be read"), self._lock:
            reader = self._reader(part)
            connections = [
                connection
                for connection in reader.connections
                if _name(connection) == topic.name and _message_type(connection).name == topic.type.name
            ]
            messages = reader.messages(connections, place.offset, place.offset + 1)
            return bytes([data for _, _, data in messages][place.place])

    def first(self, name: str) -> tuple[MessageType, bytes]:
        """The first message of a topic that is not indexed, and its type.

        Raises
        ------
        VfoaError
            If it cannot be read, or there is none.
        """
        for part in self._parts:
            with reported_as(f"{part}: {name} cannot be read"), self._lock:
                reader = self._reader(part)
                connections = [connection for connection in reader.connections if connection.topic == name]
                for connection, _, data in reader.messages(connections) if connections else ():
                    return _message_type(connection), bytes(data)
        raise VfoaError(f"{self._parts[0]}: {name} has no message; expected one")

    def _reader(self, part: Path) -> Any:
        if part not in self._readers:
            self._readers[part] = open_reader(part)
        return self._readers[part]

    def _index_part(self, number: int, topics: TopicIndex, window: range | None) -> Iterator[str]:
        """Add the content of one part to the topics; yield a note for each unreadable part of it."""
        reader = self._reader(self._parts[number])
        always: list[Connection] = []
        images: list[Connection] = []
        topic_of = {
            connection.id: topics.meet(_name(connection), _message_type(connection))
            for connection in reader.connections
        }
        for connection in reader.connections:
            topic = topic_of[connection.id]
            if topic.type.kind is None:
                topic.count += connection.msgcount
            else:
                is_video = window is not None and topic.type.kind == "compressed" and _is_video(reader, connection)
                (always if is_video or topic.type.kind in _ALWAYS else images).append(connection)
        if always:
            yield from self._index_messages(number, reader.messages(always), topics, topic_of, always)
        if images:
            bounds = () if window is None else (window.start, window.stop)
            counted = images if window is None else ()
            yield from self._index_messages(number, reader.messages(images, *bounds), topics, topic_of, counted)

    def _index_messages(
        self,
        number: int,
        messages: Iterator[Any],
        topics: TopicIndex,
        topic_of: Mapping[int, Topic],
        counted: Sequence[Connection],
    ) -> Iterator[str]:
        """Add messages to the topics; yield what is lost of them, and of those ``counted`` what the index has more."""
        read: Counter[int] = Counter()
        last: dict[tuple[str, str], tuple[int, int]] = {}
        losses: list[str] = []
        for connection, log_ns, data in self._readable(number, messages, losses):
            topic = topic_of[connection.id]
            key = topic.name, topic.type.name
            before_ns, before = last.get(key, (None, 0))
            place = before + 1 if before_ns == log_ns else 0
            last[key] = log_ns, place
            topics.add(topic, log_ns, data, (number, log_ns, place))
            read[connection.id] += 1
        yield from losses
        for connection in counted if not losses else ():
            if read[connection.id] < connection.msgcount:
                yield (
                    f"{self._parts[number].name}: {connection.topic}: {read[connection.id]} of the "
                    f"{connection.msgcount} messages that its index counts are there: was the recorder's -wal file "
                    "copied, too?"
                )

    def _readable(
        self, number: int, messages: Iterator[Any], losses: list[str]
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the messages of one part up to the first that cannot be read, which ``losses`` describes."""
        log_ns: int | None = None
        while True:
            try:
                connection, time_ns, data = next(messages)
                if not isinstance(time_ns, int) or data is None:
                    raise TypeError(f"{connection.topic}: found a message without its time or content")
            except StopIteration:
                return
            except Exception as error:  # as above
                after = "at its start" if log_ns is None else f"after {log_ns} ns"
                what = "not read" if isinstance(error, TooLargeError) else "damaged"
                losses.append(
                    f"{self._parts[number].name}: {what} {after} ({first_line(error)}): everything after it is lost"
                )
                return
            log_ns = time_ns
            yield connection, time_ns, bytes(data)


def _is_video(reader: Any, connection: Connection) -> bool:
    """Whether the first compressed image of a connection is a packet of a video."""
    try:
        _, _, data = next(reader.messages([connection]))
        return codec_of(picture(_message_type(connection), bytes(data), connection.topic).form) is not None
    except Exception:  # there is none, or it is damaged, which its index reports
        return False


def _close(readers: dict[Path, Any]) -> None:
    for reader in readers.values():
        reader.close()


def _name(connection: Connection) -> str:
    """The name by which a topic is known: that of a driver for a recording of an SDK."""
    return orbbec.name_of(connection.topic) or connection.topic


def _message_type(connection: Connection) -> MessageType:
    if orbbec.name_of(connection.topic) is not None:  # the file's definitions are not those of its messages
        name = orbbec.IMAGE if connection.msgtype == orbbec.IMAGE else orbbec.PROFILE
        return message_type(orbbec.ENCODING, "", name, b"")
    is_ros1 = not hasattr(connection.ext, "serialization_format")
    schema_encoding = "ros1msg" if is_ros1 else _SCHEMAS.get(connection.msgdef.format, "ros2msg")
    definition = connection.msgdef.data.encode()
    return message_type("ros1" if is_ros1 else "cdr", schema_encoding, connection.msgtype, definition)
