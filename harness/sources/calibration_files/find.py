"""Find the calibrations beside a clip's images, as proposals: a manifest then names one of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.documents import SUFFIXES
from harness.sources.calibration_files.incomplete import IncompleteCalibrationError
from harness.sources.calibration_files.options import ImageSize, Options
from harness.sources.calibration_files.read import NO_OPTIONS, read_cameras
from harness.sources.calibration_files.scaling import scaled_to
from harness.sources.media.frame_files import pair_names
from vfoa.errors import VfoaError

LARGEST_BYTES = 1_000_000
"""A longer text is no calibration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundCalibration:
    """``source``: settings of a manifest; ``calibration``: the rectified pair's; ``rectifies``: it rectifies images."""

    source: dict[str, Any]
    calibration: Calibration
    rectifies: bool

    def __str__(self) -> str:
        files = self.source["calibration"]
        names = files if isinstance(files, str) else " and ".join(files)
        does = "rectifies the images" if self.rectifies else "of rectified images"
        return f"{names} (B {self.calibration.baseline_m:.4g} m, {does})"


def find_calibrations(
    root: Path, size: ImageSize, options: Options = NO_OPTIONS, candidates: Iterable[tuple[str, ...]] | None = None
) -> tuple[FoundCalibration, ...]:
    """Return every file, or pair of files, that calibrates images of this (width, height), scaled if necessary.

    ``options.cameras`` applies to KITTI's files. ``candidates`` are paths relative to ``root``; by default all
    candidates in the folder and in two levels of folders below it.
    """
    found = (_read(root, names, size, options) for names in candidates or _candidates(root))
    return tuple(each for each in found if isinstance(each, FoundCalibration))


def find_incomplete(root: Path, size: ImageSize, options: Options = NO_OPTIONS) -> tuple[str, ...]:
    """Return a note for every file that is a calibration and cannot be used alone, each once."""
    found = (_read(root, names, size, options) for names in _candidates(root))
    return tuple(dict.fromkeys(str(each) for each in found if isinstance(each, IncompleteCalibrationError)))


def _candidates(root: Path) -> Iterator[tuple[str, ...]]:
    files = [path for pattern in ("*", "*/*", "*/*/*") for path in sorted(root.glob(pattern))]
    names = [
        path.relative_to(root).as_posix()
        for path in files
        if path.suffix.lower() in SUFFIXES | {".conf", ".txt"} and path.is_file()
        if path.stat().st_size <= LARGEST_BYTES
    ]
    yield from ((name,) for name in names)
    documents = [name for name in names if Path(name).suffix.lower() in SUFFIXES]
    yield from ((sides.left, sides.right) for sides in pair_names(documents, numbered=False))
    yield from ((name, other) for name in documents if (other := name.replace("intrinsic", "extrinsic")) != name)


def _read(root: Path, names: tuple[str, ...], size: ImageSize, options: Options) -> FoundCalibration | VfoaError | None:
    if not names[0].endswith(".txt"):  # camera numbers of KITTI mean nothing for another file
        options = replace(options, cameras=None)
    try:
        cameras = read_cameras([root / name for name in names], size, options)
    except VfoaError as error:
        return error
    is_rectified = isinstance(cameras, Calibration)
    try:
        cameras = scaled_to(cameras, size())
    except VfoaError as error:
        return error
    calibration = cameras if isinstance(cameras, Calibration) else cameras.rectified()
    source = {"calibration": names[0] if len(names) == 1 else list(names)}
    return FoundCalibration(source=source, calibration=calibration, rectifies=not is_rectified)
