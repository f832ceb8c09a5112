"""Calibrations and poses of a recording's cameras, and the frames that its images become by them."""

from __future__ import annotations

import bisect
from collections import defaultdict
from collections.abc import Collection, Iterable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.sources.calibration import check_size
from harness.sources.calibration_files.read import Options, read_cameras
from harness.sources.depth_optics import DepthOptics, DepthRegistration, without_distortion
from harness.sources.media.images import width_by_height
from harness.sources.recordings import orbbec, realsense
from harness.sources.recordings.calibration_topics import find_camera
from harness.sources.recordings.containers import Container
from harness.sources.recordings.messages import camera, fields_of, reading, transforms_in
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.recordings.streams import Streams, has_no_frames, instead_of_pair, is_aligned
from harness.sources.recordings.topics import Place, Topic
from harness.sources.rectification import (
    Cameras,
    ImageSize,
    RawCamera,
    Rectifier,
    motion_of,
    pair_of_infos,
    rectify_pose,
    shrinking_note,
    unset_matrices,
)
from vfoa.errors import VfoaError
from vfoa.types import Float, Image, Map, StereoFrame, StereoRig


class Recording(NamedTuple):
    """The topics of a clip's frames, the messages, the settings, and the recording's name for error messages."""

    streams: Streams
    container: Container
    settings: RecordingSettings
    where: str

    def read(self, topic: Topic, place: Place) -> tuple[bytes, str]:
        """A message of a topic, and its place for error messages."""
        return self.container.read(topic, place), f"{self.where}: {topic.name}"


