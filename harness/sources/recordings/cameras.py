"""The calibration of each pair: from the recording's own messages, which may change over time, or from a file."""

from __future__ import annotations

import bisect
from pathlib import Path
from typing import Protocol

from harness.sources.calibration_files.options import ImageSize, Options
from harness.sources.calibration_files.read import read_cameras
from harness.sources.recordings.containers import Messages
from harness.sources.recordings.messages import camera
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
