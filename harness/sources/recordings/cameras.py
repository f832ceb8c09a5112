"""Calibrations in a recording, and the poses between its cameras."""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from harness.sources.calibration_files.read import Options, read_cameras
from harness.sources.depth_optics import Transform
from harness.sources.recordings.containers import Messages
from harness.sources.recordings.messages import MessageType, camera, fields_of, reading
from harness.sources.recordings.topics import RecordingSettings, Streams, Topic, are_rectified, find_camera
from harness.sources.rectification import ImageSize, RawCalibration, RawCamera, Rectifier
from vfoa.errors import VfoaError


class PairCameras:
    """The rectifier of each pair: of a file or numbers for all times, or of the calibrations recorded at its time.

    Parameters
    ----------
    topics, streams, container, where
        All topics of the recording, those of its frames, its messages, and its name for error messages.
    settings, folder
        The settings, and the folder of their ``calibration``.
    size
        Gives (width, height) of the images.

    Raises
    ------
    VfoaError
        If there is no calibration, or it cannot be read.
    """

    def __init__(
        self,
        topics: Collection[Topic],
        streams: Streams,
        container: Messages,
        settings: RecordingSettings,
        folder: Path,
        size: ImageSize,
        where: str,
    ) -> None:
        assert streams.right is not None
        pair = streams.left, streams.right
        self._container, self._where = container, where
        self._rectified = are_rectified(pair) if settings.rectified is None else settings.rectified
        self._topics: tuple[Topic, ...] = ()
        self._latest: tuple[bytes, Rectifier] | None = None
        if settings.camera is not None:
            self._latest = b"", Rectifier(settings.camera.pair(where))
        elif settings.calibration is not None:
            path = folder / settings.calibration
            self._latest = b"", Rectifier(read_cameras([path], size, Options(rectified=self._rectified)))
        else:
            infos = settings.left_info, settings.right_info
            self._topics = tuple(find_camera(topics, *each, where) for each in zip(pair, infos, strict=True))

    def at(self, left_ns: int, right_ns: int) -> Rectifier:
        """Return the rectifier at the time of the two images; maps are computed only if the calibration has changed."""
        if self._topics:
            left, right = (
                camera_at(topic, stamp_ns, self._container, self._where)
                for topic, stamp_ns in zip(self._topics, (left_ns, right_ns), strict=True)
            )
            if self._latest is None or self._latest[0] != left.key + right.key:
                where = f"{self._where}: {' and '.join(topic.name for topic in self._topics)}"
                raw = RawCalibration(left=left, right=right, where=where)
                self._latest = left.key + right.key, Rectifier(raw.rectified() if self._rectified else raw)
        assert self._latest is not None
        return self._latest[1]


def camera_at(topic: Topic, stamp_ns: int, container: Messages, where: str) -> RawCamera:
    """A camera's last calibration before a time, or its first one if all came later."""
    after = bisect.bisect_right(topic.places, stamp_ns, key=lambda place: place.stamp_ns)
    if not topic.places:
        raise VfoaError(f"{where}: {topic.name}: none of its calibrations can be read")
    place = topic.places[max(after - 1, 0)]
    return camera(topic.type, container.read(topic, place), f"{where}: {topic.name}")


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
        return {
            (_frame(each.header.frame_id), _frame(each.child_frame_id)): _transform(each.transform)
            for each in fields_of(kind, data, where)("transforms")
        }


def _transform(moved: Any) -> Transform:
    quaternion = [float(getattr(moved.rotation, axis)) for axis in "xyzw"]
    translation = [float(getattr(moved.translation, axis)) for axis in "xyz"]
    return Transform(rotation=Rotation.from_quat(quaternion).as_matrix(), translation_m=np.array(translation))


def _frame(name: Any) -> str:
    return str(name).removeprefix("/")  # tf's old names began with a slash


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
