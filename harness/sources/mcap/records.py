"""The records of MCAP files: framing, parsing, and extraction from chunks."""

from __future__ import annotations

import struct
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import breakup_chunk

from harness.sources.recordings.unpacking import unpack

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode and length of every record
PARSED = {
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.MESSAGE,
    Opcode.CHUNK,
    Opcode.DATA_END,
    Opcode.CHUNK_INDEX,
    Opcode.STATISTICS,
}
_SPAN = struct.Struct("<QQ")  # first and last log time, the first fields of a chunk


def is_mcap(path: Path) -> bool:
    """Whether a path is a file that starts like MCAP; False for one that cannot be read."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def parse_record(opcode: int, length: int, data: bytes) -> McapRecord:
    """Parse a record of one of the :data:`PARSED` kinds; any exception means damage."""
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
        case Opcode.DATA_END:
            return DataEnd.read(stream)
        case Opcode.CHUNK_INDEX:
            return ChunkIndex.read(stream)
        case Opcode.STATISTICS:
            return Statistics.read(stream)
    raise ValueError(f"unexpected opcode {opcode}")


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
