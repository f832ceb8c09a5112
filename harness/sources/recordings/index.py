"""The index of a recording: the place of each camera message, and the losses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.sources.recordings.message_types import IMAGES, MessageType
from harness.sources.recordings.messages import sight, stamp_ns
from harness.sources.recordings.topics import Place, Topic
from harness.sources.recordings.video_packets import begins_video
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Log times from ``start_ns`` to before ``end_ns`` (None: to the end)."""

    start_ns: int
    end_ns: int | None

    def __contains__(self, log_time_ns: int) -> bool:
        return self.start_ns <= log_time_ns and (self.end_ns is None or log_time_ns < self.end_ns)

    def overlaps(self, first_ns: int, last_ns: int) -> bool:
        """Whether a message between these two log times may lie in the window."""
        return last_ns >= self.start_ns and (self.end_ns is None or first_ns < self.end_ns)


def window_of(span_ns: tuple[int, int] | None, start_s: float | None, end_s: float | None, where: str) -> Window | None:
    """Return the window between two times in seconds after the recording's first message; None if neither is given.

    ``span_ns`` are the log times of the first and the last message.

    Raises
    ------
    VfoaError
        If the recording ends before the window begins, or has no message.
    """
    if start_s is None and end_s is None:
        return None
    if span_ns is None:
        raise VfoaError(f"{where}: no messages")
    first, last = span_ns
    start = first + round((start_s or 0) * 1e9)
    if start > last:
        raise VfoaError(f"{where}: source.start_s: found {start_s:g}; the recording lasts {(last - first) / 1e9:.3f} s")
    return Window(start_ns=start, end_ns=None if end_s is None else first + round(end_s * 1e9))


@dataclass(frozen=True, slots=True, kw_only=True)
class Index:
    """All topics by name, and a note for each loss.

    ``cut_spans_ns`` has, for each truncated file, the log times of the chunk in which it ends (None: in no chunk).
    ``recorded`` are the numbers of recorded messages by topic, if metadata beside the files give them and the files do
    not.
    """

    topics: dict[str, Topic]
    losses: tuple[str, ...] = ()
    cut_spans_ns: tuple[tuple[int, int] | None, ...] = ()
    recorded: dict[str, int] | None = None


class TopicIndex:
    """Collects the topics of a recording, message by message; keeps one small entry per message of a camera.

    Parameters
    ----------
    files
        For error messages.
    window
        Only images of these log times are indexed. All calibrations, transforms and video packets are, because
        images within the window may need them.
    by_log_time
        Use the times at which messages were recorded, not those in their headers.
    """

    def __init__(self, files: Sequence[Path], window: Window | None, *, by_log_time: bool) -> None:
        self._files, self._window, self._by_log_time = files, window, by_log_time
        self.topics: dict[str, Topic] = {}

    def meet(self, name: str, kind: MessageType) -> Topic:
        """Return the topic of this name; a new one if it is not known yet."""
        if name not in self.topics:
            self.topics[name] = Topic(name, kind)
        return self.topics[name]

    def add(self, topic: Topic, log_time_ns: int, data: bytes, address: tuple[int, int, int]) -> None:
        """Index one message; ``address`` is its file's index and the two numbers by which its container finds it.

        Raises
        ------
        VfoaError
            If a message of a camera cannot be decoded.
        """
        kind = topic.type.kind
        is_in_window = self._window is None or log_time_ns in self._window
        if not is_in_window and kind in (None, "raw", "compressed"):
            return
        if is_in_window:
            topic.count_message(log_time_ns)
        if kind is None:
            return
        where = f"{self._files[address[0]]}: {topic.name}"
        if topic.sight is None and (kind in IMAGES or kind == "calibration"):
            topic.sight = sight(topic.type, data, where)
        has_header = kind in IMAGES or kind == "calibration"
        stamp = log_time_ns if self._by_log_time or not has_header else stamp_ns(topic.type, data, where)
        place = Place(stamp, *address)
        if is_in_window or kind != "video":
            topic.places.append(place)
        if kind == "video":
            topic.packets.append((place, begins_video(topic.type, data, where)))

    def sorted(self) -> dict[str, Topic]:
        """The topics with their places in the order of their stamps."""
        for topic in self.topics.values():
            topic.places.sort()
        return self.topics
