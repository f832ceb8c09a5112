"""Which calibrations lie beside a clip's images. For proposals: a manifest then says which one it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.adapters.calibration import Calibration
from harness.adapters.calibration_files.documents import SUFFIXES
from harness.adapters.calibration_files.options import ImageSize, Options
from harness.adapters.calibration_files.read import NO_OPTIONS, read_cameras
from harness.adapters.side_names import pair_names
from vfoa.errors import VfoaError

LARGEST_BYTES = 1_000_000
"""A longer text is no calibration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundCalibration:
    """``source`` is what a manifest says, ``calibration`` the rectified pair's; ``rectifies``: images that are not."""

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
    """Every file, or pair of files, that can be read as a calibration of images of this (width, height).

    ``options.cameras`` holds for KITTI's files. ``candidates`` are paths relative to ``root``; unsaid, all that
    could be one in the folder and the folders in it.
    """
    found = (_read(root, names, size, options) for names in candidates or _candidates(root))
    return tuple(each for each in found if each is not None)


def _candidates(root: Path) -> Iterator[tuple[str, ...]]:
    files = [path for pattern in ("*", "*/*") for path in sorted(root.glob(pattern))]
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


def _read(root: Path, names: tuple[str, ...], size: ImageSize, options: Options) -> FoundCalibration | None:
    if not names[0].endswith(".txt"):  # numbers of KITTI's cameras mean nothing for another file
        options = replace(options, cameras=None)
    try:
        cameras = read_cameras([root / name for name in names], size, options)
    except VfoaError:
        return None
    is_rectified = isinstance(cameras, Calibration)
    calibration = cameras if isinstance(cameras, Calibration) else cameras.rectified()
    if calibration.size_px not in (None, size()):
        return None
    source = {"calibration": names[0] if len(names) == 1 else list(names)}
    return FoundCalibration(source=source, calibration=calibration, rectifies=not is_rectified)
