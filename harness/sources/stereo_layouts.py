"""Find the layouts of ``stereo_folder`` that fit a path, each with the calibration files that fit it."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from harness.sources import Recognised
from harness.sources.calibration_files.read import Options, find_calibrations
from harness.sources.media.frame_files import IMAGE_SUFFIXES, find_frames, numbered_views, pair_names, walk_files
from harness.sources.media.images import read_raw, read_rgb
from harness.sources.media.video import VIDEO_SUFFIXES, Video
from harness.sources.stereo_views import (
    TICKS_NS,
    ImagePairs,
    PackedImages,
    PackedVideo,
    Packing,
    StampUnit,
    VideoPair,
    ViewFiles,
    Views,
    find_sides,
)
from vfoa.errors import VfoaError
from vfoa.types import Float, Image
from vfoa.validation import parse

ALIKE = 0.25
"""Least correlation of two halves that are taken for two views of one scene.

Over nine real pairs (KITTI, chessboards close by, Sintel) the two views reach 0.28 to 0.89, halves of single views at
most 0.21.
"""

_WIDTH = 96
_KITTI_2015 = "*_10.png"
"""The frames with ground truth; ``*_11.png`` are the next ones of the same scenes."""
_TIMES = "timestamps.txt"
_DEPTH_WORD = re.compile(r"depth|disp", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundLayout:
    """One way to read a path as a stereo clip: ``root`` and ``source`` are a manifest's, ``views`` what they give.

    ``size_px`` is the (width, height) of one view.
    """

    root: Path
    source: dict[str, str]
    views: Views
    size_px: tuple[int, int]

    def __str__(self) -> str:
        names = ", ".join(f"{key} {value!r}" for key, value in self.source.items() if key != "layout")
        count, (width, height), rate_hz = len(self.views.frames), self.size_px, self.views.rate_hz
        rate = "" if rate_hz is None else f", {rate_hz:g} Hz"
        pairs = f"{count} {'pair' if count == 1 else 'pairs'}"
        return f"{self.source['layout']}: {pairs} of {width} x {height}{rate} ({names})"


def find_layouts(path: Path) -> tuple[FoundLayout, ...]:
    """Return every layout that the files at ``path`` (a folder, or one video or image) fit, most frames first.

    Sides are recognised by names (:func:`pair_names`), two views in one file by halves that
    look alike. Empty if nothing is found: a folder of single images is no stereo clip.

    Raises
    ------
    VfoaError
        If there is nothing at the path, it is a file that cannot be read, or the first pair of a layout cannot be read
        (for videos only if no images form a pair).
    """
    if not path.exists():
        raise VfoaError(f"{path}: no such file or folder")
    if path.is_file():
        if path.suffix.lower() in VIDEO_SUFFIXES:
            Video(path).read(0)
        else:
            read_rgb(path)
        return tuple(_packed(path.parent, path.name, path))
    images, videos = _files_by_folder(path, IMAGE_SUFFIXES), _files_by_folder(path, VIDEO_SUFFIXES)
    pairs = list(_image_pairs(path, images))
    try:
        for left, right in pair_names([file for files in videos.values() for file in files], numbered=False):
            source = {"layout": "videos", "left": left, "right": right}
            pairs.append(_found(path, source, VideoPair(path / left, path / right)))
    except VfoaError:
        if not pairs:
            raise
    found = pairs or [each for name, files in images.items() for each in _packed(path, name, path / files[0])]
    lonely = [] if pairs else [file for files in videos.values() for file in files]
    found += [each for file in lonely for each in _packed(path, file, path / file)]
    return tuple(sorted(found, key=lambda each: (-len(each.views.frames), len(each.source.get("left", "")))))


def _files_by_folder(root: Path, suffixes: frozenset[str]) -> dict[str, list[str]]:
    """Files' paths under ``root``, sorted, by the folder that holds them; both as written in a manifest."""
    return {
        folder.as_posix(): [(folder / name).as_posix() for name in names]
        for folder, names in walk_files(root, suffixes)
        if names
    }


def _image_pairs(root: Path, images: dict[str, list[str]]) -> Iterator[FoundLayout]:
    for left, right in pair_names(images, numbered=False):
        yield from _pair_of_images(root, left, right)
    for folder, files in images.items():
        prefix, names = "" if folder == "." else f"{glob.escape(folder)}/", [Path(file).name for file in files]
        for left, right in (*pair_names(names, numbered=True), *numbered_views(names)):
            yield from _pair_of_images(root, prefix + left, prefix + right)


