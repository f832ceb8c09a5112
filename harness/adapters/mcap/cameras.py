"""The calibration of each pair: from the recording's own messages, which may change with time, or from a file."""

from __future__ import annotations

import bisect
from pathlib import Path
from typing import Protocol

from harness.adapters.calibration_files.options import ImageSize, Options
from harness.adapters.calibration_files.read import read_cameras
from harness.adapters.mcap.messages import camera
from harness.adapters.mcap.recording import read_message
from harness.adapters.mcap.topics import Place, Topic
from harness.adapters.rectification import Optics, RawCalibration, RawCamera, optics


class Cameras(Protocol):
    """Knows the optics of every pair."""

    def at(self, left_ns: int, right_ns: int) -> Optics:
        """The optics when the two images were taken."""
        ...


class FileCameras:
    """One calibration for the whole recording: any file that a stereo folder may have."""

    def __init__(self, path: Path, size: ImageSize, rectified: bool) -> None:
        self._optics = optics(read_cameras([path], size, Options(rectified=rectified)))

    def at(self, left_ns: int, right_ns: int) -> Optics:
        """The same at all times."""
        return self._optics


class RecordedCameras:
    """For each image its camera's last calibration at that time, or the first one where it came later."""

    def __init__(self, files: tuple[Path, ...], topics: tuple[Topic, Topic], rectified: bool) -> None:
        self._files, self._topics, self._rectified = files, topics, rectified
        self._latest: tuple[bytes, Optics] | None = None

    def at(self, left_ns: int, right_ns: int) -> Optics:
        """Maps are computed only where the calibration changed since the last call."""
        left = self._camera(self._topics[0], left_ns)
        right = self._camera(self._topics[1], right_ns)
        key = left.key + right.key
        if self._latest is None or self._latest[0] != key:
            where = f"{self._topics[0].name} and {self._topics[1].name}"
            self._latest = key, self._optics(RawCalibration(left=left, right=right, where=where))
        return self._latest[1]

    def _optics(self, raw: RawCalibration) -> Optics:
        return optics(raw.rectified() if self._rectified else raw)

    def _camera(self, topic: Topic, stamp_ns: int) -> RawCamera:
        after = bisect.bisect_right(topic.places, stamp_ns, key=_stamp)
        place = topic.places[max(after - 1, 0)]
        path = self._files[place.file]
        message = read_message(path, place.offset, place.place)
        return camera(topic.type, message.data, f"{path}: {topic.name}")


def _stamp(place: Place) -> int:
    return place.stamp_ns
