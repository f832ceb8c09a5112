"""A clip from a recording of messages: a stereo pair, a colour camera with depth, or both."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from harness.files.digests import digest_files
from harness.files.io import check_fetched
from harness.sources import Recognised, Truth, check_number, given_root
from harness.sources.calibration import check_first_size, first_size
from harness.sources.media.frame_times import HIGHEST_HZ, rate_of
from harness.sources.media.maps import MILLIMETRES
from harness.sources.recordings import realsense, zed
from harness.sources.recordings.bags import BagContainer, bag_parts, data_files
from harness.sources.recordings.cameras import DepthCamera, PairCameras, Recording
from harness.sources.recordings.containers import Container, files_in, starts_with, window_of
from harness.sources.recordings.joining import (
    FEW_REORDERED,
    FramePlaces,
    join_streams,
    notes_on_clock,
    notes_on_files,
    notes_on_unstamped,
)
from harness.sources.recordings.mcap_files import MAGIC, McapContainer, read_summary
from harness.sources.recordings.messages import IMAGES
from harness.sources.recordings.pixels import read_depth, read_image
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.recordings.streams import find_streams, unused_depth, unused_pairs
from harness.sources.recordings.topics import Place, Topic
from harness.sources.recordings.video import MOST_REORDERED, VideoDecoder
from harness.sources.stereo_pairs import split_views
from vfoa.errors import VfoaError
from vfoa.types import Image, Map, StereoFrame

_SHOWN = 3
"""Most losses that an error lists."""


class RecordingClip:
    """A recorded camera; frames are numbered from 1 in the order of their stamps.

    root/recording.mcap      or a .bag, a .db3, or the folder of a recording that was split
        /stereo/left/image_raw                     images, raw, compressed, or packets of a video
        /stereo/left/camera_info                   their calibration; P_right[0, 3] = -fx B
        /stereo/right/...                          likewise; or instead
        /camera/color/image_raw                    a colour image, and
        /camera/aligned_depth_to_color/image_raw   measured depth

    Unreadable parts (a truncated file, a wrong checksum) are left out. ``notes`` list them, images without a frame, and
    stamps that are not those of the headers.
    """

    Settings: ClassVar[type[RecordingSettings]] = RecordingSettings

    def __init__(self, settings: RecordingSettings, root: Path | None) -> None:
        self._settings = settings
        self._folder = given_root(root)
        self._where = str(self._folder / settings.recording)
        self._container = open_container(self._folder / settings.recording)
        is_part = settings.start_s is not None or settings.end_s is not None
        span_ns = self._container.span_ns() if is_part else None
        window = window_of(span_ns, settings.start_s, settings.end_s, self._where)
        index = self._container.index(window, by_log_time=settings.stamps == "log")
        topics = index.topics
        if not any(topic.is_image and (topic.places or topic.unstamped) for topic in topics):
            if index.losses:
                what = "image" if topics else "message"
                raise VfoaError(f"{self._where}: no {what} can be read: {'; '.join(index.losses[:_SHOWN])}")
            if window is not None:
                raise VfoaError(f"{self._where}: source.start_s, source.end_s: no images in that part of the recording")
        self._streams = find_streams(topics, settings, self._where)
        unstamped = notes_on_unstamped(self._streams, self._where)
        self._videos = {
            topic.name: VideoDecoder(topic, self._container.read, self._where)
            for topic in self._streams
            if topic is not None and topic.kind == "video"
        }
        self._counts_per_m, counted = self._depth_unit(topics)
        self._frames, paired = join_streams(self._streams, settings, self._where)
        self.frames = range(1, len(self._frames) + 1)
        """Frame numbers from 1; dropped frames have no number."""
        self._check_rate()
        self._optics: PairCameras | DepthCamera
        recording = Recording(self._streams, self._container, settings, self._where)
        if self._streams.right is None:
            self._optics = DepthCamera(topics, recording)
        else:
            self._optics = PairCameras(topics, recording, self._folder, lambda: self._size_px)
        by_log = 'images are joined by the time of recording (stamps = "log"), not by when they were taken'
        self.notes = (
            *(*index.losses, *unstamped, *paired),
            *(*unused_pairs(topics, self._streams), *unused_depth(topics, self._streams)),
            *notes_on_files(self._streams.left.places, self._container.files),
            *(self._notes_on_stamps() if settings.stamps == "header" else ()),
            *(*self._optics.notes, *counted),
            *([by_log] if settings.stamps == "log" else []),
        )

    @cached_property
    def rate_hz(self) -> float | None:
        """Rate from the median step of the stamps."""
        return rate_of(places.left.stamp_ns for places in self._frames)

    def time_ns(self, number: int) -> int:
        """Time stamp of the left image."""
        return self._places(number).left.stamp_ns

    def frame(self, number: int) -> StereoFrame:
        """Read one frame, rectified."""
        places, streams = self._places(number), self._streams
        try:
            left, right, depth_m = self._image(streams.left, places.left), None, None
            if streams.is_packed:
                left, right = split_views(left, self._settings.packing, streams.left.name)
            elif streams.right is not None and places.right is not None:
                right = self._image(streams.right, places.right)
            if self._settings.camera or self._settings.calibration:
                check_first_size((left.shape[1], left.shape[0]), self._size_px)
            if streams.depth is not None:  # unknown everywhere for a frame of a pair without one
                depth_m = np.full(left.shape[:2], np.nan, np.float32)
                depth_m = depth_m if places.depth is None else self._depth(streams.depth, places.depth)
            stamps_ns = places.left.stamp_ns, (places.right or places.left).stamp_ns
            return self._optics.frame(number, stamps_ns, left, right, depth_m)
        except VfoaError as error:
            text = str(error).removeprefix(f"{self._where}: ")
            raise VfoaError(f"{self._where}: frame {number}: {text}") from None

    def truth(self, number: int) -> Truth:
        """The source has no ground truth."""
        return Truth()

    def digest(self) -> str:
        """Digest of the files' bytes and the settings, but not of the files' names."""
        paths = [(f"recording {number}", path) for number, path in enumerate(self._container.files)]
        if self._settings.calibration is not None:
            paths.append(("calibration", self._folder / self._settings.calibration))
        settings = self._settings.model_dump_json(exclude={"recording", "calibration"})
        return hashlib.sha256(f"{digest_files(paths)} {settings}".encode()).hexdigest()

    # Frames

    def _places(self, number: int) -> FramePlaces:
        check_number(number, self.frames, self._where)
        return self._frames[number - 1]

    def _image(self, topic: Topic, place: Place) -> Image:
        if topic.name in self._videos:
            return self._videos[topic.name].image(place)
        return read_image(topic.type, self._container.read(topic, place), self._of_topic(topic, place))

    def _depth(self, topic: Topic, place: Place) -> Map:
        data = self._container.read(topic, place)
        return read_depth(topic.type, data, self._counts_per_m, self._of_topic(topic, place))

    def _depth_unit(self, topics: Collection[Topic]) -> tuple[float | None, tuple[str, ...]]:
        """Counts of depth per metre, by the settings or the recording, and a note if that has another unit than mm."""
        depth, given = self._streams.depth, self._settings.depth_scale
        unit_m = None if depth is None or given else realsense.metres_per_count(topics, self._container, depth)
        if depth is None or unit_m is None:
            return given, ()
        counts_per_m = round(1 / unit_m, 3)
        is_mm = counts_per_m == MILLIMETRES
        return counts_per_m, () if is_mm else (f"{depth.name}: {counts_per_m:g} counts a metre, as the recording says",)

    def _check_rate(self) -> None:
        """Refuse times in microseconds or milliseconds: seconds of labels, filters and tolerances would be wrong."""
        if self.rate_hz is None or self.rate_hz <= HIGHEST_HZ:
            return
        if self._settings.stamps == "header":
            times, instead = "time stamps", 'stamps = "log" in [source] takes the times of recording'
        else:
            times, instead = "times of recording", 'stamps = "header" in [source] takes those of the messages'
        raise VfoaError(
            f"{self._where}: {self._streams.left.name}: found {self.rate_hz:.0f} images per second by their {times}; "
            f"expected nanoseconds, at most {HIGHEST_HZ:g} images per second: {instead}"
        )

    def _notes_on_stamps(self) -> list[str]:
        left = self._streams.left
        written = sorted(left.places, key=lambda place: (place.file, place.offset, place.place))
        most_in_a_row = MOST_REORDERED if left.kind == "video" else FEW_REORDERED
        notes = notes_on_clock(left.name, ((place.file, place.stamp_ns) for place in written), most_in_a_row)
        return notes + [note for video in self._videos.values() for note in video.notes()]

    def _of_topic(self, topic: Topic, place: Place) -> str:
        return f"{self._container.files[min(place.file, len(self._container.files) - 1)]}: {topic.name}"

    @cached_property
    def _size_px(self) -> tuple[int, int]:
        return first_size(self._left, self._frames)

    def _left(self, places: FramePlaces) -> Image:
        image = self._image(self._streams.left, places.left)
        if self._streams.is_packed:
            image, _ = split_views(image, self._settings.packing, self._streams.left.name)
        return image


def open_container(path: Path) -> Container:
    """Open the recording at a path: a file, or a folder of files into which it was split. Its content tells the format.

    Raises
    ------
    VfoaError
        If there is no such file or folder, or no recording in it.
    """
    if not path.exists():
        raise VfoaError(f"{path}: no such file or folder; expected a recording")
    parts = bag_parts(path)
    files = (path,) if path.is_file() else files_in(path, ".mcap")
    for file in (*files, *(file for part in parts for file in data_files(part))):
        check_fetched(file)
    if parts:
        return BagContainer(path)
    if not files:
        raise VfoaError(f"{path}: no .mcap, .bag or .db3 in this folder; expected a recording")
    return McapContainer(files)


def is_of_poses(path: Path) -> bool:
    """Whether a path is a recording that has poses and no images, and so is a clip of measurements."""
    if not (bag_parts(path) or starts_with(path, MAGIC) or (path.is_dir() and files_in(path, ".mcap"))):
        return False
    has_poses = False
    with suppress(VfoaError):  # one that cannot be read: opening it as a clip says why
        for _, kind in open_container(path).types():
            if kind.kind in IMAGES or kind.is_unread_image:
                return False
            has_poses |= kind.is_pose
    return has_poses


class McapClip(RecordingClip):
    """A recording in MCAP, of ROS 1, ROS 2 or Foxglove."""

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise an MCAP file, whatever its name, or a folder of ``.mcap``: one recording that was split."""
        if is_of_poses(path):
            return ()
        if starts_with(path, MAGIC):
            serials = zed.serials(channel.topic for channel in read_summary(path).channels.values())
            return (_of_zed(path, serials[0]) if serials else _recognised(path, "an MCAP recording"),)
        files = files_in(path, ".mcap") if path.is_dir() and not bag_parts(path) else ()
        return (_recognised(path, "an MCAP recording", len(files)),) if files else ()


