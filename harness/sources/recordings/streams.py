"""Find the topics of a recording's frames: a pair, a colour image and its depth, or a pair with depth."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from harness.sources.recordings.depth_topics import depth_topics, find_colour_and_depth, is_aligned
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.recordings.topics import Topic, find_pair, named
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class Streams:
    """The topics of the frames: a left image with a right image, with depth, or with both."""

    left: Topic
    right: Topic | None
    depth: Topic | None

    @property
    def topics(self) -> tuple[Topic, ...]:
        """The topics in use."""
        return tuple(topic for topic in (self.left, self.right, self.depth) if topic is not None)


def find_streams(topics: Collection[Topic], settings: RecordingSettings, where: str) -> Streams:
    """Return the named topics; else the only pair, with the depth of its left camera; else colour and depth.

    Raises
    ------
    VfoaError
        If there are none, or several candidates.
    """
    if settings.depth is not None and settings.right is None:
        left, depth = find_colour_and_depth(topics, settings.left, settings.depth, where)
        return Streams(left=left, right=None, depth=depth)
    try:
        left, right = find_pair(topics, settings.left, settings.right, where)
    except VfoaError:
        if settings.right is not None or not depth_topics(topics):
            raise
        left, depth = find_colour_and_depth(topics, settings.left, None, where)
        return Streams(left=left, right=None, depth=depth)
    images = [topic for topic in topics if topic.is_image]
    own = [] if settings.depth is None else [named(images, settings.depth, "depth", where)]
    own = own or [
        each for each in depth_topics(topics) if is_aligned(each, left) and each.frame_id == left.frame_id != ""
    ]
    return Streams(left=left, right=right, depth=own[0] if len(own) == 1 else None)


def unused_depth(topics: Collection[Topic], streams: Streams) -> tuple[str, ...]:
    """A note if depth was recorded and is in no frame."""
    if streams.depth is not None or not (others := depth_topics(topics)):
        return ()
    names = ", ".join(topic.name for topic in others)
    return (f"depth was recorded, too, and is not of the left camera: {names}; depth = in [source] takes it instead",)
