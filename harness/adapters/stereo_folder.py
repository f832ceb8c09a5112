"""Two folders (or patterns) of images and one calibration; unrectified pairs are rectified."""

from __future__ import annotations

import hashlib
from functools import cached_property
from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from harness.adapters import Truth
from harness.adapters.calibration import Calibration, read_calibration
from harness.adapters.opencv_pair import read_opencv_pair
from harness.adapters.rectification import RawCalibration, Rectifier
from harness.files import digest_files, read_bytes
from harness.frame_files import find_frames
from harness.images import read_rgb
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.types import Image, StereoFrame, StereoRig


class CameraNumbers(Settings):
    """A rectified pair in four numbers; fy is fx and both views share cx where nothing else is said."""

    fx_px: float = Field(gt=0)
    cx_px: float
    cy_px: float
    baseline_m: float = Field(gt=0)
    fy_px: float | None = Field(default=None, gt=0)
    cx_right_px: float | None = None

    def calibration(self) -> Calibration:
        """The same as a :class:`Calibration`."""
        return Calibration(
            fx_px=self.fx_px,
            fy_px=self.fx_px if self.fy_px is None else self.fy_px,
            cx_px=self.cx_px,
            cy_px=self.cy_px,
            cx_right_px=self.cx_px if self.cx_right_px is None else self.cx_right_px,
            baseline_m=self.baseline_m,
        )


class StereoFolderSettings(Settings):
    """Where the views are, under the manifest's root, and how they were calibrated: a file or four numbers.

    ``left`` and ``right`` are a folder, a glob (``left*.png``) or a pattern (``left/%06d.png``). Without ``rate_hz``
    the frames are a second apart.
    """

    left: str
    right: str
    calibration: str | None = None
    camera: CameraNumbers | None = None
    kitti_cameras: tuple[int, int] = (2, 3)
    rectified: bool = False
    rate_hz: float | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _one_calibration(self) -> Self:
        if (self.calibration is None) == (self.camera is None):
            found = "neither" if self.camera is None else "both"
            raise ValueError(f"found {found}; expected either calibration (a file) or camera (four numbers)")
        return self


class StereoFolderClip:
    """A clip from numbered files. A frame's number is the digits in its name; gaps stay gaps.

    root/
      left/000007.png     any image OpenCV reads; left and right are joined by number
      right/000007.png    the same size
      calib.txt           KITTI's P2 and P3, or OpenCV's P1 and P2 in .yml
      stereo.yml          or what vfoa calibrate writes: pairs as the cameras saw them are rectified by it
    """

    Settings = StereoFolderSettings

    def __init__(self, settings: StereoFolderSettings, root: Path | None) -> None:
        self._settings = settings
        folder = root if root is not None else Path.cwd()
        if not folder.is_dir():
            raise VfoaError(f"{folder}: no such folder; expected the clip's root")
        self._left = find_frames(folder, settings.left, "source.left")
        self._right = find_frames(folder, settings.right, "source.right")
        for number in sorted(self._left.keys() ^ self._right.keys()):
            side, file, pattern = (
                ("right", self._left[number], settings.right)
                if number in self._left
                else ("left", self._right[number], settings.left)
            )
            raise VfoaError(f"{file}: frame {number} has no {side} image; expected one in {folder / pattern}")
        self._raw_digest = ""
        self._raw = self._read_raw(folder)
        self._calibration = self._read_calibration(folder) if self._raw is None else self._raw.rectified()

    @property
    def frames(self) -> tuple[int, ...]:
        """The numbers in the files' names, ascending."""
        return tuple(self._left)

    @property
    def rate_hz(self) -> float | None:
        """As the manifest says."""
        return self._settings.rate_hz

    @property
    def notes(self) -> tuple[str, ...]:
        """None: the folder knows nothing of its images."""
        return ()

    def frame(self, number: int) -> StereoFrame:
        """Read one pair."""
        if number not in self._left:
            raise VfoaError(f"no frame {number}; expected {self.frames[0]} to {self.frames[-1]}")
        left, right = read_pair(self._left[number], self._right[number])
        if self._rectifier is not None:
            left, right = self._rectify(self._rectifier, number, left, right)
        return StereoFrame(
            index=number,
            time_ns=round(number * 1e9 / (self.rate_hz or 1.0)),
            left=left,
            right=right,
            rig=self._rig(self._left[number], left),
        )

    def truth(self, number: int) -> Truth:
        """Nothing is known."""
        return Truth()

    def digest(self) -> str:
        """Of the images' bytes, their numbers, the calibration and the rate."""
        images = digest_files(
            (f"{number} {side}", files[number])
            for number in self.frames
            for side, files in (("left", self._left), ("right", self._right))
        )
        return hashlib.sha256(f"{images} {self._calibration} {self.rate_hz}{self._raw_digest}".encode()).hexdigest()

    @cached_property
    def _rectifier(self) -> Rectifier | None:
        return None if self._raw is None else Rectifier(self._raw)

    def _rectify(self, rectifier: Rectifier, number: int, left: Image, right: Image) -> tuple[Image, Image]:
        try:
            return rectifier.rectify(left, right)
        except VfoaError as error:
            raise VfoaError(f"{self._left[number]}: {error}") from None

    def _read_raw(self, folder: Path) -> RawCalibration | None:
        file = self._settings.calibration
        if file is None or self._settings.rectified or Path(file).suffix.lower() not in (".yml", ".yaml", ".xml"):
            return None
        raw = read_opencv_pair(folder / file)
        self._raw_digest = "" if raw is None else hashlib.sha256(read_bytes(folder / file)).hexdigest()
        return raw

    def _read_calibration(self, folder: Path) -> Calibration:
        if self._settings.camera is not None:
            return self._settings.camera.calibration()
        return read_calibration(
            folder / str(self._settings.calibration),
            kitti_cameras=self._settings.kitti_cameras,
            rectified=self._settings.rectified,
        )

    def _rig(self, path: Path, left: Image) -> StereoRig:
        try:
            return self._calibration.rig(left.shape[1], left.shape[0])
        except VfoaError as error:
            raise VfoaError(f"{path}: {error}") from None


def read_pair(left_path: Path, right_path: Path) -> tuple[Image, Image]:
    """Read two images (H, W, 3) uint8 RGB of the same size.

    Raises
    ------
    VfoaError
        If one cannot be read, or the sizes differ.
    """
    left, right = read_rgb(left_path), read_rgb(right_path)
    if left.shape != right.shape:
        raise VfoaError(
            f"{right_path}: the right image is {right.shape[1]} x {right.shape[0]} pixels, "
            f"the left one ({left_path.name}) {left.shape[1]} x {left.shape[0]}"
        )
    return left, right