class BagClip(RecordingClip):
    """A bag of ROS 1 or ROS 2."""

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a ``.bag`` or ``.db3``, whatever its name, or the folder that ``ros2 bag`` recorded."""
        if is_of_poses(path):
            return ()
        parts = bag_parts(path)
        return (_recognised(path, "a ROS bag", len(parts)),) if parts else ()


def _of_zed(path: Path, serial: str) -> Recognised:
    """A recording of the ZED's SDK, and the camera's calibration if that is beside it."""
    file = f"SN{serial}.conf"
    found = _recognised(path, "a recording of the ZED's SDK")
    if (path.parent / file).is_file():
        return replace(found, source={**found.source, "calibration": file}, calibration=file)
    missing = (
        f"no {file} beside it; expected the calibration of this camera there, or --calibration FILE: it is in the "
        f"SDK's folder (/usr/local/zed/settings), and at https://www.stereolabs.com/developers/calib/?SN={serial}"
    )
    return replace(found, calibration=None, incomplete=(missing,))


def _recognised(path: Path, what: str, files: int = 1) -> Recognised:
    layout = f"{what} in {files} files" if files > 1 else what
    root, source = (path.parent, {"recording": path.name}) if path.is_file() else (path, {})
    name = path.stem if path.is_file() else path.name
    return Recognised(root=root, source=source, layout=layout, name=name, calibration="the recording's topics")
