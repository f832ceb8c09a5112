"""Relative poses of the cameras of a recording: static transforms (tf), and RealSense's extrinsics."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from harness.sources.depth_registration import Transform
from harness.sources.recordings.containers import Messages
from harness.sources.recordings.decoding import fields_of, reading
from harness.sources.recordings.message_types import MessageType
from harness.sources.recordings.topics import Topic

_MOST_MESSAGES = 200
"""Most messages read per topic: static transforms are sent at the beginning."""

Edges = dict[tuple[str, str], Transform]
"""(parent, child) -> parent_from_child."""


def find_transform(
    topics: Iterable[Topic], container: Messages, target: str, source: str, where: str
) -> Transform | None:
    """From frame ``source`` to frame ``target`` by the recording's transforms; None if no chain connects them."""
    edges: Edges = {}
    for topic in topics:
        if topic.type.kind == "transforms":
            for place in topic.places[:_MOST_MESSAGES]:
                edges.update(_edges(topic.type, container.read(topic, place), f"{where}: {topic.name}"))
    return _chain(edges, target, source)


def find_extrinsics(topics: Iterable[Topic], container: Messages, where: str) -> Transform | None:
    """The pose colour_from_depth sent by RealSense's driver (``.../extrinsics/depth_to_color``); None if there is none.

    ``realsense2_camera_msgs/Extrinsics``: the rotation is by columns, as in librealsense's rs2_extrinsics.
    """
    for topic in topics:
        if topic.type.kind == "extrinsics" and topic.name.endswith("depth_to_color") and topic.places:
            message_where = f"{where}: {topic.name}"
            with reading(topic.type, message_where):
                field = fields_of(topic.type, container.read(topic, topic.places[0]), message_where)
                rotation = np.array(field("rotation"), np.float64).reshape(3, 3).T
                return Transform(rotation=rotation, translation_m=np.array(field("translation"), np.float64))
    return None


def _edges(kind: MessageType, data: bytes, where: str) -> Edges:
    with reading(kind, where):
        field = fields_of(kind, data, where)
        if kind.name == "tf2_msgs/msg/TFMessage":
            found = [
                (_ns(each.header.frame_id), _ns(each.child_frame_id), each.transform) for each in field("transforms")
            ]
        elif kind.name.endswith("FrameTransforms"):
            each_of = field("transforms")
            found = [(_ns(_get(e, "parent_frame_id")), _ns(_get(e, "child_frame_id")), e) for e in each_of]
        else:
            whole = {name: field(name) for name in ("translation", "rotation")}
            found = [(_ns(field("parent_frame_id")), _ns(field("child_frame_id")), whole)]
        return {(parent, child): _transform(moved) for parent, child, moved in found}


def _transform(moved: Any) -> Transform:
    quaternion = [float(_get(_get(moved, "rotation"), axis)) for axis in "xyzw"]
    translation = [float(_get(_get(moved, "translation"), axis)) for axis in "xyz"]
    return Transform(rotation=Rotation.from_quat(quaternion).as_matrix(), translation_m=np.array(translation))


def _get(value: Any, name: str) -> Any:
    return value[name] if isinstance(value, dict) else getattr(value, name)


def _ns(frame: Any) -> str:
    return str(frame).removeprefix("/")  # tf's old names began with a slash


def _chain(edges: Edges, target: str, source: str) -> Transform | None:
    """The shortest chain of transforms, in either direction."""
    found = {source: Transform(rotation=np.eye(3), translation_m=np.zeros(3))}
    waiting = deque([source])
    while waiting and target not in found:
        frame = waiting.popleft()
        for other, step in _steps(edges, frame):
            if other not in found:
                found[other] = found[frame].then(step)
                waiting.append(other)
    return found.get(target)


def _steps(edges: Edges, frame: str) -> Iterator[tuple[str, Transform]]:
    for (parent, child), parent_from_child in edges.items():
        if child == frame:
            yield parent, parent_from_child
        elif parent == frame:
            yield child, parent_from_child.inverse()
