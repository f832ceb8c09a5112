"""MPI Sintel: one scene and one pass of the stereo set, with the data of the depth and segmentation sets."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from harness.files.digests import digest_files
from harness.files.io import read_bytes
from harness.sources import Recognised, Truth, check_number, given_root
from harness.sources.calibration import Calibration, check_size
from harness.sources.media.images import read_raw, read_rgb
from harness.sources.media.maps import read_disparity, small_ids
from harness.sources.stereo_pairs import check_sizes
from vfoa.errors import VfoaError, did_you_mean
from vfoa.pixels import relabel
from vfoa.settings import Settings
from vfoa.types import Disparity, Float, Instance, Instances, StereoFrame

_CAMERA_TAG = np.float32(202021.25)


def read_camera(path: Path) -> Float:
    """Read the intrinsics M (3, 3), pixels, of a Sintel ``.cam``: float32 tag, float64[9] M, float64[12] N.

    Raises
    ------
    VfoaError
        If the file is not one.
    """
    data = read_bytes(path)
    if len(data) != 4 + 21 * 8 or np.frombuffer(data, "<f4", 1)[0] != _CAMERA_TAG:
        raise VfoaError(f"{path}: not a Sintel camera: expected {4 + 21 * 8} bytes with the tag {_CAMERA_TAG}")
    matrix = np.frombuffer(data, "<f8", 9, offset=4).reshape(3, 3).astype(np.float64)
    if not (np.isfinite(matrix).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise VfoaError(f"{path}: expected finite intrinsics with positive focal lengths, found {matrix.tolist()}")
    return matrix


def read_segments(path: Path) -> NDArray[np.uint32]:
    """Read the ids (H, W) of a segmentation PNG: id = (R 256 + G) 256 + B; VfoaError for another file."""
    image = read_raw(path)
    if image.ndim != 3 or image.dtype != np.uint8:
        raise VfoaError(f"{path}: found shape {image.shape} of {image.dtype}; expected Sintel's 8-bit RGB segmentation")
    return image.astype(np.uint32) @ np.array([65536, 256, 1], dtype=np.uint32)


BASELINE_M = 0.10
"""Baseline of the parallel stereo cameras (the stereo set's README)."""

RATE_HZ = 24.0
"""Frame rate of the film."""

PASSES = ("clean", "final")

LICENCE = "CC-BY 3.0, (c) Blender Foundation"

_NAME = re.compile(r"frame_([0-9]{4}|[1-9][0-9]{4,})\.png")
_HOLDERS = {
    "disparities": "the stereo set",
    "segmentation": "the segmentation set",
    "camdata_left": "the depth set, which holds the cameras,",
}
"""The archive of each folder; the views are in the stereo set."""

_TRUTH = {"disparities": "disparity", "segmentation": "instances"}
"""What each optional folder is the truth of."""


class SintelSettings(Settings):
    """The scene and the render pass: ``clean`` (no fog, no blur) or ``final``."""

    scene: str
    render_pass: Literal["clean", "final"] = Field(default="clean", alias="pass")


class SintelClip:
    """One scene, in the folders of the official archives, unpacked into one place.

    root/training/
      clean_left/SCENE/frame_0001.png       clean_right/SCENE/...     or final_left, final_right
      camdata_left/SCENE/frame_0001.cam     intrinsics, read for every frame: fx changes within some scenes
      disparities/SCENE/frame_0001.png      optional: true disparity
      segmentation/SCENE/frame_0001.png     optional: true instances, without names: label "segment"
    """

    Settings = SintelSettings
    rate_hz = RATE_HZ
    notes: tuple[str, ...] = ()

    def __init__(self, settings: SintelSettings, root: Path | None) -> None:
        self._scene, self._pass = settings.scene, settings.render_pass
        self._training = given_root(root) / "training"
        if not self._training.is_dir():
            raise VfoaError(f"{self._training}: no such folder; expected MPI Sintel's stereo set, unpacked")
        self._check_scene()
        folder = self._path(f"{self._pass}_left", 1).parent
        matches = (_NAME.fullmatch(path.name) for path in folder.iterdir())
        self.frames = tuple(sorted(int(match[1]) for match in matches if match))
        """The film's frame numbers, from 1."""
        if not self.frames:
            raise VfoaError(f"{folder}: no images; expected frame_0001.png and so on")
        for kind in (f"{self._pass}_right", "camdata_left"):
            if missing := [path for number in self.frames if not (path := self._path(kind, number)).is_file()]:
                raise VfoaError(f"{missing[0]}: {_expected(kind)} ({len(missing)} of {len(self.frames)} are missing)")

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise each scene and pass at or below a path inside the set; a scene's folder is that scene only."""
        training = next((folder for folder in (path / "training", path, *path.parents) if _is_training(folder)), None)
        if training is None:
            return ()
        kind, scene = (*path.relative_to(training).parts[:2], "", "")[:2] if path.is_relative_to(training) else ("", "")
        return tuple(
            Recognised(
                root=training.parent,
                source={"scene": folder.name, "pass": render_pass},
                layout=f"MPI Sintel, scene {folder.name}, {render_pass} pass",
                name=f"sintel_{folder.name}" + ("" if render_pass == "clean" else f"_{render_pass}"),
                calibration="camdata_left, read for every frame",
                licence=LICENCE,
            )
            for render_pass in ([kind.partition("_")[0]] if kind.partition("_")[0] in PASSES else PASSES)
            for folder in sorted((training / f"{render_pass}_left").glob("*"))
            if folder.is_dir() and scene in ("", folder.name)
        )

    def time_ns(self, number: int) -> int:
        """Time in the film: number over rate."""
        check_number(number, self.frames, self._scene)
        return round(number * 1e9 / RATE_HZ)

    def frame(self, number: int) -> StereoFrame:
        """Read one pair and its camera."""
        time_ns = self.time_ns(number)
        paths = self._path(f"{self._pass}_left", number), self._path(f"{self._pass}_right", number)
        left, right = map(read_rgb, paths)
        check_sizes(left, right, *paths)
        k = read_camera(self._path("camdata_left", number))
        rig = Calibration.of_equal_cameras(k, BASELINE_M).rig(left.shape[1], left.shape[0])
        return StereoFrame(index=number, time_ns=time_ns, left=left, right=right, rig=rig)

    def truth(self, number: int) -> Truth:
        """Disparity and instances, each if its file exists."""
        check_number(number, self.frames, self._scene)
        missing = {
            name: f"{path}: {_expected(kind)}"
            for kind, name in _TRUTH.items()
            if not (path := self._path(kind, number)).is_file()
        }
        return Truth(
            disparity=None if "disparity" in missing else self._disparity(number),
            instances=None if "instances" in missing else self._instances(number),
            missing=missing,
        )

    def digest(self) -> str:
        """Digest of the bytes of the images, the cameras and the truth, and the frames' numbers."""
        kinds = f"{self._pass}_left", f"{self._pass}_right", "camdata_left", *_TRUTH
        paths = ((number, kind, self._path(kind, number)) for number in self.frames for kind in kinds)
        return digest_files(
            (f"{number} {kind}", path) for number, kind, path in paths if kind not in _TRUTH or path.is_file()
        )

    def _path(self, kind: str, number: int) -> Path:
        suffix = "cam" if kind == "camdata_left" else "png"
        return self._training / kind / self._scene / f"frame_{number:04d}.{suffix}"

    def _check_scene(self) -> None:
        views = self._training / f"{self._pass}_left"
        if not views.is_dir():
            raise VfoaError(f"{views}: no such folder; expected the {self._pass} pass of MPI Sintel's stereo set")
        if not (views / self._scene).is_dir():
            scenes = [path.name for path in views.iterdir() if path.is_dir()]
            raise VfoaError(f"{views}: no scene {self._scene!r}; {did_you_mean(self._scene, scenes)}")

    def _check_size(self, path: Path, pixels: NDArray[Any]) -> None:
        """Reject a map that has not the images' size."""
        check_size(pixels.shape[::-1], self._size[::-1], f"{path}: found a map", "as the scene's images have")

    @cached_property
    def _size(self) -> tuple[int, int]:
        """(height, width) of the scene's images."""
        return read_rgb(self._path(f"{self._pass}_left", self.frames[0])).shape[:2]

    def _disparity(self, number: int) -> Disparity:
        path = self._path("disparities", number)
        disparity_px = read_disparity(path)
        self._check_size(path, disparity_px)
        return Disparity(disparity_px=disparity_px)

    def _instances(self, number: int) -> Instances:
        path = self._path("segmentation", number)
        ids = relabel(read_segments(path), self._small_ids)
        self._check_size(path, ids)
        segments = (
            Instance(id=int(number), label="segment", category_id=0, is_thing=True, score=1.0)
            for number in np.unique(ids)
            if number
        )
        return Instances(ids=ids, instances=tuple(segments))

    @cached_property
    def _small_ids(self) -> dict[int, int]:
        """16-bit ids for the whole scene's segments, so that an object has the same id in every frame."""
        paths = [path for number in self.frames if (path := self._path("segmentation", number)).is_file()]
        segment_ids = (int(segment_id) for path in paths for segment_id in np.unique(read_segments(path)))
        return small_ids(segment_ids, f"{self._training / 'segmentation' / self._scene}")


def _expected(kind: str) -> str:
    holder = _HOLDERS.get(kind, "the stereo set")
    return f"no such file; expected {holder} of MPI Sintel (vfoa clips fetch sintel)"


def _is_training(folder: Path) -> bool:
    return folder.name == "training" and any((folder / f"{render_pass}_left").is_dir() for render_pass in PASSES)
