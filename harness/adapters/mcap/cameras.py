"""The calibration of each pair: from the recording's own messages, which may change with time, or from a file."""

from __future__ import annotations

import bisect
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from harness.adapters.calibration import Calibration, read_calibration
from harness.adapters.mcap.messages import camera
from harness.adapters.mcap.recording import read_message
from harness.adapters.mcap.topics import Place, Topic
from harness.adapters.opencv_pair import read_opencv_pair
from harness.adapters.rectification import RawCalibration, RawCamera, Rectifier
from vfoa.types import Image


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """How a pair is brought onto common rows (None: it is there already), and the calibration it has then."""

    calibration: Calibration
    rectifier: Rectifier | None

    def rectify(self, left: Image, right: Image) -> tuple[Image, Image]:
        """Both images (H, W, 3), rectified."""
        return (left, right) if self.rectifier is None else self.rectifier.rectify(left, right)


class Cameras(Protocol):
    """Knows the optics of every pair."""

    def at(self, left_ns: int, right_ns: int) -> Optics:
        """The optics when the two images were taken."""
        ...


class FileCameras:
    """One calibration for the whole recording: any file that a stereo folder may have."""

    def __init__(self, path: Path, rectified: bool) -> None:
        is_opencv = path.suffix.lower() in (".yml", ".yaml", ".xml")
        raw = read_opencv_pair(path) if is_opencv and not rectified else None
        self._optics = (
            Optics(calibration=read_calibration(path, rectified=rectified), rectifier=None)
            if raw is None
            else _optics(raw, rectified=False)
        )

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
        key = _key(left) + _key(right)
        if self._latest is None or self._latest[0] != key:
            where = f"{self._topics[0].name} and {self._topics[1].name}"
            self._latest = key, _optics(RawCalibration(left=left, right=right, where=where), self._rectified)
        return self._latest[1]

    def _camera(self, topic: Topic, stamp_ns: int) -> RawCamera:
        after = bisect.bisect_right(topic.places, stamp_ns, key=_stamp)
        place = topic.places[max(after - 1, 0)]
        path = self._files[place.file]
        message = read_message(path, place.offset, place.place)
        return camera(topic.type, message.data, f"{path}: {topic.name}")


def _optics(raw: RawCalibration, rectified: bool) -> Optics:
    return Optics(calibration=raw.rectified(), rectifier=None if rectified else Rectifier(raw))


def _key(camera: RawCamera) -> bytes:
    matrices = b"".join(matrix.tobytes() for matrix in (camera.k, camera.d, camera.r, camera.p))
    return f"{camera.size_px} {camera.model} {camera.d.size} ".encode() + matrices


def _stamp(place: Place) -> int:
    return place.stamp_ns
