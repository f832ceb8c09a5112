"""A recording in MCAP, of one or several files, as a container of messages."""

from __future__ import annotations

import re
from pathlib import Path

from mcap.records import Channel, ChunkIndex, Schema

from harness.sources.recordings.containers import Index, TopicIndex, Window
from harness.sources.recordings.mcap_files import (
    Walk,
    log_span_ns,
    read_message,
    recall_channels,
    summary,
    walk_messages,
)
from harness.sources.recordings.messages import MessageType, ros_name
from harness.sources.recordings.topics import Place, Topic


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
