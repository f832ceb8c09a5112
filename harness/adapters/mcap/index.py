"""The index of a recording of one or several files: where each camera's messages stand, and what was lost."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from harness.adapters.mcap.messages import message_type, stamp_ns
from harness.adapters.mcap.recording import Walk, walk_messages
from harness.adapters.mcap.topics import Place, Topic
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class Index:
    """All topics by name, one sentence for each loss, and the log times between which a cut chunk's messages were."""

    files: tuple[Path, ...]
    topics: dict[str, Topic]
    losses: tuple[str, ...]
    cut_spans_ns: tuple[tuple[int, int], ...]


def recording_files(path: Path) -> tuple[Path, ...]:
    """The file itself, or the ``.mcap`` of a folder (a split recording) in natural order.

    Raises
    ------
    VfoaError
        If there is no such file, or none in the folder.
    """
    if path.is_file():
        return (path,)
    if not path.is_dir():
        raise VfoaError(f"{path}: no such file or folder; expected an MCAP recording")
    files = sorted(path.glob("*.mcap"), key=_natural)
    if not files:
        raise VfoaError(f"{path}: no .mcap in this folder; expected a recording")
    return tuple(files)


def index_recording(files: tuple[Path, ...]) -> Index:
    """Walk all files once, holding one chunk and one small entry a message of a camera.

    Raises
    ------
    VfoaError
        If a file is not MCAP, or a camera's message cannot be decoded.
    """
    topics: dict[str, Topic] = {}
    losses: list[str] = []
    cut_spans_ns: list[tuple[int, int]] = []
    for number, path in enumerate(files):
        walk = Walk()
        read: Counter[int] = Counter()
        for offset, place, message in walk_messages(path, walk):
            channel = walk.channels.get(message.channel_id)
            if channel is None:  # it stood in a chunk that is lost
                continue
            read[channel.id] += 1
            topic = topics.get(channel.topic)
            if topic is None:
                topic = Topic(channel.topic, message_type(channel, walk.schemas.get(channel.schema_id)))
                topics[channel.topic] = topic
            topic.count_message(message.log_time)
            if topic.type.kind is not None:
                stamp = stamp_ns(topic.type, message.data, f"{path}: {topic.name}")
                topic.places.append(Place(stamp, number, offset, place))
        losses += [f"{path.name}: {loss}{_counted(walk, read)}" for loss in walk.losses]
        if walk.cut_span_ns is not None:
            cut_spans_ns.append(walk.cut_span_ns)
    for topic in topics.values():
        topic.places.sort()
    return Index(files=files, topics=topics, losses=tuple(losses), cut_spans_ns=tuple(cut_spans_ns))


def _counted(walk: Walk, read: Counter[int]) -> str:
    """How much is lost, where the file's own statistics are still there."""
    if walk.message_counts is None:
        return ""
    total, kept = sum(walk.message_counts.values()), sum(read.values())
    return f"; {total - kept} of {total} messages of the file are lost in all"


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]