def _pair_of_images(root: Path, left: str, right: str) -> Iterator[FoundLayout]:
    stamps: StampUnit | None = None
    try:
        try:
            lefts, rights = find_sides(root, left, right)
        except VfoaError:  # two numbers in each name
            left, right = f"{left}/{_KITTI_2015}", f"{right}/{_KITTI_2015}"
            lefts, rights = find_sides(root, left, right)
        stamps = _stamps((*lefts, *rights))
        views = ImagePairs(lefts, rights, TICKS_NS[stamps] if stamps else None)
    except VfoaError as error:
        if stamps is None:
            return  # names that say a side but share no numbering are no pair
        told = f"--set left={left} --set right={right} --set stamps={stamps} --set tolerance_ms=MS"
        raise VfoaError(f"{root}: {error} ({told})") from None
    source = {"layout": "images", "left": left, "right": right} | ({"stamps": stamps} if stamps else {})
    times = Path(left).parent / _TIMES  # KITTI's image_02/timestamps.txt beside image_02/data
    if (root / left).is_dir() and (root / times).is_file():
        source["times"] = times.as_posix()
    yield _found(root, source, views)


def read_layout(root: Path, files: ViewFiles) -> FoundLayout:
    """Return the layout of files that the user names; raises the errors of their :meth:`ViewFiles.views`."""
    source = files.model_dump(mode="json", exclude_defaults=True, exclude={"stamps", "swap"})
    views = files.views(root)
    stamps = files.stamps
    if files.layout == "images" and stamps is None and (stamps := _stamps(views.frames)):
        source["stamps"] = stamps
        views = files.model_copy(update={"stamps": stamps}).views(root)
    return _found(root, {"layout": files.layout, **source}, views)


def _stamps(frames: Iterable[int]) -> StampUnit | None:
    """The unit of numbers that are times since 1970: today's have 13 digits in ms, 16 in us, 19 in ns."""
    units: dict[int, StampUnit] = {13: "ms", 16: "us", 19: "ns"}
    lengths = {len(str(number)) for number in frames}
    return units.get(lengths.pop()) if len(lengths) == 1 else None


def _packed(root: Path, name: str, first: Path) -> Iterator[FoundLayout]:
    """``name`` (a file, or a folder of images) as both views in one picture, the likelier packing first."""
    packings: tuple[Packing, ...] = ("side_by_side", "top_bottom")
    is_video = first.suffix.lower() in VIDEO_SUFFIXES
    if not is_video and (_DEPTH_WORD.search((root / name).name) or _is_map(first)):
        return  # one view's depth or disparity: its halves are alike where the floor or a wall is
    found = []
    for packing in packings:
        try:
            views = PackedVideo(first, packing) if is_video else PackedImages(find_frames(root, name, name), packing)
            likeness = _likeness(*views.read(views.frames[0]))
        except VfoaError:
            continue  # an odd width, or names without a number
        if likeness >= ALIKE:
            layout = f"{'video' if is_video else 'images'}_{packing}"
            found.append((likeness, _found(root, {"layout": layout, "both": name}, views)))
    yield from (layout for _, layout in sorted(found, key=lambda each: -each[0]))


def _is_map(image: Path) -> bool:
    """Whether a file has one channel of more than 8 bits, as maps of depth and disparity have."""
    pixels = read_raw(image)
    return pixels.ndim == 2 and pixels.dtype != np.uint8


def _found(root: Path, source: dict[str, str], views: Views) -> FoundLayout:
    left, _ = views.read(views.frames[0])
    return FoundLayout(root=root, source=source, views=views, size_px=(left.shape[1], left.shape[0]))


def _likeness(left: Image, right: Image) -> float:
    """Greatest correlation of the two over horizontal shifts up to a quarter of the width; 0 without contrast."""
    views = [_small(view) for view in (left, right)]
    width = views[0].shape[1]
    shifts = range(width // 4 + 1)
    return max(_correlation(views[0][:, shift:], views[1][:, : width - shift]) for shift in shifts)


def _small(view: Image) -> Float:
    height = max(1, round(view.shape[0] * _WIDTH / view.shape[1]))
    gray = cv2.resize(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), (_WIDTH, height), interpolation=cv2.INTER_AREA)
    small = gray.astype(np.float64)
    # A bright sky over dark ground makes any two halves alike: remove what is the same along rows and columns.
    return small - small.mean(axis=1, keepdims=True) - small.mean(axis=0, keepdims=True)


