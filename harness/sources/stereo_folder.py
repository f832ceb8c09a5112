"""Pairs of images or videos in files, and one calibration; unrectified pairs are rectified."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from harness.files.ascending import usual_step
from harness.sources import Recognised, Truth, check_number, given_root
from harness.sources.calibration import Calibration, check_first_size, first_size
from harness.sources.calibration_files.read import Options, read_cameras
from harness.sources.depth_optics import Intrinsics, check_one_calibration
from harness.sources.media.frame_times import number_time_ns, untimed_note
from harness.sources.rectification import Cameras, Rectifier, scaled_to, scaling_note, shrinking_note
from harness.sources.stereo_pairs import PairFiles
from vfoa.errors import VfoaError, located
from vfoa.types import Image, StereoFrame


class StereoFolderSettings(PairFiles, Options):
    """Files of the views, under the manifest's root, and their calibration: a file or four numbers.

    ``calibration`` is a file, or two (left and right of ROS or EuRoC, intrinsics and extrinsics of OpenCV), or three
    (left, right, and how they stand). ``rate_hz`` is how many numbers of frames a second has. Without it, times are
    those of the video or in the names; images without either count as 25 numbers a second.
    """

    calibration: str | Annotated[tuple[str, ...], Field(min_length=2, max_length=3)] | None = None
    camera: Intrinsics | None = None
    rate_hz: float | None = Field(default=None, ge=1e-3, le=1e6)

    @model_validator(mode="after")
    def _one_calibration(self) -> Self:
        check_one_calibration(self.calibration, self.camera)
        if self.camera is not None and (self.baseline_m is not None or self.calibration_unit != "m"):
            raise ValueError(
                "baseline_m, calibration_unit: found beside camera; expected camera.baseline_m alone, in m"
            )
        return self


class StereoFolderClip:
    """A clip from numbered images (a frame's number is the digits in its name; gaps stay gaps) or videos (from 0).

    root/
        left/000007.png     any image OpenCV reads; left and right are joined by number
        right/000007.png    the same size
        stereo.yml          written by vfoa calibrate, or another file of calibration_files; it rectifies unrectified
                            pairs

    training/                           KITTI 2015: *_10.png are recognised; scenes differ in calibration and size
        image_2/000000_10.png           000000_11.png is the next frame
        image_3/000000_10.png
    2011_09_26_drive_0001_sync/         KITTI raw
        image_02/data/0000000000.png
        image_02/timestamps.txt         2011-09-26 13:02:25.964389445
        image_03/data/0000000000.png
    artroom1/                           Middlebury 2021
        im0.png  im1.png  calib.txt
        ambient/L0/im0e0.png            the same under other lights: left out
    """

    Settings = StereoFolderSettings

    def __init__(self, settings: StereoFolderSettings, root: Path | None) -> None:
        self._settings = settings
        self._folder = folder = given_root(root)
        if not folder.is_dir():
            raise VfoaError(f"{folder}: no such folder; expected the clip's root")
        self._views = settings.views(folder)
        self.frames = self._views.frames
        given_hz = settings.rate_hz and settings.rate_hz / usual_step(self.frames)
        self.rate_hz = given_hz or self._views.rate_hz
        """Frames per second: by the manifest's rate, else that of the files."""
        self._cameras = self._read_cameras(folder)
        self._rectifier: Rectifier | None = None

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise layouts of images or videos, or the files that the user names, and calibrations beside them."""
        from harness.sources.stereo_layouts import recognise_stereo

        return recognise_stereo(path, given)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes: frames left out, and a calibration scaled to another resolution."""
        camera, notes = self._settings.camera, self._views.notes
        if self.rate_hz is None and self._views.time_ns(self.frames[0]) is None:
            notes += untimed_note(self.frames)
        try:
            return (
                *notes,
                *(camera.notes if camera else ()),
                *scaling_note(self._cameras, self._size_px),
                *shrinking_note(self._cameras),
            )
        except VfoaError:  # the first frame cannot be read; reading it gives the error
            return notes

    @property
    def films(self) -> Mapping[str, float]:
        """The videos, with the times of the clip's first frame in them."""
        return self._views.films

    def time_ns(self, number: int) -> int:
        """Time from the files, or the number over the manifest's rate (without times, or if it gives a rate)."""
        check_number(number, self.frames, self._folder)
        stamp_ns = None if self._settings.rate_hz else self._views.time_ns(number)
        return number_time_ns(number, self._settings.rate_hz) if stamp_ns is None else stamp_ns

    def frame(self, number: int) -> StereoFrame:
        """Read one pair."""
        time_ns = self.time_ns(number)
        left, right = self._views.read(number)
        with located(self._views.where(number)):
            rectifier = self._rectifier_of(left)
            left, right = rectifier.rectify(left, right)
            rig = rectifier.calibration.rig(left.shape[1], left.shape[0])
        return StereoFrame(index=number, time_ns=time_ns, left=left, right=right, rig=rig)

    def left(self, number: int) -> Image:
        """The rectified left image of a frame, without the right one."""
        self.time_ns(number)
        left = self._views.read_left(number)
        with located(self._views.where(number)):
            return self._rectifier_of(left).rectify_left(left)

    def truth(self, number: int) -> Truth:
        """The source has no ground truth."""
        return Truth()

    def digest(self) -> str:
        """Digest of the files' bytes, the frames' numbers, the calibration, the rate and the unit of stamps."""
        digest = hashlib.sha256(f"{self._views.digest()} {self.rate_hz} {self._settings.stamps} ".encode())
        cameras = self._cameras
        digest.update(
            str(cameras).encode() if isinstance(cameras, Calibration) else cameras.left.key + cameras.right.key
        )
        return digest.hexdigest()

    def _rectifier_of(self, left: Image) -> Rectifier:
        """The rectifier of an image, which has the size of the clip's first one; computed when one is read."""
        size_px = self._size_px
        check_first_size((left.shape[1], left.shape[0]), size_px)
        if self._rectifier is None:
            self._rectifier = Rectifier(scaled_to(self._cameras, size_px))
        return self._rectifier

    def _read_cameras(self, folder: Path) -> Cameras:
        settings = self._settings
        if settings.camera is not None:
            return settings.camera.pair(str(folder), lambda: self._size_px)
        files = (settings.calibration,) if isinstance(settings.calibration, str) else settings.calibration
        paths = [folder / file for file in files or ()]
        return read_cameras(paths, lambda: self._size_px, settings)

    @cached_property
    def _size_px(self) -> tuple[int, int]:
        return first_size(self._views.read_left, self.frames)
