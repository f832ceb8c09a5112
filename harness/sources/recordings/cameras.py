"""Calibrations in a recording, and the poses between its cameras."""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from harness.sources.calibration_files.options import ImageSize, Options
from harness.sources.calibration_files.read import read_cameras
from harness.sources.depth_optics import Transform
from harness.sources.recordings.containers import Messages
from harness.sources.recordings.messages import MessageType, camera, fields_of, reading
from harness.sources.recordings.topics import Place, Topic
from harness.sources.rectification import Optics, RawCalibration, RawCamera, optics
from vfoa.errors import VfoaError


class Cameras(Protocol):
    """Gives the optics of every pair."""

    def at(self, left_ns: int, right_ns: int) -> Optics:
        """Return the optics at the time of the two images."""
        ...


class ConstantCameras:
    """One calibration for the whole recording."""

    def __init__(self, optics: Optics) -> None:
        self._optics = optics

    def at(self, left_ns: int, right_ns: int) -> Optics:
        """The same at all times."""
        return self._optics


def file_cameras(path: Path, size: ImageSize, rectified: bool) -> ConstantCameras:
    """Read the calibration from any file that a stereo folder may have."""
    return ConstantCameras(optics(read_cameras([path], size, Options(rectified=rectified))))


class RecordedCameras:
    """The cameras' calibrations at the time of each image."""

    def __init__(self, container: Messages, topics: tuple[Topic, Topic], rectified: bool, where: str) -> None:
        self._container, self._topics, self._rectified, self._where = container, topics, rectified, where
        self._latest: tuple[bytes, Optics] | None = None

    def at(self, left_ns: int, right_ns: int) -> Optics:
        """Maps are computed only if the calibration has changed since the last call."""
        left, right = (
            camera_at(topic, stamp_ns, self._container, self._where)
            for topic, stamp_ns in zip(self._topics, (left_ns, right_ns), strict=True)
        )
        key = left.key + right.key
        if self._latest is None or self._latest[0] != key:
            where = f"{self._topics[0].name} and {self._topics[1].name}"
            self._latest = key, self._optics(RawCalibration(left=left, right=right, where=where))
        return self._latest[1]

    def _optics(self, raw: RawCalibration) -> Optics:
        return optics(raw.rectified() if self._rectified else raw)


def camera_at(topic: Topic, stamp_ns: int, container: Messages, where: str) -> RawCamera:
    """A camera's last calibration before a time, or its first one if all came later."""
    after = bisect.bisect_right(topic.places, stamp_ns, key=_stamp)
    if not topic.places:
        raise VfoaError(f"{where}: {topic.name}: none of its calibrations can be read")
    place = topic.places[max(after - 1, 0)]
    return camera(topic.type, container.read(topic, place), f"{where}: {topic.name}")


def _stamp(place: Place) -> int:
    return place.stamp_ns


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
