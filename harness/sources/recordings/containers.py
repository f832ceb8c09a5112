"""What the file formats of recordings share: the protocol, the index of messages, bounded decompression."""

from __future__ import annotations

import bz2
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from harness.files.ascending import natural_order
from harness.sources.recordings.messages import IMAGES, Content, MessageType, layout_of, picture, stamp_ns
from harness.sources.recordings.topics import Place, Topic
from harness.sources.recordings.video import begins_video
from vfoa.errors import VfoaError

MOST_BYTES = 2**28
"""Bytes that a decompressed chunk or message may always have; writers begin a new chunk after 1 to 4 MB, or a larger
message."""

_MOST_COMPRESSION = 100
_MOST_CHUNK_BYTES = 2**31
"""Some recorders write one chunk for seconds or minutes of images: these may have so many times their compressed bytes,
up to this size."""

_ZSTD = b"\x28\xb5\x2f\xfd"
"""The first bytes of data in Zstandard; plain CDR begins with 0."""


class TooLargeError(ValueError):
    """A chunk or message is larger than what is read; it is not damaged."""


def unpack(data: Content, compression: str, size: int) -> Content:
    """Return the bytes of a chunk, decompressed to the size that it states.

    Raises
    ------
    TooLargeError
        If the size is too large.
    ValueError
        If the size is wrong, or the compression is not lz4, zstd, bz2, none or "".
    Exception
        If the data are damaged: the libraries have errors of their own.
    """
    most = max(MOST_BYTES, min(_MOST_COMPRESSION * len(data), _MOST_CHUNK_BYTES))
    if size > most:
        raise TooLargeError(f"it claims {size} bytes; expected at most {most}")
    match compression:
        case "zstd":
            data = zstandard.ZstdDecompressor(max_window_size=2**31).stream_reader(data).read(size + 1)
        case "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        case "bz2":
            data = bz2.BZ2Decompressor().decompress(data, max_length=size + 1)
        case "" | "none":
            pass
        case _:
            raise ValueError(f"compression {compression!r}; expected lz4, zstd, bz2 or none")
    if len(data) != size:
        raise ValueError(f"it does not unpack to the {size} bytes that it claims")
    return data


def unpack_message(data: Content) -> Content:
    """Return a message in CDR, decompressed if ``ros2 bag record --compression-mode message`` compressed it.

    Raises
    ------
    ValueError
        If its size is too large, wrong, or not stated; the library has errors of its own for damaged data.
    """
    if data[: len(_ZSTD)] != _ZSTD:
        return data
    size = zstd_size(data)
    if size is None:
        raise ValueError("a message compressed by rosbag2 (zstd) does not state its size")
    return unpack(data, "zstd", size)


def is_zstd(path: Path) -> bool:
    """Whether a file is compressed as a whole, as ``ros2 bag record --compression-mode file`` leaves it."""
    return starts_with(path, _ZSTD)


def starts_with(path: Path, magic: bytes) -> bool:
    """Whether a path is a file with these first bytes; False for one that cannot be read."""
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            return file.read(len(magic)) == magic
    except OSError:
        return False


def files_in(folder: Path, suffix: str) -> tuple[Path, ...]:
    """The files of a folder with a suffix, such as ``.mcap``, in natural order: ``take_2`` before ``take_10``.

    Hidden ones are left out: macOS leaves ``._a.mcap`` beside ``a.mcap``.
    """
    found = (path for path in folder.glob(f"*{suffix}") if not path.name.startswith("."))
    return tuple(sorted(found, key=lambda path: natural_order(path.name)))


def zstd_size(head: Content) -> int | None:
    """The size that the head of data in Zstandard states, bytes; None if it states none. Raises as :func:`unpack`."""
    size: int = zstandard.get_frame_parameters(head).content_size
    return None if size == zstandard.CONTENTSIZE_UNKNOWN else size


def window_of(span_ns: tuple[int, int] | None, start_s: float | None, end_s: float | None, where: str) -> range | None:
    """Return the log times, ns, between two times in seconds after the first message's; None if neither is given.

    ``span_ns`` are the log times of the first and the last message.

    Raises
    ------
    VfoaError
        If the recording ends before the window begins, or has no message.
    """
    if start_s is None and end_s is None:
        return None
    if span_ns is None:
        raise VfoaError(f"{where}: no messages; expected a recording with images")
    first, last = span_ns
    start = first + round((start_s or 0) * 1e9)
    if start > last:
        raise VfoaError(f"{where}: source.start_s: found {start_s:g}; the recording lasts {(last - first) / 1e9:.3f} s")
    return range(start, last + 1 if end_s is None else first + round(end_s * 1e9))


