"""A recording in MCAP, of one or several files, as a container of messages."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from harness.sources.mcap.channels import message_type
from harness.sources.mcap.chunk_choice import chunks_in
from harness.sources.mcap.recording import Walk, log_span_ns, read_message, recall_channels, walk_messages
from harness.sources.mcap.rosbag2 import recorded_counts
from harness.sources.recordings.index import Index, TopicIndex, Window
from harness.sources.recordings.topics import Place, Topic


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
        is_counted = window is not None or all(walk.message_counts is not None for walk in walks)
        return Index(
            topics=topics.sorted(),
            losses=tuple(
                f"{path.name}: {loss}" for path, walk in zip(self.files, walks, strict=True) for loss in walk.losses
            ),
            cut_spans_ns=tuple(walk.cut_span_ns for walk in walks if walk.is_cut),
            recorded=None if is_counted else recorded_counts(self.files),
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
    read: Counter[int] = Counter()
    for offset, place, message in walk_messages(path, walk, None if window is None else _chunks(path, window)):
        channel = walk.channels.get(message.channel_id)
        if channel is None:  # the channel was in a chunk that is lost
            continue
        read[channel.id] += 1
        topic = topics.meet(channel.topic, message_type(channel, walk.schemas.get(channel.schema_id)))
        topics.add(topic, message.log_time, message.data, (number, offset, place))
    if window is None:
        walk.losses = [f"{loss}{_counted(walk, read)}" for loss in walk.losses]
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


def _counted(walk: Walk, read: Counter[int]) -> str:
    """The number of lost messages, if the file's own statistics are still there."""
    if walk.message_counts is None:
        return ""
    total, kept = sum(walk.message_counts.values()), sum(read.values())
    return f"; {total - kept} of {total} messages of the file are lost in total"


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]
