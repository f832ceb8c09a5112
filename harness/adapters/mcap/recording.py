"""The records of one MCAP file: walked once as far as they are readable, and read again by their offset."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import breakup_chunk

from vfoa.errors import VfoaError

_MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # opcode and length of every record
_PARSED = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.STATISTICS}


@dataclass(slots=True)
class Walk:
    """What one pass through a file found besides its messages.

    ``losses`` are what could not be read, in words; ``message_counts`` by channel id, what the file's own statistics
    say was recorded (None: the file has none).
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    losses: list[str] = field(default_factory=list)
    message_counts: dict[int, int] | None = None


def walk_messages(path: Path, walk: Walk) -> Iterator[tuple[int, int, Message]]:
    """Every readable message as (record's offset in the file, place in that record, message); ``walk`` is filled.

    Holds one chunk at a time. A chunk whose checksum is wrong is left out whole. Attachments, metadata and indexes
    are stepped over.

    Raises
    ------
    VfoaError
        If the file cannot be opened or is not MCAP.
    """
    for offset, record in _records(path, walk):
        if isinstance(record, Statistics):
            walk.message_counts = dict(record.channel_message_counts)
            continue
        try:
            parts = _parts(record)
        except Exception as error:  # the decompressors' errors have no common base
            walk.losses.append(f"the chunk at byte {offset} is damaged ({_first_line(error)})")
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
    """Read one message again, of the record at this offset.

    Raises
    ------
    VfoaError
        If the file changed since it was walked.
    """
    try:
        with path.open("rb") as file:
            file.seek(offset)
            opcode, length = _HEAD.unpack(file.read(_HEAD.size))
            parts = _parts(_parse(opcode, length, file.read(length)))
            return [part for part in parts if isinstance(part, Message)][place]
    except Exception as error:
        raise VfoaError(f"{path}: the record at byte {offset} is not readable any more: {_first_line(error)}") from None


def _records(path: Path, walk: Walk) -> Iterator[tuple[int, McapRecord]]:
    try:
        size = path.stat().st_size
        file = path.open("rb")
    except OSError as error:
        raise VfoaError(f"{path}: cannot be read: {error.strerror or error}") from None
    with file:
        if (magic := file.read(len(_MAGIC))) != _MAGIC:
            raise VfoaError(f"{path}: not MCAP: it starts with {magic!r}; expected {_MAGIC!r}")
        while (head := file.read(_HEAD.size)) and len(head) == _HEAD.size:
            opcode, length = _HEAD.unpack(head)
            offset = file.tell() - _HEAD.size
            if opcode == Opcode.FOOTER:
                return
            if file.tell() + length > size:
                walk.losses.append(_cut(opcode, offset, size, file))
                return
            if opcode not in _PARSED:
                file.seek(length, 1)
                continue
            try:
                record = _parse(opcode, length, file.read(length))
            except Exception as error:  # of struct, of text decoding, of the library: all mean damage
                walk.losses.append(f"the record at byte {offset} is damaged ({_first_line(error)})")
                continue
            yield offset, record
        walk.losses.append(f"cut at byte {size}: the file has no end, what came after is lost")


def _parse(opcode: int, length: int, data: bytes) -> McapRecord:
    stream = ReadDataStream(BytesIO(data))
    match opcode:
        case Opcode.SCHEMA:
            return Schema.read(stream)
        case Opcode.CHANNEL:
            return Channel.read(stream)
        case Opcode.MESSAGE:
            return Message.read(stream, length)
        case Opcode.CHUNK:
            return Chunk.read(stream)
        case Opcode.STATISTICS:
            return Statistics.read(stream)
    raise ValueError(f"unexpected opcode {opcode}")


def _parts(record: McapRecord) -> list[McapRecord]:
    return breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]


def _cut(opcode: int, offset: int, size: int, file: BinaryIO) -> str:
    """What is known of the record that the end of the file cuts, or whose length is damaged."""
    text = f"cut at byte {size} inside the record that starts at byte {offset}"
    head = file.read(16)
    if opcode == Opcode.CHUNK and len(head) == 16:
        first_ns, last_ns = struct.unpack("<QQ", head)
        text += f" and covers {first_ns / 1e9:.3f} to {last_ns / 1e9:.3f} s"
    return f"{text}: it and all that followed are lost"


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