class TopicIndex:
    """The topics of a recording by name, collected message by message, and a note for each loss.

    It keeps one small entry per message of a camera.

    Parameters
    ----------
    files
        For error messages.
    window
        Only images of these log times, ns, are indexed. Calibrations, transforms and video packets of all times are
        indexed, because images within the window may need them.
    by_log_time
        Use the times at which messages were recorded, not those in their headers.
    """

    def __init__(self, files: Sequence[Path], window: range | None, *, by_log_time: bool) -> None:
        self._files, self._window, self._by_log_time = files, window, by_log_time
        self.topics: list[Topic] = []
        """All topics, once :meth:`sorted` has been called."""
        self.losses: list[str] = []
        self._topics: dict[tuple[str, str, str, str], Topic] = {}

    def meet(self, name: str, kind: MessageType) -> Topic:
        """Return the topic of this name and type of messages; a new one if it is not known yet.

        The definitions of a type may differ in comments, as those of two recorders do: the first one counts. With other
        fields, it is another type.
        """
        return self._topics.setdefault((name, kind.message_encoding, kind.name, layout_of(kind)), Topic(name, kind))

    def add(self, topic: Topic, log_time_ns: int, data: Content, address: tuple[int, int, int]) -> None:
        """Index one message; ``address`` is its file's index and the two numbers by which its container finds it.

        Raises
        ------
        VfoaError
            If a message of a camera cannot be decoded.
        """
        is_in_window = self._window is None or log_time_ns in self._window
        if not is_in_window and topic.type.kind in (None, "raw"):
            return
        where = f"{self._files[address[0]]}: {topic.name}"
        if topic.header is None and topic.type.kind in IMAGES:
            topic.header = replace(picture(topic.type, data, where), data=b"")
        kind = topic.kind
        if not is_in_window and kind == "compressed":
            return
        if is_in_window:
            topic.count += 1
        if kind is None:
            return
        has_header = (kind in IMAGES or kind == "calibration") and topic.type.has_stamps
        stamp = log_time_ns if self._by_log_time or not has_header else stamp_ns(topic.type, data, where)
        place = Place(stamp, *address)
        if is_in_window or kind != "video":
            topic.places.append(place)
        if kind == "video":
            topic.packets.append((place, begins_video(topic.type, data, where)))

    def sorted(self) -> TopicIndex:
        """The same, with the places of each topic in the order of their stamps (:meth:`Topic.sort`).

        Of several types of images (or calibrations) under one name, the one with the most messages counts; of equal
        ones, raw.
        """
        alike = defaultdict[tuple[str, str | None], list[Topic]](list)
        for topic in self._topics.values():
            topic.sort(by_headers=topic.type.has_stamps and not self._by_log_time)
            alike[topic.name, "image" if topic.is_image else topic.kind].append(topic)
        for (name, role), topics in alike.items():
            if role not in ("image", "calibration"):
                self.topics += topics
                continue
            kept = max(topics, key=lambda topic: (len(topic.places), topic.kind == "raw"))
            self.topics.append(kept)
            self.losses += [
                f"{name}: {len(topic.places)} messages of {topic.type.name} are left out, {len(kept.places)} of "
                f"{kept.type.name}{' with other fields' * (topic.type.name == kept.type.name)} are read"
                for topic in topics
                if topic is not kept and topic.places
            ]
        return self


class Container(Protocol):
    """One recording of one or several files. It holds no messages, and can be pickled to another process."""

    @property
    def files(self) -> tuple[Path, ...]:
        """All files on which messages depend, in order."""

    def types(self) -> Iterator[tuple[str, MessageType]]:
        """Each topic, as soon as it is found, and the type of its messages; raises as :meth:`index`."""

    def poses(self, losses: list[str]) -> Iterator[tuple[int, str, MessageType, int, bytes]]:
        """Each message of poses: its file's index, topic, type, log time, ns, and content; raises as :meth:`index`.

        ``losses`` gets a description of each unreadable part.
        """

    def span_ns(self) -> tuple[int, int] | None:
        """Log times of the first and the last message; None without messages."""

    def index(self, window: range | None, *, by_log_time: bool) -> TopicIndex:
        """Read all messages once and index them; ``window`` are log times, ns (:func:`window_of`).

        Raises
        ------
        VfoaError
            If a file is not of this format, or a camera's message cannot be decoded.
        """

    def read(self, topic: Topic, place: Place) -> bytes:
        """Read one message again.

        Raises
        ------
        VfoaError
            If the file has changed since it was indexed.
        """
