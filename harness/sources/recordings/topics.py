"""Topics over all files of a recording, and the choice of the left and the right camera."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from harness.sources.recordings.message_types import IMAGES, MessageType
from harness.sources.recordings.messages import Sight
from harness.sources.side_names import pair_names
from vfoa.errors import VfoaError


class Place(NamedTuple):
    """Position of one message: time stamp, file's index, and two numbers by which its container finds it there."""

    stamp_ns: int
    file: int
    offset: int
    place: int


@dataclass(slots=True)
class Topic:
    """One topic over all files.

    ``places`` are kept only for camera data. ``packets`` are all packets of a video in the order of writing, each with
    whether a decoder can begin there. ``sight`` describes the first message.
    """

    name: str
    type: MessageType
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    places: list[Place] = field(default_factory=list)
    packets: list[tuple[Place, bool]] = field(default_factory=list)
    sight: Sight | None = None

    @property
    def is_image(self) -> bool:
        """Whether it carries images: raw, compressed or as packets of a video."""
        return self.type.kind in IMAGES

    @property
    def frame_id(self) -> str:
        """The coordinate frame of its messages; empty if they do not say."""
        return "" if self.sight is None else self.sight.frame_id

    def count_message(self, log_time_ns: int) -> None:
        """Count one message."""
        self.first_ns = log_time_ns if self.count == 0 else min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)
        self.count += 1

    def __str__(self) -> str:
        span_s = (self.last_ns - self.first_ns) / 1e9
        rate = f", {(self.count - 1) / span_s:.1f} Hz" if span_s > 0 else ""
        messages = f"{self.count} {'message' if self.count == 1 else 'messages'}"
        return f"{self.name} ({self.type.name}, {messages}{rate})"


def find_pair(topics: Iterable[Topic], left: str | None, right: str | None, where: str) -> tuple[Topic, Topic]:
    """Return the image topics: the two that are named, or the only two whose names differ only in the side.

    The sides are left and right, else cam0 and cam1, infra1 and infra2 ... (:mod:`harness.sources.side_names`).

    Raises
    ------
    VfoaError
        If there are none, a named one is missing, or there are several candidates.
    """
    everything = sorted(topics, key=lambda topic: topic.name)
    images = [topic for topic in everything if topic.is_image]
    if not images:
        raise VfoaError(f"{where}: no image topics; found {listed(everything)}")
    if left is not None and right is not None:
        return named(images, left, "left", where), named(images, right, "right", where)
    pairs = [
        (one, other)
        for one in images
        for other in images
        if "left" in one.name and one.name.replace("left", "right") == other.name
        if left in (None, one.name) and right in (None, other.name)
    ] or _numbered_pairs(images, left, right)
    if len(pairs) != 1:
        raise VfoaError(
            f"{where}: {len(pairs)} pairs of image topics named left and right; say left = and right = in [source] "
            f"(--set left=/TOPIC --set right=/TOPIC): found {listed(images)}"
        )
    return pairs[0]


def _numbered_pairs(images: list[Topic], left: str | None, right: str | None) -> list[tuple[Topic, Topic]]:
    by_name = {topic.name: topic for topic in images}
    found = [(sides.left_names[0], sides.right_names[0]) for sides in pair_names(by_name, numbered=False)]
    return [(by_name[one], by_name[other]) for one, other in found if left in (None, one) and right in (None, other)]


def find_camera(topics: Iterable[Topic], image: Topic, named_topic: str | None, where: str) -> Topic:
    """Return the calibration topic of an image topic: the named one, or the only one in the nearest common namespace.

    Raises
    ------
    VfoaError
        If there is none, or more than one.
    """
    cameras = sorted((topic for topic in topics if topic.type.kind == "calibration"), key=lambda topic: topic.name)
    if named_topic is not None:
        return named(cameras, named_topic, "calibration", where)
    namespace = image.name
    while "/" in namespace.strip("/"):
        namespace = namespace.rpartition("/")[0]
        places = (namespace, f"{namespace}/info")  # RealSense's SDK writes them to the second
        beside = [camera for camera in cameras if camera.name.rpartition("/")[0] in places]
        if len(beside) == 1:
            return beside[0]
    given = "or a calibration: --calibration FILE, or --fx --cx --cy --baseline ([source.camera])"
    raise VfoaError(
        f"{where}: no single calibration topic belongs to {image.name}; found {listed(cameras)}; expected "
        f"{f'left_info = and right_info = in [source], {given}' if cameras else given.removeprefix('or ')}"
    )


def are_rectified(pair: tuple[Topic, Topic]) -> bool:
    """Whether both image topics have the names of ROS's ``image_proc`` for rectified images."""
    return all("image_rect" in topic.name for topic in pair)


def named(topics: Iterable[Topic], name: str, role: str, where: str) -> Topic:
    """Return the topic of this name.

    Raises
    ------
    VfoaError
        If it is not among them; ``role`` names its purpose.
    """
    found = list(topics)
    for topic in found:
        if topic.name == name:
            return topic
    raise VfoaError(f"{where}: no {role} topic {name!r}; found {listed(found)}")


def listed(topics: Iterable[Topic]) -> str:
    """Topics as an error lists them."""
    return ", ".join(map(str, topics)) or "none"