class PairCameras:
    """The rectifier of each pair: of a file or numbers for all times, or of the calibrations recorded at its time.

    Parameters
    ----------
    topics, recording
        All topics of the recording, and the ones that the clip reads.
    folder
        The folder of the settings' ``calibration``.
    size
        Gives (width, height) of the images.

    Raises
    ------
    VfoaError
        If there is no calibration, or it cannot be read.
    """

    def __init__(self, topics: Collection[Topic], recording: Recording, folder: Path, size: ImageSize) -> None:
        streams, _, settings, where = self._recording = recording
        assert streams.right is not None
        if settings.aligned is not None:
            raise VfoaError(f"{where}: source.aligned: found {settings.aligned}; expected none with a right image")
        pair = streams.left, streams.right
        are_rect = all(topic.is_called_rectified for topic in pair)
        self._rectified = are_rect if settings.rectified is None else settings.rectified
        self.notes: tuple[str, ...] = ()
        self._for_all_times: Rectifier | None = None
        if settings.camera is not None:
            self._for_all_times = Rectifier(settings.camera.pair(where, size))
            self.notes = settings.camera.notes
        elif settings.calibration is not None:
            path = folder / settings.calibration
            options = Options(rectified=self._rectified, baseline_m=settings.baseline_m)
            self._for_all_times = Rectifier(cameras := read_cameras([path], size, options))
            self.notes = shrinking_note(cameras)
        else:
            if streams.is_packed and not (settings.left_info and settings.right_info):
                raise VfoaError(
                    f"{where}: {pair[0].name} has both views; expected left_info = and right_info = in [source], or "
                    "--calibration FILE of a pair, or --fx --cx --cy (or --fov-deg) and --baseline"
                )
            infos = zip(pair, (settings.left_info, settings.right_info), strict=True)
            self._topics = tuple(find_camera(topics, [image], info, where) for image, info in infos)
            self._instead = instead_of_pair(topics)
            self._baseline_m = settings.baseline_m or _baseline_m(topics, pair, recording)
            self._pose = None if self._baseline_m else _static_pose(topics, pair, recording)
            self.notes = (*self._notes(), *self._shrinking_note())

    def frame(
        self, number: int, stamps_ns: tuple[int, int], left: Image, right: Image | None, depth_m: Map | None
    ) -> StereoFrame:
        """Return a frame of the images and the depth in the messages, rectified; the stamps are those of both images.

        Raises
        ------
        VfoaError
            If the sizes differ from each other or from those of the calibrations, or a calibration cannot be read.
        """
        assert right is not None
        if left.shape != right.shape:
            sizes = " pixels and a right one of ".join(map(width_by_height, (left, right)))
            raise VfoaError(f"found a left image of {sizes} pixels; expected the same size")
        rectifier, depth = self._at(*stamps_ns), self._recording.streams.depth
        if depth is not None and depth_m is not None:
            check_size(depth_m.shape[::-1], left.shape[1::-1], f"{depth.name}: depth", "as the images have")
            if not rectifier.keeps_left:
                raise VfoaError(
                    f"{depth.name} belongs to the left image before rectification, which rotates it; expected "
                    "rectified images with depth"
                )
        left, right = rectifier.rectify(left, right)
        rig = rectifier.calibration.rig(left.shape[1], left.shape[0])
        return StereoFrame(index=number, time_ns=stamps_ns[0], left=left, right=right, depth_m=depth_m, rig=rig)

    def _at(self, left_ns: int, right_ns: int) -> Rectifier:
        """The rectifier at the time of the two images."""
        if self._for_all_times is not None:
            return self._for_all_times
        left, right = (
            camera_at(topic, stamp_ns, self._recording)
            for topic, stamp_ns in zip(self._topics, (left_ns, right_ns), strict=True)
        )
        where = f"{self._recording.where}: {' and '.join(topic.name for topic in self._topics)}"
        return _rectifier(self._pair(left, right, where))

    def _pair(self, left: RawCamera, right: RawCamera, where: str) -> Cameras:
        """The pair of two recorded cameras: with the settings' baseline, by their own P, or by the recorded pose."""
        baseline_m = self._baseline_m
        if self._pose is not None and _are_single(left, right):
            return _posed(left, right, self._pose, f"{where} and {_STATIC}", rectified=self._rectified)
        if self._rectified:
            left, right = left.of_rectified_images(), right.of_rectified_images()
        try:
            raw = pair_of_infos(left, right, where, baseline_m)
        except VfoaError as error:  # the cameras of two arms are no pair, and one in the head has depth
            raise VfoaError(f"{error}{self._instead}") from None
        return raw.rectified() if self._rectified and baseline_m is None else raw

    def _notes(self) -> tuple[str, ...]:
        """Notes on what a given baseline, or the recorded pose, replaces in the first calibrations."""
        if (self._baseline_m is None and self._pose is None) or not all(topic.places for topic in self._topics):
            return ()
        cameras = self._first_cameras()
        names = " and ".join(topic.name for topic in self._topics)
        if self._pose is not None:
            apart = f"{names}: of single cameras; their pose is that of {_STATIC}, as exact as that was measured"
            return (apart,) if _are_single(*cameras) else ()
        if not (unset := unset_matrices(*cameras)):
            return ()
        parallel = "; the cameras are taken as parallel" if "R" in unset else ""
        return (f"{names}: {unset}: zeros (not set), baseline_m = {self._baseline_m:g} replaces them{parallel}",)

    def _shrinking_note(self) -> tuple[str, ...]:
        """That of the first calibrations, as for a file's; what is wrong in them is said of the frame."""
        with suppress(VfoaError):
            if all(topic.places for topic in self._topics):
                return shrinking_note(self._pair(*self._first_cameras(), self._recording.where))
        return ()

    def _first_cameras(self) -> tuple[RawCamera, RawCamera]:
        left, right = (camera_at(topic, topic.places[0].stamp_ns, self._recording) for topic in self._topics)
        return left, right


def _baseline_m(topics: Collection[Topic], pair: tuple[Topic, Topic], recording: Recording) -> float | None:
    """The baseline of RealSense's infrared cameras, whose images are rectified; None for others, or without poses."""
    left, right = pair
    if not all(map(realsense.is_of_sdk, pair)):
        return None
    motion = _find_pose(topics, recording, right, left)
    return None if motion is None or motion[0, 3] >= 0 else -float(motion[0, 3])


