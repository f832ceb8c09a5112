"""Recordings in MCAP, of one or several files: their records, and all readable messages in order."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from functools import lru_cache
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, ChunkIndex, McapRecord, Message, Schema
from mcap.summary import Summary

from harness.files.io import opened
from harness.sources.recordings import zed
from harness.sources.recordings.containers import TooLargeError, TopicIndex, starts_with, unpack, unpack_message
from harness.sources.recordings.messages import Content, MessageType, codec_of, message_type, picture
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError, first_line, reported_as

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode and length of every record
_CHUNK = struct.Struct("<QQQII")  # first and last log time; size and CRC of the content; length of the compression
_LENGTH = struct.Struct("<Q")  # of the content
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_DECLARING: dict[int, Any] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}
_READ = {Opcode.MESSAGE, Opcode.CHUNK, *_DECLARING}


def _records_at(file: BinaryIO, offset: int) -> list[McapRecord]:
    """The records in the chunk at an offset, or the one that is there; any exception means damage."""
    file.seek(offset)
    opcode, length = HEAD.unpack(file.read(HEAD.size))
    content = memoryview(file.read(length))
    return records_in(content) if opcode == Opcode.CHUNK else [_record(opcode, content)]


def records_in(chunk: memoryview) -> list[McapRecord]:
    """The messages in a chunk, and what is needed to read them; any exception means damage.

    Messages hold a part of the chunk: the library's reader copies each image twice, and takes three times as long.
    """
    *_, size, checksum, length = _CHUNK.unpack_from(chunk)
    compression, rest = chunk[_CHUNK.size : _CHUNK.size + length], chunk[_CHUNK.size + length :]
    packed = rest[_LENGTH.size : _LENGTH.size + _LENGTH.unpack_from(rest)[0]]
    content = memoryview(unpack(packed, str(compression, "utf-8"), size))
    if checksum not in (0, zlib.crc32(content)):
        raise ValueError("its checksum is wrong")
    records, offset = [], 0
    while offset < len(content):
        opcode, length = HEAD.unpack_from(content, offset)
        begin, offset = offset + HEAD.size, offset + HEAD.size + length
        if opcode == Opcode.MESSAGE or opcode in _DECLARING:
            if offset > len(content):
                raise ValueError("its last record is cut")
            records.append(_record(opcode, content[begin:offset]))
    return records


def _record(opcode: int, content: memoryview) -> McapRecord:
    if opcode != Opcode.MESSAGE:
        return _DECLARING[opcode].read(ReadDataStream(BytesIO(content)))
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
    data: Any = content[_MESSAGE.size :]
    return Message(channel, log_time, data, publish_time, sequence)


def walk_messages(
    path: Path, summary: Summary, losses: list[str], offsets: Sequence[int] | None = None
) -> Iterator[tuple[int, int, Message]]:
    """Yield every readable message as (record's offset in the file, place in that record, message).

    Holds one chunk at a time. A chunk with a wrong checksum is left out completely. Attachments and metadata are
    skipped.

    Parameters
    ----------
    summary
        The file's own, whose schemas and channels are completed: the chunk that declares them may be lost, or a cut
        file has no summary.
    losses
        Gets a description of each unreadable part.
    offsets
        Read only the chunks at these offsets.

    Raises
    ------
    VfoaError
        If the file cannot be opened or is not MCAP.
    """
    with opened(path) as file:
        for offset in _offsets(path, file, losses) if offsets is None else offsets:
            try:
                records = _records_at(file, offset)
            except TooLargeError as error:
                losses.append(f"the chunk at byte {offset} is not read: {error}; expected smaller chunks (chunk_size)")
                continue
            except Exception as error:  # of struct, text decoding, the library or a decompressor; or a wrong index
                losses.append(f"the chunk at byte {offset} is damaged ({first_line(error)})")
                continue
            messages = 0
            for record in records:
                if isinstance(record, Schema):
                    summary.schemas[record.id] = record
                elif isinstance(record, Channel):
                    summary.channels[record.id] = record
                elif isinstance(record, Message):
                    yield offset, messages, record
                    messages += 1


_STARTS = {
    ".mcap": ("MCAP", MAGIC),
    ".db3": ("a database of ROS 2", b"SQLite format 3"),
    ".bag": ("a bag of ROS 1", b"#ROSBAG V2.0"),
}
"""What recordings are and begin with, by the ends of their names."""


def refuse_damaged(path: Path) -> None:
    """Raise a :class:`VfoaError` for a file that is called as a recording and does not begin as any of them."""
    if path.suffix.lower() in _STARTS and not any(starts_with(path, magic) for _, magic in _STARTS.values()):
        with opened(path) as file:
            raise _not_a_recording(path, file.read(len(MAGIC)))


def _not_a_recording(path: Path, start: bytes) -> VfoaError:
    kind, expected = _STARTS.get(path.suffix.lower(), _STARTS[".mcap"])
    copied = "" if start.strip(b"\0") else ": copy it again from the recorder"
    return VfoaError(f"{path}: not {kind}: it starts with {start!r}; expected {expected!r}{copied}")


def _offsets(path: Path, file: BinaryIO, losses: list[str]) -> Iterator[int]:
    """The places of all records of these kinds in a file."""
    size = os.fstat(file.fileno()).st_size
    if (magic := file.read(len(MAGIC))) != MAGIC:
        raise _not_a_recording(path, magic)
    offset = len(MAGIC)
    while file.seek(offset) + HEAD.size <= size:
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        if opcode == Opcode.FOOTER:
            return
        if offset + HEAD.size + length > size:
            losses.append(f"cut at byte {size}: the record at byte {offset} and everything after it are lost")
            return
        if opcode == 0:  # no such record: zeros of the file system
            losses.append(f"damaged at byte {offset}: everything after it is lost")
            return
        if opcode in _READ:
            yield offset
        offset += HEAD.size + length
    losses.append(f"cut at byte {size}: everything after it is lost")


@lru_cache(maxsize=2)
def _messages_at(path: Path, offset: int, _version: tuple[int, int]) -> tuple[Message, ...]:
    """The messages of one record; the last two chunks stay decompressed, since neighbours are read in turn."""
    with path.open("rb") as file:
        return tuple(record for record in _records_at(file, offset) if isinstance(record, Message))


def read_summary(path: Path) -> Summary:
    """Schemas, channels, statistics and the index of chunks at a file's end; empty in a truncated file, or without."""
    try:
        with opened(path) as file:
            return SeekingReader(file).get_summary() or Summary()
    except Exception:  # of the library, struct or the file; reading the records reports the damage
        return Summary()


def log_span_ns(path: Path) -> tuple[int, int] | None:
    """First and last log time of a file: from its statistics, or else its messages; None without messages."""
    summary = read_summary(path)
    is_of_zed = zed.serials(channel.topic for channel in summary.channels.values())
    if not is_of_zed and (statistics := summary.statistics) is not None and statistics.message_count:
        return statistics.message_start_time, statistics.message_end_time
    times_ns = [
        message.log_time
        for _, _, message in walk_messages(path, summary, [])
        if (channel := summary.channels.get(message.channel_id)) is not None
        if not zed.is_of_another_clock(channel.topic)
    ]
    return (min(times_ns), max(times_ns)) if times_ns else None


def channel_type(channel: Channel, schema: Schema | None) -> MessageType:
    """Return the type of a channel's messages; a channel may have no schema."""
    if schema is None:
        return message_type(channel.message_encoding, "", "no schema", b"")
    return message_type(channel.message_encoding, schema.encoding, schema.name, schema.data)


def _declared(summary: Summary) -> dict[int, Channel]:
    """The channels of a summary whose schema is known: a writer may leave schemas, or both, out of a file's end."""
    known = {0, *summary.schemas}  # 0: a channel without a schema
    return {number: channel for number, channel in summary.channels.items() if channel.schema_id in known}


def _is_complete(summary: Summary) -> bool:
    return bool(summary.channels) and len(_declared(summary)) == len(summary.channels)


class McapContainer:
    """The files of one MCAP recording (see :class:`harness.sources.recordings.containers.Container`).

    Unreadable parts (a truncated file, a wrong checksum) are left out, and noted in the index.
    """

    def __init__(self, files: tuple[Path, ...]) -> None:
        self.files = files

    def types(self) -> Iterator[tuple[str, MessageType]]:
        """Topics by the summaries; without these, messages are read until they are found."""
        for path in self.files:
            summary, known, entries = read_summary(path), set[int](), -1
            messages = () if _is_complete(summary) else walk_messages(path, summary, [])
            for _ in chain([None], messages):
                if (now := len(summary.channels) + len(summary.schemas)) == entries:
                    continue
                declared, entries = _declared(summary), now
                for channel in [declared[number] for number in declared.keys() - known]:
                    known.add(channel.id)
                    yield channel.topic, channel_type(channel, summary.schemas.get(channel.schema_id))

    def poses(self, losses: list[str]) -> Iterator[tuple[int, str, MessageType, int, bytes]]:
        """Messages in the order of writing."""
        for number, path in enumerate(self.files):
            summary, lost = read_summary(path), list[str]()
            for _, _, message in walk_messages(path, summary, lost):
                channel = summary.channels.get(message.channel_id)
                if channel is None:  # it was in a chunk that is lost
                    continue
                kind = channel_type(channel, summary.schemas.get(channel.schema_id))
                if kind.is_pose:
                    with reported_as(f"{path}: {channel.topic}"):
                        data = bytes(_content(message, channel.message_encoding))
                    yield number, channel.topic, kind, message.log_time, data
            losses += [f"{path.name}: {loss}" for loss in lost]

    def span_ns(self) -> tuple[int, int] | None:
        """Log times from summaries, or without these from the heads of the records; reads no message."""
        spans = [span for path in self.files if (span := log_span_ns(path)) is not None]
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else None

    def index(self, window: range | None, *, by_log_time: bool) -> TopicIndex:
        """Read all files once, one chunk at a time. If the files have indexes, only a window's chunks are read."""
        topics = TopicIndex(self.files, window, by_log_time=by_log_time)
        for number, path in enumerate(self.files):
            summary, losses = read_summary(path), list[str]()
            chunks = None if window is None else _chunks(path, summary, window)
            for declared in _declared(summary).values():  # also topics whose messages are not read
                topics.meet(declared.topic, channel_type(declared, summary.schemas.get(declared.schema_id)))
            for offset, place, message in walk_messages(path, summary, losses, chunks):
                channel = summary.channels.get(message.channel_id)
                if channel is not None:  # else it was in a chunk that is lost
                    topic = topics.meet(channel.topic, channel_type(channel, summary.schemas.get(channel.schema_id)))
                    with reported_as(f"{path}: {channel.topic}"):
                        data = _content(message, channel.message_encoding)
                    topics.add(topic, message.log_time, data, (number, offset, place))
            topics.losses += [f"{path.name}: {loss}" for loss in losses]
        return topics.sorted()

    def read(self, topic: Topic, place: Place) -> bytes:
        """Read one message of the record at this offset."""
        path = self.files[place.file]
        with reported_as(f"{path}: the record at byte {place.offset} can no longer be read"):
            status = path.stat()
            message = _messages_at(path, place.offset, (status.st_size, status.st_mtime_ns))[place.place]
            return bytes(_content(message, topic.type.message_encoding))


def _content(message: Message, encoding: str) -> Content:
    """The content of a message; in CDR a part of its chunk, which needs no copy to be decoded."""
    return unpack_message(message.data) if encoding == "cdr" else bytes(message.data)


def _chunks(path: Path, summary: Summary, window: range) -> list[int] | None:
    """Offsets of the chunks to read for a window, by a file's index.

    Beside those of the window: for each channel of calibrations and poses, the last chunk that ends before the window
    and has one of its messages, since a camera may send its calibration once; all chunks with static transforms, of
    which every node sends its own. None: all, if there is no index, or none that says what the channels are, or if
    decoding a video begins before the window.
    """
    chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)
    channels = summary.channels.values()
    kinds = {channel.id: channel_type(channel, summary.schemas.get(channel.schema_id)).kind for channel in channels}
    is_indexed = bool(chunks) and all(chunk.message_index_offsets for chunk in chunks)
    if not is_indexed or not _is_complete(summary) or "video" in kinds.values():
        return None
    compressed = [number for number, kind in kinds.items() if kind == "compressed"]
    if any(_is_video(path, summary, number, chunks) for number in compressed):
        return None
    wanted = {
        chunk.chunk_start_offset
        for chunk in chunks
        if chunk.message_end_time >= window.start and chunk.message_start_time < window.stop
    }
    for channel in channels:
        if kinds[channel.id] not in ("calibration", "transforms", "extrinsics"):
            continue
        needed = [chunk for chunk in chunks if channel.id in chunk.message_index_offsets]
        if not channel.topic.endswith("tf_static"):
            before = [chunk for chunk in needed if chunk.message_end_time < window.start]
            needed = before[-1:] or needed[:1]
        wanted.update(chunk.chunk_start_offset for chunk in needed)
    return sorted(wanted)


def _is_video(path: Path, summary: Summary, channel: int, chunks: Sequence[ChunkIndex]) -> bool:
    """Whether the first compressed image of a channel is a packet of a video."""
    first = [chunk.chunk_start_offset for chunk in chunks if channel in chunk.message_index_offsets][:1]
    of = summary.channels[channel]
    kind = channel_type(of, summary.schemas.get(of.schema_id))
    try:
        message = next(found for _, _, found in walk_messages(path, summary, [], first) if found.channel_id == channel)
        return codec_of(picture(kind, _content(message, of.message_encoding), of.topic).form) is not None
    except Exception:  # there is none, or it is damaged, which its index reports
        return False
