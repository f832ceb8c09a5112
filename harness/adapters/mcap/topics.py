"""Which topics are the stereo pair: found by type and name, or one error that lists what there is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from harness.adapters.mcap.messages import MessageType
from vfoa.errors import VfoaError


class Place(NamedTuple):
    """Where one message stands: time stamp, file's index, record's offset in it, place in that record."""

    stamp_ns: int
    file: int
    offset: int
    place: int


@dataclass(slots=True)
class Topic:
    """One topic over all files. ``places`` only of what cameras send."""

    name: str
    type: MessageType
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    places: list[Place] = field(default_factory=list)

    def count_message(self, log_time_ns: int) -> None:
        """Take note of one message."""
        self.first_ns = log_time_ns if self.count == 0 else min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)
        self.count += 1

    def __str__(self) -> str:
        span_s = (self.last_ns - self.first_ns) / 1e9
        rate = f", {(self.count - 1) / span_s:.1f} Hz" if span_s > 0 else ""
        messages = f"{self.count} {'message' if self.count == 1 else 'messages'}"
        return f"{self.name} ({self.type.name}, {messages}{rate})"


def find_pair(topics: Iterable[Topic], left: str | None, right: str | None, where: str) -> tuple[Topic, Topic]:
    """The image topics: the two that are named, or the only two that differ by left and right in their names.

    Raises
    ------
    VfoaError
        If there are none, a named one is not there, or several pairs could be meant.
    """
    everything = sorted(topics, key=lambda topic: topic.name)
    images = [topic for topic in everything if topic.type.kind in ("raw", "compressed")]
    if not images:
        raise VfoaError(f"{where}: no image topics; found {_listed(everything)}")
    if left is not None and right is not None:
        return _named(images, left, "left", where), _named(images, right, "right", where)
    pairs = [
        (one, other)
        for one in images
        for other in images
        if "left" in one.name and one.name.replace("left", "right") == other.name
        if left in (None, one.name) and right in (None, other.name)
    ]
    if len(pairs) != 1:
        raise VfoaError(
            f"{where}: {len(pairs)} pairs of image topics named left and right; "
            f"say left = and right = in [source]: found {_listed(images)}"
        )
    return pairs[0]


def find_camera(topics: Iterable[Topic], image: Topic, named: str | None, where: str) -> Topic:
    """The calibration of an image topic: the one that is named, or the only one in the nearest common namespace.

    Raises
    ------
    VfoaError
        If there is none, or more than one.
    """
    cameras = sorted((topic for topic in topics if topic.type.kind == "calibration"), key=lambda topic: topic.name)
    if named is not None:
        return _named(cameras, named, "calibration", where)
    namespace = image.name
    while "/" in namespace.strip("/"):
        namespace = namespace.rpartition("/")[0]
        beside = [camera for camera in cameras if camera.name.rpartition("/")[0] == namespace]
        if len(beside) == 1:
            return beside[0]
    raise VfoaError(
        f"{where}: no single calibration topic belongs to {image.name}; say left_info = and right_info =, "
        f"or calibration = (a file), in [source]: found {_listed(cameras)}"
    )


def are_rectified(pair: tuple[Topic, Topic]) -> bool:
    """Whether both image topics are called as ROS's ``image_proc`` calls rectified ones."""
    return all("image_rect" in topic.name for topic in pair)


def _named(topics: list[Topic], name: str, side: str, where: str) -> Topic:
    for topic in topics:
        if topic.name == name:
            return topic
    raise VfoaError(f"{where}: no {side} topic {name!r}; found {_listed(topics)}")


def _listed(topics: list[Topic]) -> str:
    return ", ".join(map(str, topics)) or "none"
