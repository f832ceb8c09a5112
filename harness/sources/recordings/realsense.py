"""Recordings of RealSense's SDK, as the Viewer writes them: ``.bag``, and ``.db3`` since version 2.58.

/device_0/sensor_1/Color_0/image/data           images; a header's frame is the number of the stream
/device_0/sensor_1/Color_0/info/camera_info     of lenses, by librealsense's names of their models
/device_0/sensor_1/Color_0/tf/1                 the pose stream_from_reference, of the same reference for all streams
/device_0/sensor_0/option/Depth_Units/value     metres per count of depth

A ``.db3`` has the poses in ``/tf_static``, and its headers name the frames.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from harness.sources.recordings.bags import BagContainer
from harness.sources.recordings.containers import Container
from harness.sources.recordings.messages import fields_of, motion_in, reading
from harness.sources.recordings.topics import Topic
from vfoa.errors import VfoaError
from vfoa.types import Float

_IMAGES = re.compile(r"(?P<stream>(?P<sensor>/device_\d+/sensor_\d+)/[^/]+)/image/data(?:/.*)?")
_UNITS = ("Depth_Units", "Depth Units")


def is_of_sdk(topic: Topic) -> bool:
    """Whether a topic has images of the SDK, by its name."""
    return _IMAGES.fullmatch(topic.name) is not None


def find_pose(topics: Iterable[Topic], container: Container, target: Topic, source: Topic) -> Float | None:
    """The motion (4, 4) from the source's frame to the target's, metres; None if the SDK's own topics have none."""
    streams = [_IMAGES.fullmatch(topic.name) for topic in (target, source)]
    if not isinstance(container, BagContainer) or None in streams:
        return None
    names = {topic.name for topic in topics}
    stems = [f"{stream['stream']}/tf/" for stream in streams if stream]
    references = [{name.removeprefix(stem) for name in names if name.startswith(stem)} for stem in stems]
    shared = min(references[0] & references[1], default=None)
    if shared is None:
        return None
    of_target, of_source = (_pose(container, stem + shared) for stem in stems)
    return None if of_target is None or of_source is None else of_target @ np.linalg.inv(of_source)


def _pose(container: BagContainer, name: str) -> Float | None:
    """stream_from_reference; None for another kind of message."""
    kind, data = container.first(name)
    if kind.name != "geometry_msgs/msg/Transform":
        return None
    with reading(kind, name):
        field = fields_of(kind, data, name)
        return motion_in(field("rotation"), field("translation"))


def metres_per_count(topics: Iterable[Topic], container: Container, depth: Topic) -> float | None:
    """The unit of depth that the recording states; None for one of another program, or without it.

    Raises
    ------
    VfoaError
        If it is no positive number.
    """
    stream = _IMAGES.fullmatch(depth.name)
    if not isinstance(container, BagContainer) or stream is None:
        return None
    names = {topic.name for topic in topics}
    named = (f"{stream['sensor']}/option/{unit}/value" for unit in _UNITS)
    name = next((name for name in named if name in names), None)
    if name is None:
        return None
    kind, data = container.first(name)
    with reading(kind, name):
        unit_m = float(fields_of(kind, data, name)("data"))  # a number, in .db3 as text
    if not 0 < unit_m < 1:
        raise VfoaError(f"{name}: found {unit_m:g}; expected metres per count, such as 0.001")
    return unit_m
