"""Recordings of Azure Kinect's recorder (``.mkv``): colour, depth in its own camera, and the calibration of both."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from harness.files.digests import digest_files
from harness.files.parsing import parse_json
from harness.sources import Recognised, Truth, check_number, given_root
from harness.sources.calibration_files.documents import Document, expect_names, numbers
from harness.sources.depth_optics import DepthOptics, DepthRegistration
from harness.sources.media.film import container_tags
from harness.sources.media.frame_times import join_times, rate_of
from harness.sources.media.images import decode_rgb
from harness.sources.media.maps import MILLIMETRES, depth_map
from harness.sources.media.matroska import FilmPicture, read_blocks, read_head
from harness.sources.recordings.settings import DEPTH_TOLERANCE_MS
from harness.sources.rectification import RawCamera, motion_of
from vfoa.errors import VfoaError, located
from vfoa.settings import Settings
from vfoa.types import Float, Image, Map, StereoFrame

_TAG = "K4A_"
"""What the names of the recorder's tags begin with."""
_LOCATIONS = {"DEPTH": "CALIBRATION_CameraLocationD0", "COLOR": "CALIBRATION_CameraLocationPV0"}

Size = tuple[int, int]

_DEPTH_MODES: Mapping[Size, tuple[Size, Size]] = {
    (320, 288): ((512, 512), (96, 90)),
    (640, 576): ((1024, 1024), (192, 180)),
    (512, 512): ((512, 512), (0, 0)),
    (1024, 1024): ((1024, 1024), (0, 0)),
}
"""By the size of depth maps: the size of the whole sensor at this binning, and the first column and row of the map."""

_RAW = {"NV12": cv2.COLOR_YUV2RGB_NV12, "YUY2": cv2.COLOR_YUV2RGB_YUY2, "BGRA": cv2.COLOR_BGRA2RGB}
"""Forms of colour that are not compressed, and OpenCV's conversions."""


class AzureKinectSettings(Settings):
    """The recording under the manifest's root; colour and depth of a frame are at most ``tolerance_ms`` apart."""

    recording: str
    tolerance_ms: float = Field(default=DEPTH_TOLERANCE_MS, ge=0)


class AzureKinectClip:
    """Colour with depth registered to it; frames are numbered from 1 in the order of colour images.

    The recording has tracks COLOR (MJPEG, NV12, YUY2 or BGRA) and DEPTH (16 bits, big-endian, millimetres), and the
    calibration as an attachment. Colour has its lens distortion removed; depth is unknown where the depth camera does
    not see what the colour camera does.
    """

    Settings = AzureKinectSettings

    def __init__(self, settings: AzureKinectSettings, root: Path | None) -> None:
        self._path = given_root(root) / settings.recording
        self._settings = settings
        self._head = KinectHead(self._path)
        blocks = read_blocks(self._path)
        colours, depths = ([each for each in blocks if each.track == track] for track in self._head.tracks)
        colours.sort(key=lambda block: block.time_ns)
        depths.sort(key=lambda block: block.time_ns)
        first_ns, second_ns = ([block.time_ns for block in side] for side in (colours, depths))
        pairs = join_times(first_ns, second_ns, round(settings.tolerance_ms * 1e6))
        if not pairs:
            raise VfoaError(
                f"{self._path}: no colour image ({len(colours)}) has depth ({len(depths)}) within "
                f"{settings.tolerance_ms:g} ms; expected frames of both"
            )
        self._frames: list[tuple[FilmPicture, FilmPicture]] = [(colours[i], depths[j]) for i, j in pairs]
        self.frames = range(1, len(self._frames) + 1)
        self.notes = (
            "depth is registered with colour by the recording's calibration, and unknown where the depth camera does "
            "not see what the colour camera does",
            *(
                f"{lost} of {len(side)} {what} have no partner within {settings.tolerance_ms:g} ms"
                for what, side in (("colour images", colours), ("depth maps", depths))
                if (lost := len(side) - len(pairs))
            ),
        )

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> Sequence[Recognised]:
        """Recognise a film with the recorder's tags."""
        if not is_of_recorder(path):
            return ()
        layout, calibration = "a recording of Azure Kinect: colour with depth", "in the recording"
        source = {"recording": path.name}
        return (Recognised(root=path.parent, source=source, layout=layout, name=path.stem, calibration=calibration),)

    @cached_property
    def rate_hz(self) -> float | None:
        """Rate from the median step of the times."""
        return rate_of(colour.time_ns for colour, _ in self._frames)

    def time_ns(self, number: int) -> int:
        """Time of the colour image, from the first one in the file."""
        check_number(number, self.frames, self._path)
        return self._frames[number - 1][0].time_ns

    def frame(self, number: int) -> StereoFrame:
        """Read one frame."""
        time_ns = self.time_ns(number)
        where = f"{self._path}: frame {number}"
        colour, depth = self._frames[number - 1]
        optics, registration = self._optics
        left = optics.image(self._head.colour(self._read(colour), f"{where}: colour"), "colour image")
        depth_m = registration.register(self._head.depth_m(self._read(depth), f"{where}: depth"))
        return StereoFrame(index=number, time_ns=time_ns, left=left, depth_m=depth_m, rig=optics.rig)

    def truth(self, number: int) -> Truth:
        """The source has no ground truth."""
        return Truth()

    def digest(self) -> str:
        """Digest of the file's bytes and the settings, but not of the file's name."""
        settings = self._settings.model_dump_json(exclude={"recording"})
        return hashlib.sha256(f"{digest_files([('recording', self._path)])} {settings}".encode()).hexdigest()

    def _read(self, block: FilmPicture) -> bytes:
        with located(str(self._path)), self._path.open("rb") as file:
            file.seek(block.offset)
            return file.read(block.size)

    @cached_property
    def _optics(self) -> tuple[DepthOptics, DepthRegistration]:
        optics = DepthOptics(self._head.colour_camera, str(self._path))
        return optics, DepthRegistration(self._head.depth_camera, optics.rig, self._head.colour_from_depth)