def _find_pose(topics: Collection[Topic], recording: Recording, target: Topic, source: Topic) -> Float | None:
    """The motion (4, 4) from the source's frame to the target's, by the SDK's poses or by names of frames."""
    motion = realsense.find_pose(topics, recording.container, target, source)
    if motion is None and target.frame_id and source.frame_id and not has_no_frames(source):
        return find_transform(topics, recording, target.frame_id, source.frame_id)
    return motion


_STATIC = "/tf_static"
_MOST_TURN_RAD, _MOST_ASIDE = 0.02, 0.05
"""Of rectified images: the largest angle between their cameras, and the largest share of the pose off their rows."""


def _static_pose(topics: Collection[Topic], pair: tuple[Topic, Topic], recording: Recording) -> Float | None:
    """The motion (4, 4) from the left camera's frame to the right one's that holds at all times; None without one."""
    left, right = pair
    if not (left.frame_id and right.frame_id) or left.frame_id == right.frame_id:
        return None
    static = [topic for topic in topics if topic.name.endswith(_STATIC)]
    return find_transform(static, recording, right.frame_id, left.frame_id)


def _are_single(left: RawCamera, right: RawCamera) -> bool:
    """Whether both calibrations are of single cameras: neither projection says where the other camera is."""
    return not (left.p[:, 3].any() or right.p[:, 3].any())


def _posed(left: RawCamera, right: RawCamera, pose: Float, where: str, *, rectified: bool) -> Cameras:
    """The pair of two cameras by x_right = pose x_left; that of ``rectified`` images if they are parallel by it.

    Raises
    ------
    VfoaError
        If the cameras do not stand side by side, left before right.
    """
    rotation, shift = pose[:3, :3], pose[:3, 3]
    if not rectified:
        return rectify_pose(left, right, rotation, shift, where)
    turn_rad = float(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))
    if turn_rad > _MOST_TURN_RAD or np.abs(shift[1:]).max() > _MOST_ASIDE * -shift[0]:
        raise VfoaError(
            f"{where}: rectified images, and cameras at {shift.tolist()} turned by {np.degrees(turn_rad):.3g} degrees; "
            "expected parallel ones, the right one at (-baseline, 0, 0), or --baseline METRES"
        )
    return pair_of_infos(left, right, where, -float(shift[0])).rectified()


# the maps are computed again only if a calibration has changed
_rectifier = lru_cache(maxsize=2)(Rectifier)
_optics = lru_cache(maxsize=2)(DepthOptics)


_OF_IMAGE_NS = 20_000_000
"""Longest time after an image in which a driver stamps the calibration that it sends with it."""


def camera_at(topic: Topic, stamp_ns: int, recording: Recording) -> RawCamera:
    """A camera's calibration at the time of an image: the last one before it, or its first one if all came later.

    One that follows the image shortly, and is nearer to it than the one before, was sent with it.
    """
    after = bisect.bisect_right(topic.places, stamp_ns, key=lambda place: place.stamp_ns)
    if not topic.places:
        raise VfoaError(f"{recording.where}: {topic.name}: none of its calibrations can be read")
    place, following = topic.places[max(after - 1, 0)], topic.places[min(after, len(topic.places) - 1)]
    if 0 < following.stamp_ns - stamp_ns <= min(_OF_IMAGE_NS, stamp_ns - place.stamp_ns):
        place = following
    return camera(topic.type, *recording.read(topic, place))


_MOST_MESSAGES = 200
"""Most messages read per topic: static transforms are sent at the beginning."""


