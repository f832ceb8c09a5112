"""A stereo clip from an MCAP recording: one file, or a folder of the files into which it was split."""

from __future__ import annotations

import hashlib
from functools import cached_property
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from harness.adapters import Recognised, Truth
from harness.adapters.mcap.cameras import Cameras, FileCameras, RecordedCameras
from harness.adapters.mcap.index import Index, files_in, index_recording, recording_files
from harness.adapters.mcap.pairing import join, of_distinct_stamps
from harness.adapters.mcap.pixels import read_image
from harness.adapters.mcap.recording import read_message
from harness.adapters.mcap.records import is_mcap
from harness.adapters.mcap.topics import Place, Topic, are_rectified, find_camera, find_pair
from harness.adapters.mcap.window import find_window
from harness.files import digest_files
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.types import Image, StereoFrame

_SHOWN = 3
"""Losses that an error lists."""


class McapSettings(Settings):
    """Which recording under the manifest's root, and what its topics and types do not tell.

    ``left`` and ``right`` are image topics, ``left_info`` and ``right_info`` those of their calibrations, or
    ``calibration`` is a file under the root. Stamps of a pair are at most ``tolerance_ms`` apart. ``rectified``
    says whether the images are rectified already; unsaid, topics with ``image_rect`` in their names are. ``start_s``
    and ``end_s`` cut out a part, in seconds after the recording's first message. ``stamps`` are those of the headers
    (when an image was taken), or of the log (when it was recorded), for headers that were not set.
    """

    recording: str = "."
    left: str | None = None
    right: str | None = None
    left_info: str | None = None
    right_info: str | None = None
    calibration: str | None = None
    rectified: bool | None = None
    tolerance_ms: float = Field(default=2.0, ge=0)
    start_s: float | None = Field(default=None, ge=0)
    end_s: float | None = Field(default=None, gt=0)
    stamps: Literal["header", "log"] = "header"

    @model_validator(mode="after")
    def _a_part(self) -> Self:
        if self.end_s is not None and self.end_s <= (self.start_s or 0):
            raise ValueError(f"found end_s {self.end_s:g}; expected more than start_s, {self.start_s or 0:g}")
        return self