def is_of_recorder(path: Path) -> bool:
    """Whether a file is a recording of Azure Kinect's recorder."""
    return path.suffix.lower() == ".mkv" and any(name.startswith(_TAG) for name in container_tags(path))


class KinectHead:
    """What the head of a recording says: its two tracks among all, their forms, and the two cameras.

    Raises
    ------
    VfoaError
        If it has no colour or no depth, its calibration is missing, or is not one of these cameras.
    """

    def __init__(self, path: Path) -> None:
        head = read_head(path)
        if missing := [title for title in _LOCATIONS if title not in head.tracks]:
            raise VfoaError(
                f"{path}: no track {missing[0]}; expected a recording with colour and depth (k4arecorder -d with a "
                "depth mode, -c with a colour mode)"
            )
        colour, depth = head.tracks["COLOR"], head.tracks["DEPTH"]
        self.tracks = colour.place, depth.place
        self._form = colour.tags.get(f"{_TAG}COLOR_MODE", "MJPG").partition("_")[0]
        self._sizes: tuple[Size, Size] = colour.size_px, depth.size_px
        name = head.tags.get(f"{_TAG}CALIBRATION_FILE", "calibration.json")
        if name not in head.attachments:
            raise VfoaError(f"{path}: no attachment {name}; expected the calibration that the recorder writes")
        cameras = cameras_of(parse_json(head.attachments[name].rstrip(b"\0"), f"{path}: {name}"), f"{path}: {name}")
        self.colour_camera = colour_camera(cameras["COLOR"], self._sizes[0], f"{path}: {name}: colour")
        self.depth_camera = depth_camera(cameras["DEPTH"], self._sizes[1], f"{path}: {name}: depth")
        poses = [_pose(cameras[title], f"{path}: {name}") for title in ("COLOR", "DEPTH")]
        self.colour_from_depth: Float = poses[0] @ np.linalg.inv(poses[1])

    def colour(self, data: bytes, where: str) -> Image:
        """A colour image (H, W, 3) uint8 RGB."""
        if self._form not in _RAW:
            return decode_rgb(data, where)
        width, height = self._sizes[0]
        shape = {"NV12": (height * 3 // 2, width), "YUY2": (height, width, 2), "BGRA": (height, width, 4)}[self._form]
        return np.asarray(cv2.cvtColor(_pixels(data, np.dtype(np.uint8), shape, where), _RAW[self._form]), np.uint8)

    def depth_m(self, data: bytes, where: str) -> Map:
        """A depth map (H, W) float32 of the depth camera, metres."""
        width, height = self._sizes[1]
        return depth_map(_pixels(data, np.dtype(">u2"), (height, width), where), MILLIMETRES)


def _pixels(data: bytes, kind: np.dtype[Any], shape: tuple[int, ...], where: str) -> NDArray[Any]:
    expected = int(np.prod(shape)) * kind.itemsize
    if len(data) != expected:
        raise VfoaError(f"{where}: found {len(data)} bytes; expected {expected}")
    return np.frombuffer(data, kind).reshape(shape)


def cameras_of(document: Any, where: str) -> dict[str, Document]:
    """The raw calibrations by the titles of the tracks."""
    information = document.get("CalibrationInformation") if isinstance(document, dict) else None
    listed = information.get("Cameras") if isinstance(information, dict) else None
    found = {each.get("Location"): each for each in listed or () if isinstance(each, dict)}
    if missing := [location for location in _LOCATIONS.values() if location not in found]:
        raise VfoaError(f"{where}: no camera {missing[0]}; expected CalibrationInformation with its Cameras")
    return {title: found[location] for title, location in _LOCATIONS.items()}


def depth_camera(camera: Document, size: Size, where: str) -> RawCamera:
    """The camera of depth maps of this (width, height)."""
    if size not in _DEPTH_MODES:
        known = ", ".join(f"{width} x {height}" for width, height in _DEPTH_MODES)
        raise VfoaError(f"{where}: maps of {size[0]} x {size[1]}; expected {known}")
    whole, first = _DEPTH_MODES[size]
    return _camera(camera, size, whole, first, where)


def colour_camera(camera: Document, size: Size, where: str) -> RawCamera:
    """The camera of colour images of this (width, height): of 16:9, the middle rows of the sensor, which has 4:3."""
    whole = (size[0], size[0] * 3 // 4)
    expect_names(camera, ("SensorWidth", "SensorHeight"), where, "a camera of Azure Kinect")
    sensor = [float(numbers(camera[f"Sensor{side}"], f"{where}: Sensor{side}", 1)[0]) for side in ("Width", "Height")]
    if round(sensor[0] * 9 / 16) == round(sensor[1]):  # of old firmware: the calibration is of the middle rows
        whole = (size[0], size[0] * 9 // 16)
    return _camera(camera, size, whole, (0, (whole[1] - size[1]) // 2), where)


def _camera(camera: Document, size: Size, whole: Size, first: tuple[int, int], where: str) -> RawCamera:
    """The camera of images that are a part of a sensor of ``whole`` pixels, which begins at ``first``.

    Parameters are cx, cy, fx, fy in widths and heights of the sensor from its corner, k1 to k6, the centre of
    distortion (0), p2, p1 (``transformation_get_mode_specific_camera_calibration`` of the sensor's SDK).
    """
    expect_names(camera, ("Intrinsics",), where, "a camera of Azure Kinect")
    intrinsics = camera["Intrinsics"] if isinstance(camera["Intrinsics"], dict) else {}
    expect_names(intrinsics, ("ModelParameters",), where, "the intrinsics of Azure Kinect")
    cx, cy, fx, fy, *k, u, v, p2, p1 = numbers(intrinsics["ModelParameters"], f"{where}: ModelParameters", 14)
    if u or v:
        raise VfoaError(f"{where}: ModelParameters: the centre of distortion is {u:g}, {v:g}; expected 0, 0")
    column, row = cx * whole[0] - first[0] - 0.5, cy * whole[1] - first[1] - 0.5
    matrix = np.array([[fx * whole[0], 0, column], [0, fy * whole[1], row], [0, 0, 1]])
    return RawCamera(size_px=size, k=matrix, d=np.array([*k[:2], p1, p2, *k[2:]]))


def _pose(camera: Document, where: str) -> Float:
    """camera_from_depth (4, 4), metres."""
    expect_names(camera, ("Rt",), where, "a camera of Azure Kinect")
    rt = camera["Rt"] if isinstance(camera["Rt"], dict) else {}
    expect_names(rt, ("Rotation", "Translation"), where, "Rt of Azure Kinect")
    rotation = numbers(rt["Rotation"], f"{where}: Rotation", 9).reshape(3, 3)
    return motion_of(rotation, numbers(rt["Translation"], f"{where}: Translation", 3))
