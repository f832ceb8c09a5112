"""Recordings in MCAP, of one or several files: their records, and all readable messages in order."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import breakup_chunk

from harness.files.io import check_readable, unreadable
from harness.sources.recordings.containers import Index, TopicIndex, Window, unpack
from harness.sources.recordings.messages import MessageType, ros_name
from harness.sources.recordings.topics import Place, Topic
from vfoa.errors import VfoaError

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode and length of every record
_RECORDS: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE: Message,
    Opcode.CHUNK: Chunk,
    Opcode.DATA_END: DataEnd,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.STATISTICS: Statistics,
}
PARSED = _RECORDS.keys()
_SPAN = struct.Struct("<QQ")  # first and last log time, the first fields of a chunk


def parse_record(opcode: int, data: bytes) -> McapRecord:
    """Parse a record of one of the :data:`PARSED` kinds; any exception means damage."""
    stream = ReadDataStream(BytesIO(data))
    return Message.read(stream, len(data)) if opcode == Opcode.MESSAGE else _RECORDS[opcode].read(stream)


def parts_of(record: McapRecord) -> list[McapRecord]:
    """The records in a chunk; any other record alone. Any exception means damage."""
    if not isinstance(record, Chunk):
        return [record]
    data = unpack(record.data, record.compression, record.uncompressed_size)  # the library takes any size
    return breakup_chunk(replace(record, compression="", data=data), validate_crc=True)


def chunk_span_ns(opcode: int, file: BinaryIO) -> tuple[int, int] | None:
    """First and last log time in the head of the chunk at the file's position; None if the file ends before."""
    head = file.read(_SPAN.size) if opcode == Opcode.CHUNK else b""
    if len(head) < _SPAN.size:
        return None
    first_ns, last_ns = _SPAN.unpack(head)
    return first_ns, last_ns


def first_line(error: Exception) -> str:
    """An error's text in one line; its kind if it has no text."""
    return (str(error) or type(error).__name__).splitlines()[0]


_FOOTER = struct.Struct("<QQI")  # summary's offset, its offset section's, checksum
_MESSAGE = struct.Struct("<HIQ")  # channel, sequence and log time, the first fields of a message

_BLOCK_BYTES = 1 << 20


