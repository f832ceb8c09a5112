"""Recognise bags, list their parts, and open a part."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import zstandard
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1.reader import Header, RecordType
from rosbags.rosbag2 import Reader as Ros2Reader

from harness.files.io import read_bytes
from harness.files.parsing import parse_yaml
from harness.sources.recordings.unpacking import MOST_BYTES, unpack, zstd_size
from vfoa.errors import VfoaError

_ROS1 = b"#ROSBAG V2.0"
_SQLITE = b"SQLite format 3\0"
_MOST_COMPRESSION = 1000
"""Most times that a recording's file is larger without compression: the dark images of a camera fill a tenth."""


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS 1 bag, a SQLite file, or a folder of these that is no folder of plain MCAP."""
    return bool(_parts(path))


def bag_parts(path: Path) -> tuple[Path, ...]:
    """Return the parts to read one after the other: files, or a folder with ``metadata.yaml``.

    Raises
    ------
    VfoaError
        If the path is no bag.
    """
    if not (parts := _parts(path)):
        raise VfoaError(f"{path}: no bag; expected a .bag of ROS 1, a .db3, or a folder that ros2 bag recorded")
    return parts


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
        if part.is_file() and _starts(part, _ROS1):
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
        text = (str(error) or type(error).__name__).splitlines()[0].rstrip(".")
        is_unindexed = "not indexed" in text or "index looks damaged" in text
        hint = "; the recorder was killed; write the index with rosbag reindex" if is_unindexed else ""
        raise VfoaError(f"{part}: cannot be read as a bag: {text}{hint}") from None
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
                size = sum(len(each) for each in zstandard.ZstdDecompressor().read_to_iter(file) if each)
        if size > most:
            raise ValueError(f"{path.name} unpacks to {size} bytes; expected at most {most}")


def _bound_messages(reader: Any) -> None:
    """Decompress messages of a ROS 2 bag to the size in their heads; the library would decompress them to any."""
    if reader.compression_mode != "message":
        return
    packed = reader.messages
    reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)

    def messages(*which: Any) -> Iterator[tuple[Any, int, bytes]]:
        for connection, time_ns, data in packed(*which):
            size = zstd_size(data)
            if size is None:
                raise ValueError("a compressed message does not state its size")
            yield connection, time_ns, unpack(data, "zstd", size)

    reader.messages = messages


def _check_connections(reader: Any) -> None:
    """Check names, types and definitions: a bag's metadata is YAML, where they can be anything."""
    for connection in reader.connections:
        if not isinstance(connection.topic, str) or not isinstance(connection.msgtype, str):
            raise TypeError(f"found the topic {connection.topic!r} of type {connection.msgtype!r}; expected names")
        if not isinstance(connection.msgdef.data, str):
            raise TypeError(f"{connection.topic}: found no definition of {connection.msgtype}; expected one")


def _parts(path: Path) -> tuple[Path, ...]:
    if path.is_file():
        return (path,) if _starts(path, _ROS1) or _starts(path, _SQLITE) else ()
    if not path.is_dir():
        return ()
    noted = _metadata(path)
    if noted.get("storage_identifier") == "sqlite3" or noted.get("compression_mode"):
        return (path,)
    # A killed recorder leaves no metadata.yaml; ROS 1 never writes one.
    for suffix in ("*.bag", "*.db3"):
        if found := tuple(sorted(file for file in path.glob(suffix) if not file.name.startswith("."))):
            return found
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


def _starts(path: Path, magic: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(magic)) == magic
    except OSError:
        return False
