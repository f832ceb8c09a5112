"""The records of an MCAP file that is being written, behind its writer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event

from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema

from harness.files import unreadable
from harness.sources.mcap.records import HEAD, MAGIC, PARSED, parse_record, parts_of
from vfoa.errors import VfoaError

_POLL_S = 0.005
"""How often a file is looked at for more."""


def follow_records(path: Path, stopped: Event) -> Iterator[Schema | Channel | Message | None]:
    """Every record, and None whenever there is no whole one more for now.

    Ends with the file's footer, or soon after ``stopped`` is set. What is damaged is stepped over.

    Raises
    ------
    VfoaError
        If the file cannot be opened, is not MCAP, or was cut or replaced by a shorter one meanwhile.
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
    """The kind and the content of what is at this offset; no kind where it is not all there."""
    try:
        with path.open("rb") as file:
            file.seek(at)
            if at == 0:
                return _start(path, file.read(len(MAGIC)))
            head = file.read(HEAD.size)
            if len(head) < HEAD.size:
                if path.stat().st_size < at:
                    raise VfoaError(f"{path}: is shorter than what was read of it; expected a recording that grows")
                return None, b""
            opcode, length = HEAD.unpack(head)
            if opcode == 0 or path.stat().st_size < at + HEAD.size + length:  # 0: room that a file system has made
                return None, b""
            return opcode, file.read(length)
    except OSError as error:
        raise unreadable(path, error) from None


def _start(path: Path, found: bytes) -> tuple[int | None, bytes]:
    if not MAGIC.startswith(found):
        raise VfoaError(f"{path}: not MCAP: it starts with {found!r}; expected {MAGIC!r}")
    return (_START, found) if found == MAGIC else (None, b"")


def _told(opcode: int, data: bytes) -> Iterator[Schema | Channel | Message]:
    """The contents of a record; nothing if it is damaged."""
    with suppress(Exception):  # of struct, of text decoding, of the decompressors: all mean damage
        for part in parts_of(parse_record(opcode, len(data), data)):
            if isinstance(part, Schema | Channel | Message):
                yield part