@dataclass(slots=True)
class Walk:
    """Findings of one pass through a file, beside its messages.

    ``losses`` describe unreadable parts.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    losses: list[str] = field(default_factory=list)


def walk_messages(path: Path, walk: Walk, offsets: Sequence[int] | None = None) -> Iterator[tuple[int, int, Message]]:
    """Yield every readable message as (record's offset in the file, place in that record, message); fills ``walk``.

    Holds one chunk at a time. A chunk with a wrong checksum is left out completely; messages outside chunks have one
    checksum for all, if any, which only says that something is wrong. Attachments and metadata are skipped.
    ``offsets``: read only the chunks at these offsets.

    Raises
    ------
    VfoaError
        If the file cannot be opened or is not MCAP.
    """
    recall_channels(path, walk)
    is_chunked = True
    for offset, record in _records(path, walk) if offsets is None else _records_at(path, offsets, walk):
        if isinstance(record, Statistics):
            continue
        if isinstance(record, DataEnd):
            if not is_chunked and record.data_section_crc not in (0, _checksum(path, offset)):
                walk.losses.append("the checksum of all data is wrong: it is unknown which messages are damaged")
            continue
        is_chunked = is_chunked and not isinstance(record, Message)
        try:
            parts = parts_of(record)
        except Exception as error:  # the decompressors' errors have no common base
            walk.losses.append(f"the chunk at byte {offset} is damaged ({first_line(error)})")
            continue
        messages = 0
        for part in parts:
            if isinstance(part, Schema):
                walk.schemas[part.id] = part
            elif isinstance(part, Channel):
                walk.channels[part.id] = part
            elif isinstance(part, Message):
                yield offset, messages, part
                messages += 1


def read_message(path: Path, offset: int, place: int) -> Message:
    """Read one message again, from the record at this offset.

    Raises
    ------
    VfoaError
        If the file has changed since it was indexed.
    """
    try:
        status = path.stat()
        return _messages_at(path, offset, (status.st_size, status.st_mtime_ns))[place]
    except Exception as error:
        raise VfoaError(f"{path}: the record at byte {offset} can no longer be read: {first_line(error)}") from None


@lru_cache(maxsize=2)
def _messages_at(path: Path, offset: int, _version: tuple[int, int]) -> tuple[Message, ...]:
    """The messages of one record; the last two chunks stay decompressed, since neighbours are read in turn."""
    with path.open("rb") as file:
        file.seek(offset)
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        parts = parts_of(parse_record(opcode, file.read(length)))
    return tuple(part for part in parts if isinstance(part, Message))


def summary(path: Path) -> list[McapRecord]:
    """The records at the end of a file: schemas, channels, statistics, indexes of chunks; none in a truncated file."""
    return [record for _, record in _records(path, Walk(), from_summary=True)]


def log_span_ns(path: Path) -> tuple[int, int] | None:
    """First and last log time of a file: from its statistics, or else its records' heads; None without messages."""
    for record in summary(path):
        if isinstance(record, Statistics) and record.message_count:
            return record.message_start_time, record.message_end_time
    spans = list(_spans(path))
    return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else None


def recall_channels(path: Path, walk: Walk) -> None:
    """Read schemas and channels from the summary, if there is one: the chunk with the first ones may be lost."""
    for record in summary(path):
        if isinstance(record, Schema):
            walk.schemas[record.id] = record
        elif isinstance(record, Channel):
            walk.channels[record.id] = record


def _records(path: Path, walk: Walk, *, from_summary: bool = False) -> Iterator[tuple[int, McapRecord]]:
    check_readable(path)
    try:
        size = path.stat().st_size
        file = path.open("rb")
    except OSError as error:
        raise unreadable(path, error) from None
    with file:
        if (magic := file.read(len(MAGIC))) != MAGIC:
            raise VfoaError(f"{path}: not MCAP: it starts with {magic!r}; expected {MAGIC!r}")
        if from_summary:
            file.seek(_summary_start(file, size))
        while (head := file.read(HEAD.size)) and len(head) == HEAD.size:
            opcode, length = HEAD.unpack(head)
            offset = file.tell() - HEAD.size
            if opcode == Opcode.FOOTER:
                return
            if file.tell() + length > size:
                walk.losses.append(f"cut at byte {size}: the record at byte {offset} and everything after it are lost")
                return
            if opcode == 0:  # no such record: zeros of the file system
                walk.losses.append(f"damaged at byte {offset}: everything after it is lost")
                return
            if opcode not in PARSED:
                file.seek(length, 1)
                continue
            try:
                record = parse_record(opcode, file.read(length))
            except Exception as error:  # errors of struct, text decoding or the library: all mean damage
                walk.losses.append(f"the record at byte {offset} is damaged ({first_line(error)})")
                continue
            yield offset, record
        walk.losses.append(f"cut at byte {size}: everything after it is lost")


def _records_at(path: Path, offsets: Sequence[int], walk: Walk) -> Iterator[tuple[int, McapRecord]]:
    with path.open("rb") as file:
        for offset in offsets:
            file.seek(offset)
            try:
                opcode, length = HEAD.unpack(file.read(HEAD.size))
                record = parse_record(opcode, file.read(length))
            except Exception as error:  # as above; also an index that leads nowhere
                walk.losses.append(f"the chunk at byte {offset} is damaged ({first_line(error)})")
                continue
            yield offset, record


def _spans(path: Path) -> Iterator[tuple[int, int]]:
    """First and last log time of each whole chunk and message, from its first bytes."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(len(MAGIC))
        while len(head := file.read(HEAD.size)) == HEAD.size:
            opcode, length = HEAD.unpack(head)
            end = file.tell() + length
            if end > size or opcode in (0, Opcode.FOOTER):
                return
            if (span := chunk_span_ns(opcode, file)) is not None:
                yield span
            elif opcode == Opcode.MESSAGE and length >= _MESSAGE.size:
                log_time_ns = _MESSAGE.unpack(file.read(_MESSAGE.size))[2]
                yield log_time_ns, log_time_ns
            file.seek(end)


def _checksum(path: Path, end: int) -> int:
    """CRC-32 of a file's bytes before ``end``."""
    crc = 0
    with path.open("rb") as file:
        while data := file.read(min(_BLOCK_BYTES, end - file.tell())):
            crc = zlib.crc32(data, crc)
    return crc


def _summary_start(file: BinaryIO, size: int) -> int:
    """The summary's offset from the footer; the end of the file if there is neither."""
    file.seek(max(size - HEAD.size - _FOOTER.size - len(MAGIC), 0))
    opcode, _ = HEAD.unpack(file.read(HEAD.size).ljust(HEAD.size, b"\0"))
    tail = file.read()
    if opcode != Opcode.FOOTER or len(tail) != _FOOTER.size + len(MAGIC) or not tail.endswith(MAGIC):
        return size
    summary_start = int(_FOOTER.unpack_from(tail)[0])
    return summary_start if 0 < summary_start < size else size


def message_type(channel: Channel, schema: Schema | None) -> MessageType:
    """Return the type of a channel's messages; a channel may have no schema."""
    name = "no schema" if schema is None else schema.name
    return MessageType(
        message_encoding=channel.message_encoding,
        schema_encoding="" if schema is None else schema.encoding,
        name=ros_name(name) if channel.message_encoding == "ros1" else name,
        schema=b"" if schema is None else schema.data,
    )


def chunks_in(path: Path, window: Window, once: set[int]) -> list[int] | None:
    """Return the offsets of the chunks to read for a window, by the file's index; None if the file has none.

    Beside those of the window: for each channel of ``once``, the last chunk before the window with one of its messages,
    since a camera may send its calibration once.
    """
    chunks = sorted(
        (each for each in summary(path) if isinstance(each, ChunkIndex)), key=lambda each: each.chunk_start_offset
    )
    if not chunks or not all(each.message_index_offsets for each in chunks):
        return None
    wanted = {
        each.chunk_start_offset for each in chunks if window.overlaps(each.message_start_time, each.message_end_time)
    }
    for channel in once:
        holding = [each for each in chunks if channel in each.message_index_offsets]
        before = [each for each in holding if each.message_start_time < window.start_ns]
        wanted.update(each.chunk_start_offset for each in (before[-1:] or holding[:1]))
    return sorted(wanted)


class McapContainer:
    """The files of one MCAP recording (see :class:`harness.sources.recordings.containers.Container`).

    Unreadable parts (a truncated file, a wrong checksum) are left out, and noted in the index.
    """

    def __init__(self, files: tuple[Path, ...]) -> None:
        self.files = files

    def span_ns(self) -> tuple[int, int] | None:
        """Log times from summaries, or without these from the heads of the records; reads no message."""
        spans = [span for path in self.files if (span := log_span_ns(path)) is not None]
        return (min(first for first, _ in spans), max(last for _, last in spans)) if spans else None

    def index(self, window: Window | None, *, by_log_time: bool) -> Index:
        """Read all files once, one chunk at a time. If the files have indexes, only a window's chunks are read."""
        topics = TopicIndex(self.files, window, by_log_time=by_log_time)
        walks = [_index_file(number, path, topics, window) for number, path in enumerate(self.files)]
        return Index(
            topics=topics.sorted(),
            losses=tuple(
                f"{path.name}: {loss}" for path, walk in zip(self.files, walks, strict=True) for loss in walk.losses
            ),
        )

    def read(self, topic: Topic, place: Place) -> bytes:
        """Read one message of the record at this offset."""
        return read_message(self.files[place.file], place.offset, place.place).data


def files_in(folder: Path) -> tuple[Path, ...]:
    """The ``.mcap`` of a folder in natural order, without hidden ones (macOS leaves ``._a.mcap`` beside ``a.mcap``)."""
    return tuple(sorted((path for path in folder.glob("*.mcap") if not path.name.startswith(".")), key=_natural))


def _index_file(number: int, path: Path, topics: TopicIndex, window: Window | None) -> Walk:
    """Add the messages of one file to the topics; the returned walk says what was lost."""
    walk = Walk()
    for offset, place, message in walk_messages(path, walk, None if window is None else _chunks(path, window)):
        channel = walk.channels.get(message.channel_id)
        if channel is None:  # the channel was in a chunk that is lost
            continue
        topic = topics.meet(channel.topic, message_type(channel, walk.schemas.get(channel.schema_id)))
        topics.add(topic, message.log_time, message.data, (number, offset, place))
    return walk


def _chunks(path: Path, window: Window) -> list[int] | None:
    """Offsets of the chunks to read for a window. None: all, since decoding a video begins before the window."""
    walk = Walk()
    recall_channels(path, walk)
    types = {number: message_type(each, walk.schemas.get(each.schema_id)) for number, each in walk.channels.items()}
    if any(each.kind == "video" for each in types.values()):
        return None
    once = {number for number, each in types.items() if each.kind in ("calibration", "transforms", "extrinsics")}
    return chunks_in(path, window, once)


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]
