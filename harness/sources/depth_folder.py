"""Colour images and depth maps in files: a folder of each, or TUM's lists, and the calibration of their camera."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from harness.files.ascending import usual_step
from harness.files.digests import digest_files
from harness.files.safe_names import shell_command
from harness.sources import Recognised, Truth, check_number, given_root
from harness.sources.calibration_files.depth_unit import counts_per_metre
from harness.sources.calibration_files.one_camera import camera_note, read_one_camera
from harness.sources.depth_layouts import find_depth_frames, recognise_depth
from harness.sources.depth_optics import DepthOptics, Intrinsics, check_one_calibration
from harness.sources.media.frame_times import StampUnit, number_time_ns, rate_of, untimed_note
from harness.sources.media.images import read_rgb, width_by_height
from harness.sources.media.maps import read_depth_file
from harness.sources.media.video import VIDEO_SUFFIXES
from harness.sources.recordings.settings import DEPTH_TOLERANCE_MS
from vfoa.errors import VfoaError, located
from vfoa.settings import Settings
from vfoa.types import StereoFrame

_MILLIMETRES = 1000.0


class DepthFolderSettings(Settings):
    """Files of the clip, under the manifest's root, and the calibration of their camera.

    ``colour`` and ``depth`` are folders, globs (``depth/*.npy``), printf patterns, or two lists of times and files
    (``rgb.txt``, ``depth.txt``), joined if they are at most ``tolerance_ms`` apart, or twice the same list, in which a
    line is a frame (``associations.txt``).
    ``stamps``: the numbers in the files' names are times, in this unit, and joined likewise. ``times`` is a file with
    the time of each colour image in a line, or in a column of a table, as of a ``stereo_folder``.
    ``depth_scale`` is the number of counts per metre (if not given, integers are in the unit that the calibration's
    file has as ``depth_scale``, else millimetres, and floating point numbers metres; TUM RGB-D has 5000). The camera is
    a file (``calibration``) or numbers (``camera``); ``rectified``: the images have no lens distortion. ``rate_hz`` is
    how many numbers of frames a second has. Without it, times are those of the lists, names or file; images without
    times count as 25 numbers a second.
    """

    colour: str
    depth: str
    depth_scale: float | None = Field(default=None, gt=0)
    stamps: StampUnit | None = None
    times: str | None = None
    tolerance_ms: float = Field(default=DEPTH_TOLERANCE_MS, ge=0)
    calibration: str | None = None
    camera: Intrinsics | None = None
    rectified: bool = False
    rate_hz: float | None = Field(default=None, ge=1e-3, le=1e6)

    @model_validator(mode="after")
    def _one_calibration(self) -> Self:
        check_one_calibration(self.calibration, self.camera)
        if self.camera is not None and self.camera.baseline_m is not None:
            raise ValueError("found camera.baseline_m; expected none for a camera that measures depth")
        for side, files in (("colour", self.colour), ("depth", self.depth)):
            if Path(files).suffix.lower() in VIDEO_SUFFIXES:
                as_filmed = "-vsync", "passthrough"  # else ffmpeg doubles pictures of phones, whose rate varies
                made = shell_command("ffmpeg", "-i", files, *as_filmed, "-start_number", "0", f"{side}/%06d.png")
                raise ValueError(f"{side}: found the film {files!r}; expected its images: mkdir {side} && {made}")
        if self.stamps is not None and (self.rate_hz is not None or self.colour.endswith(".txt")):
            raise ValueError(f"stamps: found {self.stamps!r}; expected neither lists nor rate_hz beside it")
        if self.times is not None and (self.stamps is not None or self.colour.endswith(".txt")):
            raise ValueError(f"times: found {self.times!r}; expected neither lists nor stamps beside it")
        return self


class DepthFolderClip:
    """A clip from colour images and depth maps of the same size, aligned: each pixel's depth is at its own place.

    Frames have the numbers in the colour images' names, or numbers from 1 for lists. Notes are on images without a
    frame.

    root/
      rgb/000007.png      any image OpenCV reads; colour and depth are joined by number, or by time
      depth/000007.png    16 bits, or .npy, .npz, .exr, .tif, .pfm
      intrinsics.json     see harness.sources.calibration_files.one_camera

    root/                 TUM RGB-D
      associations.txt    time, rgb/TIME.png, time, depth/TIME.png; or rgb.txt and depth.txt
      rgb/  depth/        5000 counts per metre
    """

    Settings = DepthFolderSettings

    def __init__(self, settings: DepthFolderSettings, root: Path | None) -> None:
        self._settings = settings
        self._folder = folder = given_root(root)
        if not folder.is_dir():
            raise VfoaError(f"{folder}: no such folder; expected the clip's root")
        files = settings.colour, settings.depth
        stamps, times = settings.stamps, settings.times
        self._files = find_depth_frames(folder, *files, settings.tolerance_ms, stamps, times)
        self.frames = tuple(self._files.colours)

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> Sequence[Recognised]:
        """Recognise folders or names of colour and of depth, TUM RGB-D."""
        return recognise_depth(path, given)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes: images without a partner, a field of view, numbers that may be times, another unit of depth."""
        settings, counts = self._settings, self._counts_per_m
        without_times = settings.rate_hz is None and self._files.times_ns is None
        return (
            *self._files.notes,
            *(settings.camera.notes if settings.camera else ()),
            *(untimed_note(self.frames) if without_times else ()),
            *self._camera_note,
            *([f"whole numbers of depth: {counts:g} per metre, as {settings.calibration} says"] if counts else ()),
        )

    @cached_property
    def _camera_note(self) -> tuple[str, ...]:
        if self._settings.calibration is None:
            return ()
        camera = self._optics.rig
        return camera_note(self._folder / self._settings.calibration, (camera.width_px, camera.height_px))

    @cached_property
    def _counts_per_m(self) -> float | None:
        """The unit of depth in whole numbers that the calibration's file says, if the manifest gives none."""
        settings = self._settings
        if settings.calibration is None or settings.depth_scale is not None:
            return None
        counts = counts_per_metre(self._folder / settings.calibration)
        return None if counts == _MILLIMETRES else counts

    @cached_property
    def rate_hz(self) -> float | None:
        """Frames per second: by the manifest's rate, else from the median step of the times."""
        if self._settings.rate_hz:
            return self._settings.rate_hz / usual_step(self.frames)
        return rate_of(self._files.times_ns.values()) if self._files.times_ns else None

    def time_ns(self, number: int) -> int:
        """Time from lists, names or a file; of none, or if the manifest gives a rate, the number over the rate."""
        check_number(number, self.frames, self._folder)
        if self._files.times_ns is None or self._settings.rate_hz:
            return number_time_ns(number, self._settings.rate_hz)
        return self._files.times_ns[number]

    def frame(self, number: int) -> StereoFrame:
        """Read one frame."""
        time_ns, files = self.time_ns(number), self._files
        left = read_rgb(files.colours[number])
        depth_m = read_depth_file(files.depths[number], self._settings.depth_scale, self._counts_per_m)
        with located(f"{self._folder}: frame {number}"):
            if left.shape[:2] != depth_m.shape:
                sizes = " and depth ".join(width_by_height(pixels) for pixels in (left, depth_m))
                raise VfoaError(
                    f"colour is {sizes} pixels; expected depth that the camera's software aligned with colour"
                )
            image, depth = self._optics.image(left, "colour image"), self._optics.depth(depth_m)
        return StereoFrame(index=number, time_ns=time_ns, left=image, depth_m=depth, rig=self._optics.rig)

    def truth(self, number: int) -> Truth:
        """The source has no ground truth."""
        return Truth()

    def digest(self) -> str:
        """Digest of the files' bytes, the frames' numbers and the settings, but not of the files' names."""
        files = self._files
        roles = (("colour", files.colours), ("depth", files.depths))
        paths = [(f"{role} {number}", path_of[number]) for number in self.frames for role, path_of in roles]
        if self._settings.calibration is not None:
            paths.append(("calibration", self._folder / self._settings.calibration))
        settings = self._settings.model_dump_json(exclude={"colour", "depth", "calibration", "stamps", "times"})
        return hashlib.sha256(f"{digest_files(paths)} {files.times_ns} {settings}".encode()).hexdigest()

    @cached_property
    def _optics(self) -> DepthOptics:
        height, width = read_rgb(self._files.colours[self.frames[0]]).shape[:2]
        settings = self._settings
        if settings.camera is not None:
            return DepthOptics(settings.camera.camera((width, height)), str(self._folder))
        assert settings.calibration is not None
        path = self._folder / settings.calibration
        return DepthOptics(read_one_camera(path, (width, height), rectified=settings.rectified), str(path))
