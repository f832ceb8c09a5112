"""Follow the records of an MCAP file while it is being written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event

from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from harness.files.io import unreadable
from harness.sources.mcap.records import HEAD, MAGIC, PARSED, parse_record, parts_of
from vfoa.errors import VfoaError

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
        for part in parts_of(parse_record(opcode, len(data), data)):
            if isinstance(part, Schema | Channel | Message):
                yield part