def find_transform(topics: Iterable[Topic], recording: Recording, target: str, source: str) -> Float | None:
    """The motion (4, 4) from frame ``source`` to frame ``target`` by the shortest chain of the recording's transforms.

    None if no chain connects them.
    """
    steps: dict[str, dict[str, Float]] = defaultdict(dict)  # frame -> other frame -> motion from the one to the other
    for topic in topics:
        if topic.type.kind == "transforms":
            for place in topic.places[:_MOST_MESSAGES]:
                for parent, child, motion in transforms_in(topic.type, *recording.read(topic, place)):
                    steps[child][parent], steps[parent][child] = motion, np.asarray(np.linalg.inv(motion), np.float64)
    motions, waiting = {source: np.eye(4)}, [source]
    for frame in waiting:
        for other, step in steps[frame].items():
            if other not in motions:
                motions[other] = step @ motions[frame]
                waiting.append(other)
    return motions.get(target)


def find_extrinsics(topics: Iterable[Topic], recording: Recording) -> Float | None:
    """The pose colour_from_depth that RealSense's driver or Orbbec's SDK recorded; None if neither did.

    The driver sends ``realsense2_camera_msgs/Extrinsics`` (``.../extrinsics/depth_to_color``), whose rotation is by
    columns, as in librealsense's rs2_extrinsics. The SDK has the pose in the calibration of depth.
    """
    for topic in topics:
        if topic.name == orbbec.DEPTH_INFO and topic.type.is_orbbec and topic.places:
            data, where = recording.read(topic, topic.places[0])
            with reading(topic.type, where):
                return orbbec.colour_from_depth(data, where)
        if topic.type.kind == "extrinsics" and topic.name.endswith("depth_to_color") and topic.places:
            data, where = recording.read(topic, topic.places[0])
            with reading(topic.type, where):
                field = fields_of(topic.type, data, where)
                return motion_of(np.array(field("rotation"), np.float64).reshape(3, 3).T, field("translation"))
    return None