class McapClip:
    """A recorded stereo pair; frames are numbered from 1 in the order of their stamps.

    root/recording.mcap      or root/recording_0.mcap, recording_1.mcap ...
      /stereo/left/image_raw       sensor_msgs/msg/Image, CompressedImage; foxglove.RawImage, CompressedImage
      /stereo/left/camera_info     sensor_msgs/msg/CameraInfo; foxglove.CameraCalibration; P_right[0, 3] = -fx B
      /stereo/right/...            likewise

    What is not readable (a cut file, a wrong checksum) is left out and told in :attr:`notes`.
    """

    Settings = McapSettings

    def __init__(self, settings: McapSettings, root: Path | None) -> None:
        self._settings = settings
        self._folder = root if root is not None else Path.cwd()
        self._where = str(self._folder / settings.recording)
        files = recording_files(self._folder / settings.recording)
        window = find_window(files, settings.start_s, settings.end_s, self._where)
        index = index_recording(files, window, by_log_time=settings.stamps == "log")
        self._files, self._losses = index.files, index.losses
        topics = index.topics.values()
        if not topics and self._losses:
            raise VfoaError(f"{self._where}: no message can be read: {'; '.join(self._losses[:_SHOWN])}")
        if window is not None and not any(topic.places for topic in topics if topic.type.kind in ("raw", "compressed")):
            raise VfoaError(f"{self._where}: source.start_s, source.end_s: no images in that part of the recording")
        self._topics = find_pair(topics, settings.left, settings.right, self._where)
        left, right = self._topics
        joined = join(left.places, right.places, round(settings.tolerance_ms * 1e6))
        if not joined:
            raise VfoaError(
                f"{self._where}: no two stamps of {left} and {right} are within {settings.tolerance_ms:g} ms"
            )
        self._pairs = of_distinct_stamps(joined)
        self._lost = (*self._counted(index), *self._cut_chunks(index), *self._unpaired(len(joined)))
        self._cameras = self._find_cameras(index)

    @classmethod
    def recognise(cls, path: Path) -> tuple[Recognised, ...]:
        """A file in MCAP, whatever its name ends in, or a folder of ``.mcap``: one recording that was split."""
        if is_mcap(path):
            root, source, layout, name = path.parent, {"recording": path.name}, "an MCAP recording", path.stem
        elif files := files_in(path):
            pieces = f"{len(files)} {'file' if len(files) == 1 else 'files'}"
            root, source, layout, name = path, {}, f"an MCAP recording in {pieces}", path.name
        else:
            return ()
        return (Recognised(root=root, source=source, layout=layout, name=name, calibration="the recording's topics"),)

    @property
    def frames(self) -> range:
        """From 1; a frame that was dropped has no number."""
        return range(1, len(self._pairs) + 1)

    @cached_property
    def rate_hz(self) -> float | None:
        """From the median distance of the stamps, to 0.001 Hz."""
        steps = np.diff([left.stamp_ns for left, _ in self._pairs])
        return round(1e9 / float(np.median(steps)), 3) if steps.size else None

    @property
    def notes(self) -> tuple[str, ...]:
        """What was lost, which images are in no frame, and what the stamps are if not the headers'."""
        by_log = 'left and right are joined by the time of recording (stamps = "log"), not by when they were taken'
        return (*self._losses, *self._lost, *([by_log] if self._settings.stamps == "log" else []))

    def time_ns(self, number: int) -> int:
        """The stamp of the left image."""
        return self._places(number)[0].stamp_ns

    def frame(self, number: int) -> StereoFrame:
        """Read one pair from its chunks, rectified."""
        places = self._places(number)
        left, right = (self._image(topic, place) for topic, place in zip(self._topics, places, strict=True))
        if left.shape != right.shape:
            raise VfoaError(f"{self._where}: frame {number}: left is {left.shape[:2]}, right {right.shape[:2]} pixels")
        try:
            optics = self._cameras.at(places[0].stamp_ns, places[1].stamp_ns)
            left, right = optics.rectify(left, right)
            rig = optics.calibration.rig(left.shape[1], left.shape[0])
        except VfoaError as error:
            raise VfoaError(f"{self._where}: frame {number}: {error}") from None
        return StereoFrame(index=number, time_ns=places[0].stamp_ns, left=left, right=right, rig=rig)

    def truth(self, number: int) -> Truth:
        """Nothing is known."""
        return Truth()

    def digest(self) -> str:
        """Of the files' bytes and the settings, not of the files' names."""
        paths = [(f"recording {number}", path) for number, path in enumerate(self._files)]
        if self._settings.calibration is not None:
            paths.append(("calibration", self._folder / self._settings.calibration))
        settings = self._settings.model_dump_json(exclude={"recording", "calibration"})
        return hashlib.sha256(f"{digest_files(paths)} {settings}".encode()).hexdigest()

    def _places(self, number: int) -> tuple[Place, Place]:
        if number not in self.frames:
            raise VfoaError(f"{self._where}: no frame {number}; expected 1 to {len(self._pairs)}")
        return self._pairs[number - 1]

    def _counted(self, index: Index) -> list[str]:
        """How many images are lost, where it is not in the files but noted beside them."""
        recorded = index.recorded or {}
        return [
            f"{topic.name}: {recorded[topic.name] - topic.count} of {recorded[topic.name]} images are lost "
            "(by metadata.yaml)"
            for topic in self._topics
            if recorded.get(topic.name, 0) > topic.count
        ]

    def _cut_chunks(self, index: Index) -> list[str]:
        """A cut file does not say how long it was, but its last chunk's head says what that one held."""
        if index.recorded is not None:
            return []
        return [
            "how many frames were lost, a cut file does not say"
            if span is None or self.rate_hz is None
            else f"the cut chunk alone held about {1 + round((span[1] - span[0]) / 1e9 * self.rate_hz)} of the lost "
            f"frames ({span[0] / 1e9:.3f} to {span[1] / 1e9:.3f} s); how many followed, a cut file does not say"
            for span in index.cut_spans_ns
        ]

    def _unpaired(self, joined: int) -> list[str]:
        """Which images are in no frame, and why."""
        alone = [
            f"{topic.name}: {count} of {len(topic.places)} images have no partner within "
            f"{self._settings.tolerance_ms:g} ms"
            for topic in self._topics
            if (count := len(topic.places) - joined)
        ]
        twice = joined - len(self._pairs)
        same = f"{twice} of {joined} pairs have the stamp of the one before, left out (a copy, or a clock that stood)"
        return [*alone, *([same] if twice else [])]

    def _image(self, topic: Topic, place: Place) -> Image:
        path = self._files[place.file]
        message = read_message(path, place.offset, place.place)
        return read_image(topic.type, message.data, f"{path}: {topic.name}")

    def _size_px(self) -> tuple[int, int]:
        height, width = self._image(self._topics[0], self._pairs[0][0]).shape[:2]
        return width, height

    def _find_cameras(self, index: Index) -> Cameras:
        settings, (left, right) = self._settings, self._topics
        rectified = are_rectified(self._topics) if settings.rectified is None else settings.rectified
        if settings.calibration is not None:
            return FileCameras(self._folder / settings.calibration, self._size_px, rectified)
        topics = index.topics.values()
        cameras = (
            find_camera(topics, left, settings.left_info, self._where),
            find_camera(topics, right, settings.right_info, self._where),
        )
        return RecordedCameras(index.files, cameras, rectified)
