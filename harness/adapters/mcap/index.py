"""The index of a recording of one or several files: where each camera's messages stand, and what was lost."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from harness.adapters.mcap.messages import message_type, stamp_ns
from harness.adapters.mcap.recording import Walk, recall_channels, walk_messages
from harness.adapters.mcap.rosbag2 import recorded_counts
from harness.adapters.mcap.topics import Place, Topic
from harness.adapters.mcap.window import Window, chunks_in
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class Index:
    """All topics by name, and one sentence for each loss.

    ``cut_spans_ns`` has, for each file that was cut, the log times of the chunk that it ends in (None: in no chunk).
    ``recorded`` are the messages by topic that were recorded, where the files do not say it themselves but what
    stands beside them does.
    """

    files: tuple[Path, ...]
    topics: dict[str, Topic]
    losses: tuple[str, ...]
    cut_spans_ns: tuple[tuple[int, int] | None, ...]
    recorded: dict[str, int] | None


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
    files = files_in(path)
    if not files:
        raise VfoaError(f"{path}: no .mcap in this folder; expected a recording")
    return files


def files_in(folder: Path) -> tuple[Path, ...]:
    """The ``.mcap`` of a folder in natural order, without hidden ones (macOS leaves ``._a.mcap`` beside ``a.mcap``)."""
    return tuple(sorted((path for path in folder.glob("*.mcap") if not path.name.startswith(".")), key=_natural))


def index_recording(files: tuple[Path, ...], window: Window | None = None, *, by_log_time: bool = False) -> Index:
    """Walk all files once, holding one chunk and one small entry a message of a camera.

    Parameters
    ----------
    files
        The recording's.
    window
        Only images of these log times; calibrations sent before them are taken, too. Found by the files' indexes,
        where they have them.
    by_log_time
        Stamps are the times at which messages were recorded, not those in their headers.

    Raises
    ------
    VfoaError
        If a file is not MCAP, or a camera's message cannot be decoded.
    """
    topics: dict[str, Topic] = {}
    walks = [_index_file(number, path, topics, window, by_log_time) for number, path in enumerate(files)]
    for topic in topics.values():
        topic.places.sort()
    is_counted = window is not None or all(walk.message_counts is not None for walk in walks)
    return Index(
        files=files,
        topics=topics,
        losses=tuple(f"{path.name}: {loss}" for path, walk in zip(files, walks, strict=True) for loss in walk.losses),
        cut_spans_ns=tuple(walk.cut_span_ns for walk in walks if walk.is_cut),
        recorded=None if is_counted else recorded_counts(files),
    )


def _index_file(number: int, path: Path, topics: dict[str, Topic], window: Window | None, by_log_time: bool) -> Walk:
    """Add what one file holds to the topics; the walk says what was lost."""
    walk = Walk()
    read: Counter[int] = Counter()
    for offset, place, message in walk_messages(path, walk, None if window is None else _chunks(path, window)):
        channel = walk.channels.get(message.channel_id)
        if channel is None:  # it stood in a chunk that is lost
            continue
        read[channel.id] += 1
        topic = topics.get(channel.topic)
        if topic is None:
            topic = Topic(channel.topic, message_type(channel, walk.schemas.get(channel.schema_id)))
            topics[channel.topic] = topic
        if window is not None and message.log_time not in window and topic.type.kind != "calibration":
            continue
        topic.count_message(message.log_time)
        if topic.type.kind is not None:
            stamp = message.log_time
            if not by_log_time:
                stamp = stamp_ns(topic.type, message.data, f"{path}: {topic.name}")
            topic.places.append(Place(stamp, number, offset, place))
    if window is None:
        walk.losses = [f"{loss}{_counted(walk, read)}" for loss in walk.losses]
    return walk


def _chunks(path: Path, window: Window) -> list[int] | None:
    """The chunks to read for a window; None: all."""
    walk = Walk()
    recall_channels(path, walk)
    types = {number: message_type(each, walk.schemas.get(each.schema_id)) for number, each in walk.channels.items()}
    return chunks_in(path, window, {number for number, each in types.items() if each.kind == "calibration"})


def _counted(walk: Walk, read: Counter[int]) -> str:
    """How much is lost, where the file's own statistics are still there."""
    if walk.message_counts is None:
        return ""
    total, kept = sum(walk.message_counts.values()), sum(read.values())
    return f"; {total - kept} of {total} messages of the file are lost in all"


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]