class DepthCamera:
    """The calibration of a colour camera, and of its depth if that is of another camera.

    ``notes`` say how depth was registered to the colour image, if the recording has it in another one.

    Parameters
    ----------
    topics, recording
        All topics of the recording, and the ones that the clip reads; the left one is colour.

    Raises
    ------
    VfoaError
        If a calibration is missing, or depth is of another camera without a known pose.
    """

    def __init__(self, topics: Collection[Topic], recording: Recording) -> None:
        streams, _, settings, where = self._recording = recording
        assert streams.depth is not None
        self._settings, self._where = settings, where
        if settings.baseline_m is not None:
            raise VfoaError(
                f"{where}: source.baseline_m: found {settings.baseline_m:g}; expected none without a right image"
            )
        self._colour, self._depth = streams.left, streams.depth
        if settings.calibration is not None:
            raise VfoaError(
                f"{where}: source.calibration: is of a pair, the frames are colour with depth; expected camera = "
                "{ fx_px = ..., cx_px = ..., cy_px = ... } in [source]"
            )
        aligned = is_aligned(self._depth, self._colour) if settings.aligned is None else settings.aligned
        self._colour_from_depth = None if aligned else self._find_motion(topics)
        self._infos = {
            self._colour.name: self._info(topics, self._colour, self._depth, settings.left_info),
            self._depth.name: self._info(topics, self._depth, self._colour, settings.depth_info),
        }
        self._registration: tuple[tuple[RawCamera, StereoRig], DepthRegistration] | None = None
        self.notes = settings.camera.notes if settings.camera and None in self._infos.values() else ()
        if self._colour_from_depth is not None:
            self.notes = (
                f"{self._depth.name} is not aligned with {self._colour.name}: it is registered by the recording's "
                "calibrations and extrinsics, and unknown where the depth camera does not see what the colour camera "
                "does",
            )

    def frame(
        self, number: int, stamps_ns: tuple[int, int], colour: Image, right: Image | None, depth_m: Map | None
    ) -> StereoFrame:
        """Return the colour image with the depth in it, both without distortion, as :meth:`PairCameras.frame`."""
        assert depth_m is not None
        stamp_ns = stamps_ns[0]
        optics = self._optics_of(self._colour, stamp_ns, colour)
        if self._colour_from_depth is not None:
            depth = self._registered(depth_m, stamp_ns, optics.rig)
        elif depth_m.shape != colour.shape[:2]:
            sizes = " and ".join(width_by_height(pixels) for pixels in (colour, depth_m))
            raise VfoaError(
                f"{self._where}: {self._colour.name} and {self._depth.name} are {sizes} pixels; expected depth in the "
                "colour image (aligned), or a topic of unaligned depth with the recording's extrinsics"
            )
        else:
            depth = self._aligned(depth_m, stamp_ns, optics.rig)
        image = optics.image(colour, "colour image")
        return StereoFrame(index=number, time_ns=stamp_ns, left=image, depth_m=depth, rig=optics.rig)

    def _info(self, topics: Collection[Topic], image: Topic, other: Topic, named: str | None) -> Topic | None:
        """The calibration topic of an image, or of the other one if they are aligned; None if numbers are given."""
        is_aligned = self._colour_from_depth is None
        if self._settings.camera is not None and named is None and is_aligned:
            return None
        return find_camera(topics, (image, other) if is_aligned else (image,), named, self._where)

    def _find_motion(self, topics: Collection[Topic]) -> Float:
        """The pose colour_from_depth in the recording."""
        colour, depth = self._colour, self._depth
        motion = find_extrinsics(topics, self._recording)
        if motion is None:
            motion = _find_pose(topics, self._recording, colour, depth)
        if motion is None:
            raise VfoaError(
                f"{self._where}: {depth.name} (frame {depth.frame_id!r}) is not aligned with {colour.name} (frame "
                f"{colour.frame_id!r}), and the recording has no transform between the two frames; expected /tf_static "
                "or extrinsics in it, or a topic of aligned depth (RealSense: align_depth.enable; Azure Kinect: "
                "depth_to_rgb), or aligned = true in [source] (--set aligned=true) if it is in the colour image"
            )
        return motion

    def _camera(self, topic: Topic, stamp_ns: int, size_px: tuple[int, int]) -> RawCamera:
        info = self._infos[topic.name]
        if info is None:
            assert self._settings.camera is not None
            return self._settings.camera.camera(size_px)
        camera = camera_at(info, stamp_ns, self._recording)
        return without_distortion(camera) if self._is_rectified(topic) else camera

    def _is_rectified(self, topic: Topic) -> bool:
        # depth_registered, of ZED and image_proc, belongs to rectified colour
        is_rect = topic.is_called_rectified or topic.name.endswith("depth_registered")
        return is_rect if self._settings.rectified is None else self._settings.rectified

    def _optics_of(self, topic: Topic, stamp_ns: int, image: Image | Map) -> DepthOptics:
        camera = self._camera(topic, stamp_ns, (image.shape[1], image.shape[0]))
        return _optics(camera, f"{self._where}: {self._colour.name}")

    def _aligned(self, depth_m: Map, stamp_ns: int, colour: StereoRig) -> Map:
        """Return aligned depth without the distortion of its own calibration."""
        optics = self._optics_of(self._depth, stamp_ns, depth_m)
        if not np.allclose(optics.rig.camera_matrix, colour.camera_matrix, rtol=0.01, atol=1.0):
            raise VfoaError(
                f"{self._where}: {self._depth.name} is aligned by its name or frame, but its calibration (fx "
                f"{optics.rig.fx_px:g}) is not that of {self._colour.name} (fx {colour.fx_px:g}); expected the same, "
                "or depth_info = (the colour camera's topic) in [source]"
            )
        return optics.depth(depth_m)

    def _registered(self, depth_m: Map, stamp_ns: int, target: StereoRig) -> Map:
        assert self._colour_from_depth is not None
        size_px = (depth_m.shape[1], depth_m.shape[0])
        source = self._camera(self._depth, stamp_ns, size_px)
        check_size(size_px, source.size_px, f"{self._where}: {self._depth.name}: images")
        if self._registration is None or self._registration[0] != (source, target):
            self._registration = (source, target), DepthRegistration(source, target, self._colour_from_depth)
        return np.ascontiguousarray(self._registration[1].register(depth_m))
