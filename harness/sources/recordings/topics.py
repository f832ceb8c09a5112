"""Topics of a recording: their types, and where their messages are."""

from __future__ import annotations

import bisect
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from harness.sources.recordings.image_message import ImageMessage
from harness.sources.recordings.messages import IMAGES, Kind, MessageType, codec_of
from vfoa.errors import VfoaError, counted

_RECTIFIED = re.compile("(?:^|[/_])rect(?:ified)?(?![a-z])")


_FIRST_STEP_NS = 10 * 10**9
"""Longest time between the first image of a simulation, at 0, and the second one."""


class Place(NamedTuple):
    """Position of one message: time stamp, file's index, and two numbers by which its container finds it there."""

    stamp_ns: int
    file: int
    offset: int
    place: int


@dataclass(slots=True)
class Topic:
    """One topic over all files.

    ``places`` are kept only for camera data; those of images without a time stamp are in ``unstamped`` instead.
    ``packets`` are all packets of a video in the order of writing, each with whether a decoder can begin there.
    ``header`` is the first image without its content.
    """

    name: str
    type: MessageType
    count: int = 0
    places: list[Place] = field(default_factory=list)
    unstamped: list[Place] = field(default_factory=list)
    packets: list[tuple[Place, bool]] = field(default_factory=list)
    header: ImageMessage | None = None

    @property
    def kind(self) -> Kind | None:
        """The camera data that it carries: that of its type, or a video whose packets are compressed images."""
        if self.type.kind == "compressed" and self.header is not None and codec_of(self.header.form) is not None:
            return "video"
        return self.type.kind

    @property
    def is_image(self) -> bool:
        """Whether it carries images: raw, compressed or as packets of a video."""
        return self.type.kind in IMAGES

    @property
    def frame_id(self) -> str:
        """The coordinate frame of its messages; empty if they do not say."""
        return "" if self.header is None else self.header.frame_id

    @property
    def is_called_rectified(self) -> bool:
        """Whether its name says that its images are rectified: ``image_rect_color``, ``rect/image``, ``rectified``."""
        return bool(_RECTIFIED.search(self.name))

    def sort(self, *, by_headers: bool) -> None:
        """Put the places in the order of their stamps; those of images without one apart, if these are the headers'.

        A simulation's clock begins at 0: one image with that stamp, shortly before the next one, has it rightly.
        """
        self.places.sort()
        if not self.is_image or not by_headers:
            return
        unset = bisect.bisect_right(self.places, 0, key=lambda place: place.stamp_ns)
        if unset == 1 and len(self.places) > 1 and self.places[1].stamp_ns <= _FIRST_STEP_NS:
            return
        self.unstamped, self.places = self.places[:unset], self.places[unset:]

    def __str__(self) -> str:
        return f"{self.name} ({self.type.name}, {counted(self.count, 'message')})"


def named(topics: Iterable[Topic], name: str, role: str, where: str) -> Topic:
    """Return the topic of this name.

    Raises
    ------
    VfoaError
        If it is not among them; ``role`` names its purpose.
    """
    by_name = {topic.name: topic for topic in topics}
    if name not in by_name:
        raise VfoaError(f"{where}: no {role} topic {name!r}; found {listed(by_name.values())}")
    return by_name[name]


def listed(topics: Iterable[Topic]) -> str:
    """Topics as an error lists them."""
    return ", ".join(map(str, topics)) or "none"