def _correlation(first: Float, second: Float) -> float:
    first, second = first - first.mean(), second - second.mean()
    scale = float(np.sqrt((first**2).sum() * (second**2).sum()))
    return float((first * second).sum()) / scale if scale > 0 else 0.0


_KITTI_GRAY = re.compile(r"(^|/)image_0?0(/|$)")
_CALIBRATIONS = ("calibration", "camera")
_SHOWN = 4


def recognise_stereo(path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
    """Return every layout at a path, once for each file there that calibrates it, or without a calibration.

    Files that ``given`` names (``left`` and ``right``, or ``both`` and ``layout``) are the only layout.

    Raises
    ------
    VfoaError
        If named files cannot be read, or images are there but no pair of them is recognised.
    """
    if path.is_file() and path.suffix.lower() not in IMAGE_SUFFIXES | VIDEO_SUFFIXES:
        return ()
    named = _named_files(given)
    layouts = find_layouts(path) if named is None else (read_layout(path if path.is_dir() else path.parent, named),)
    if not layouts:
        _refuse_unpaired(path)
    return tuple(each for layout in layouts for each in _calibrated(layout, path, given))


def _named_files(given: Mapping[str, Any]) -> ViewFiles | None:
    """The user's settings of the views, if they are sufficient to read them."""
    files = {key: given[key] for key in ("layout", "left", "right", "both", "stamps", "tolerance_ms") if key in given}
    if not ({"left", "right"} <= files.keys() or {"layout", "both"} <= files.keys()):
        return None
    if "layout" not in files and Path(str(files["left"])).suffix.lower() in VIDEO_SUFFIXES:
        files["layout"] = "videos"
    return parse(ViewFiles, files, "--set")


def _refuse_unpaired(path: Path) -> None:
    images = [path.name]
    if path.is_dir():
        images = [file for files in _files_by_folder(path, IMAGE_SUFFIXES).values() for file in files]
    if not images:
        return
    shown = ", ".join(images[:_SHOWN]) + (" ..." if len(images) > _SHOWN else "")
    raise VfoaError(
        f"{path}: no two views are seen in the names of {len(images)} images ({shown}); expected --set left=FILES "
        "--set right=FILES (a folder, a file, a glob or a pattern such as left_%04d.png; in the manifest: left = and "
        "right = in [source]), or --set layout=images_side_by_side --set both=FILES"
    )


def _calibrated(layout: FoundLayout, path: Path, given: Mapping[str, Any]) -> list[Recognised]:
    """The layout with each calibration for images of this size, at most two folders below or one above."""
    gray = bool(_KITTI_GRAY.search(layout.source.get("left", "")))
    baseline = given.get("baseline_m")
    options = Options(
        cameras=(0, 1) if gray else None,
        fisheye=given.get("fisheye") is True,
        rectified=given.get("rectified") is True,
        baseline_m=float(baseline) if isinstance(baseline, int | float) and baseline > 0 else None,
    )
    calibrations: list[tuple[str, ...]] = []
    incomplete: list[str] = []
    if not any(key in given for key in _CALIBRATIONS):
        calibrations, incomplete = find_calibrations(layout.root, lambda: layout.size_px, options)
        if not calibrations:  # KITTI's raw recordings: one file for all drives of a day
            of_the_day = [("../calib_cam_to_cam.txt",)]
            calibrations, _ = find_calibrations(layout.root, lambda: layout.size_px, options, of_the_day)

    def recognised(files: tuple[str, ...]) -> Recognised:
        source: dict[str, Any] = {**layout.source}
        if files:
            source["calibration"] = files[0] if len(files) == 1 else list(files)
            source |= {"calibration_cameras": [0, 1]} if gray and files[0].endswith(".txt") else {}
        return Recognised(
            root=layout.root,
            source=source,
            layout=str(layout),
            name=path.stem if path.is_file() else path.name,
            calibration=" and ".join(files) or None,
            # A file that cannot be used alone is reported only if no other can.
            incomplete=() if calibrations else tuple(dict.fromkeys(incomplete)),
        )

    return [recognised(files) for files in calibrations or [()]]
