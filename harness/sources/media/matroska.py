"""Places of the pictures in a Matroska file, found by its own structure, without reading the pictures.

A recording of raw depth has a gigabyte in twenty seconds, all of which FFmpeg would read to list its pictures. Only the
elements on the way to them are known here; others are passed over by their sizes (RFC 8794, RFC 9559).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, NamedTuple

from harness.sources.media.film import open_film
from vfoa.errors import VfoaError, reported_as

_EBML = 0x1A45DFA3
_SEGMENT, _INFO, _TRACKS, _TRACK, _CLUSTER, _GROUP = 0x18538067, 0x1549A966, 0x1654AE6B, 0xAE, 0x1F43B675, 0xA0
_CONTAINERS = frozenset({_SEGMENT, _INFO, _TRACKS, _TRACK, _CLUSTER, _GROUP})
_TICK_NS, _NUMBER, _CLUSTER_TIME = 0x2AD7B1, 0xD7, 0xE7
_BLOCKS = frozenset({0xA3, 0xA1})
_LACED = 0x06
_DEFAULT_TICK_NS = 1_000_000


class FilmPicture(NamedTuple):
    """The bytes of one picture in the file, the place of its track among all, and its time."""

    track: int
    time_ns: int
    offset: int
    size: int


class VideoTrack(NamedTuple):
    """A track of pictures: its place among all, its size (width, height) and its tags."""

    place: int
    size_px: tuple[int, int]
    tags: Mapping[str, str]


class MatroskaHead(NamedTuple):
    """What a file says before its pictures: its tags, the tracks of pictures by title, the attached files by name."""

    tags: Mapping[str, str]
    tracks: Mapping[str, VideoTrack]
    attachments: Mapping[str, bytes]


def read_head(path: Path) -> MatroskaHead:
    """Read it by FFmpeg; raises :class:`VfoaError` if it is not a film."""
    opened = reported_as(f"{path}: cannot be read as a film")
    with opened, open_film(path) as container:
        tracks = {
            stream.metadata.get("title", ""): VideoTrack(stream.index, (stream.width, stream.height), stream.metadata)
            for stream in container.streams.video
        }
        attachments = {str(stream.name): bytes(stream.data or b"") for stream in container.streams.attachments}
        return MatroskaHead(container.metadata, tracks, attachments)


def read_blocks(path: Path) -> list[FilmPicture]:
    """The blocks of all tracks in the order of writing; up to the end of a file that was cut off.

    Raises
    ------
    VfoaError
        If it is not a Matroska file, or several pictures share a block.
    """
    with reported_as(f"{path}: not a Matroska file"), path.open("rb") as file:
        if _read_vint(file, keep_marker=True) != _EBML:
            raise ValueError("its first bytes are not those of one")
        file.seek(0)
        return list(_blocks(file, path.stat().st_size, path))


def _blocks(file: BinaryIO, end: int, path: Path) -> Iterator[FilmPicture]:
    tick_ns, cluster_time = _DEFAULT_TICK_NS, 0
    tracks: dict[int, int] = {}
    while (element := _next(file, end)) is not None:
        kind, size = element
        begin = file.tell()
        if kind in _CONTAINERS:
            continue
        if kind == _TICK_NS:
            tick_ns = _integer(file, size)
        elif kind == _NUMBER:
            tracks.setdefault(_integer(file, size), len(tracks))
        elif kind == _CLUSTER_TIME:
            cluster_time = _integer(file, size)
        elif kind in _BLOCKS:
            number = _read_vint(file)
            head = file.read(3)
            if head[2] & _LACED:
                raise VfoaError(f"{path}: several pictures share a block at byte {begin}; expected one in each block")
            offset = file.tell()
            time = cluster_time + int.from_bytes(head[:2], "big", signed=True)
            if number in tracks and begin + size <= end:
                yield FilmPicture(tracks[number], time * tick_ns, offset, begin + size - offset)
        file.seek(begin + size)


def _next(file: BinaryIO, end: int) -> tuple[int, int] | None:
    """The identifier and the size of the element that follows; None at the end, also in the middle of its head."""
    try:
        if file.tell() >= end:
            return None
        return _read_vint(file, keep_marker=True), _read_vint(file)
    except IndexError:
        return None


def _read_vint(file: BinaryIO, *, keep_marker: bool = False) -> int:
    """A number of variable length: as many bytes as its first one has leading zeros, and one; IndexError at the end."""
    first = file.read(1)[0]
    length = 9 - first.bit_length()
    if length > 8:
        raise ValueError("a number of more than 8 bytes")
    rest = file.read(length - 1)
    if len(rest) < length - 1:
        raise IndexError
    value = first if keep_marker else first & ((1 << (8 - length)) - 1)
    return int.from_bytes(bytes([value]) + rest, "big")


def _integer(file: BinaryIO, size: int) -> int:
    if size > 8:
        raise ValueError(f"an integer of {size} bytes")
    return int.from_bytes(file.read(size), "big")
