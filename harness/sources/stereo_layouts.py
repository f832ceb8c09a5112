"""Find the layouts of ``stereo_folder`` that fit a path, each with the calibration files that fit it."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from harness.sources import Recognised
from harness.sources.calibration_files.read import Options, find_calibrations
from harness.sources.media import yarp
from harness.sources.media.frame_files import (
    IMAGE_SUFFIXES,
    find_frames,
    folders_by_number,
    numbered_views,
    pair_names,
    walk_files,
)
from harness.sources.media.frame_times import stamp_unit
from harness.sources.media.images import read_raw, read_rgb
from harness.sources.media.listed_times import find_times
from harness.sources.media.video import VIDEO_SUFFIXES, Video
from harness.sources.stereo_pairs import PACKINGS, PairFiles, StereoPairs, find_sides
from vfoa.errors import VfoaError, counted, listed
from vfoa.types import Image
from vfoa.validation import parse

ALIKE = 0.25
"""Least correlation of two halves that are taken for two views of one scene.

Over ten real pairs (KITTI, chessboards close by, Sintel) the two views reach 0.29 to 0.88 (one board: 0.24), halves of
single views at most 0.23.
"""

_WIDTH = 96
_LEAST_CONTRAST = 1e-3
_KITTI_2015 = "*_10.png"
"""The frames with ground truth; ``*_11.png`` are the next ones of the same scenes."""
_DEPTH_WORD = re.compile(r"depth|disp", re.IGNORECASE)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundLayout:
    """One way to read a path as a stereo clip: ``root`` and ``source`` are a manifest's, ``views`` what they give.

    ``size_px`` is the (width, height) of one view.
    """

    root: Path
    source: dict[str, str]
    views: StereoPairs
    size_px: tuple[int, int]

    def __str__(self) -> str:
        names = ", ".join(f"{key} {value!r}" for key, value in self.source.items() if key != "layout")
        count, (width, height), rate_hz = len(self.views.frames), self.size_px, self.views.rate_hz
        rate = "" if rate_hz is None else f", {rate_hz:g} Hz"
        pairs = counted(count, "pair")
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
    lone_videos = [file for files in videos.values() for file in files]
    pairs = list(_image_pairs(path, images))
    try:
        for left, right in pair_names(lone_videos, numbered=False):
            pairs.append(_open(path, PairFiles(layout="videos", left=left, right=right)))
    except VfoaError:
        if not pairs:
            raise
    if not pairs:
        packed = [*((name, files[0]) for name, files in images.items()), *((file, file) for file in lone_videos)]
        pairs = [layout for name, first in packed for layout in _packed(path, name, path / first)]
    return tuple(sorted(pairs, key=lambda layout: (-len(layout.views.frames), len(layout.source.get("left", "")))))


def _files_by_folder(root: Path, suffixes: frozenset[str]) -> dict[str, list[str]]:
    """Files' paths under ``root``, sorted, by the folder that holds them; both as written in a manifest."""
    return {
        folder.as_posix(): [(folder / name).as_posix() for name in names]
        for folder, names in walk_files(root, suffixes)
        if names
    }


def _image_pairs(root: Path, images: dict[str, list[str]]) -> Iterator[FoundLayout]:
    for left, right in _sides_by_name(root, images):
        yield from _pair_of_images(root, left, right)


def _sides_by_name(root: Path, images: dict[str, list[str]]) -> Iterator[tuple[str, str]]:
    """What may be two sides, by the names of folders, and of the files in each; both as written in a manifest."""
    yield from pair_names(images, numbered=False)
    of_frames = _folders_of_frames(root, images)
    for pattern, (left, right) in dict.fromkeys(of_frames.values()):
        yield f"{pattern}/{left}", f"{pattern}/{right}"
    for folder, files in images.items():
        if folder in of_frames:
            continue
        prefix, names = "" if folder == "." else f"{glob.escape(folder)}/", [Path(file).name for file in files]
        for left, right in (*pair_names(names, numbered=True), *numbered_views(names)):
            yield prefix + left, prefix + right


def _folders_of_frames(root: Path, images: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, tuple[str, str]]]:
    """The folders of single frames, each with the pattern of all (``frame_%d``) and the names of both views.

    They are called alike but for one number, and have a pair of the same names each, and nothing else: a scene of its
    own has its calibration.
    """
    found = dict[str, tuple[str, tuple[str, str]]]()
    for pattern, alike in folders_by_number(images).items():
        folders = [folder for folder in alike if len(images[folder]) == len([*(root / folder).iterdir()])]
        views = {pair_names([Path(file).name for file in images[folder]], numbered=False) for folder in folders}
        if len(folders) > 1 and len(views) == 1 and len(pair := views.pop()) == 1:
            found |= dict.fromkeys(folders, (pattern, pair[0]))
    return found


def _pair_of_images(root: Path, left: str, right: str) -> Iterator[FoundLayout]:
    logs = f"{left}/{yarp.LOG}", f"{right}/{yarp.LOG}"
    if all((root / log).is_file() for log in logs):
        yield _open_stamped(root, PairFiles(left=logs[0], right=logs[1], stamps="ns"))
        return
    try:
        try:
            lefts, rights = find_sides(root, left, right)
        except VfoaError:  # two numbers in each name
            left, right = f"{left}/{_KITTI_2015}", f"{right}/{_KITTI_2015}"
            lefts, rights = find_sides(root, left, right)
    except VfoaError:
        return  # names with a side but without a common numbering
    stamps = stamp_unit((*lefts, *rights))
    if stamps is None and not lefts.keys() & rights.keys():
        return
    if stamps is not None:
        yield _open_stamped(root, PairFiles(left=left, right=right, stamps=stamps))
        return
    times = find_times(root, left)
    try:
        yield _open(root, PairFiles(left=left, right=right, times=times))
    except VfoaError as error:
        if times is None or times not in str(error):
            raise
        raise VfoaError(f"{error} (--set left={left} --set right={right} reads the images without it)") from None


def _open_stamped(root: Path, files: PairFiles) -> FoundLayout:
    """As :func:`_open`; an error says which settings pair times that differ."""
    try:
        return _open(root, files)
    except VfoaError as error:
        names = f"--set left={files.left} --set right={files.right} --set stamps={files.stamps}"
        raise VfoaError(f"{root}: {error} ({names} --set tolerance_ms=MS)") from None


def read_layout(root: Path, files: PairFiles) -> FoundLayout:
    """Return the layout of files that the user names; raises the errors of their :meth:`PairFiles.views`."""
    if files.layout == "images" and files.stamps is None:
        files = files.model_copy(update={"stamps": stamp_unit(find_frames(root, str(files.left), "source.left"))})
    return _open(root, files)


def _packed(root: Path, name: str, first: Path) -> Iterator[FoundLayout]:
    """``name`` (a file, or a folder of images) as both views in one picture, the likelier packing first."""
    is_video = first.suffix.lower() in VIDEO_SUFFIXES
    if not is_video and (_DEPTH_WORD.search((root / name).name) or _is_map(first)):
        return  # one view's depth or disparity: its halves are alike where the floor or a wall is
    kind = "video" if is_video else "images"
    likeness: dict[FoundLayout, float] = {}
    for packing in PACKINGS:
        with suppress(VfoaError):  # an odd width, or names without a number
            layout = _open(root, PairFiles.model_validate({"layout": f"{kind}_{packing}", "both": name}))
            likeness[layout] = _likeness_of(layout.views)
    alike = [layout for layout in likeness if likeness[layout] >= ALIKE]
    yield from sorted(alike, key=lambda layout: -likeness[layout])


def _is_map(image: Path) -> bool:
    """Whether a file has one channel of more than 8 bits, as maps of depth and disparity have."""
    pixels = read_raw(image)
    return pixels.ndim == 2 and pixels.dtype != np.uint8


def _open(root: Path, files: PairFiles) -> FoundLayout:
    views = files.views(root)
    left, _ = views.read(views.frames[0])
    source = {"layout": files.layout, **files.model_dump(mode="json", exclude_defaults=True, exclude={"swap"})}
    return FoundLayout(root=root, source=source, views=views, size_px=(left.shape[1], left.shape[0]))


_SAMPLES = 5


def _likeness_of(views: StereoPairs) -> float:
    """Likeness of the first of some frames that has contrast: many films begin black."""
    frames = views.frames
    for place in dict.fromkeys(len(frames) * sample // _SAMPLES for sample in range(_SAMPLES)):
        left, right = views.read(frames[place])
        if _small(right).std() > _LEAST_CONTRAST:
            return _likeness(left, right)
    return 0.0


def _likeness(left: Image, right: Image) -> float:
    """Greatest correlation of the two over horizontal shifts up to a quarter of the width; 0 without contrast."""
    first, second = _small(left), _small(right)[:, : _WIDTH - _WIDTH // 4]
    if second.std() <= _LEAST_CONTRAST:
        return 0.0
    return float(cv2.matchTemplate(first, second, cv2.TM_CCOEFF_NORMED).max())


def _small(view: Image) -> NDArray[np.float32]:
    height = max(1, round(view.shape[0] * _WIDTH / view.shape[1]))
    gray = cv2.resize(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), (_WIDTH, height), interpolation=cv2.INTER_AREA)
    small = gray.astype(np.float32)
    # A bright sky over dark ground makes any two halves alike: remove the means of rows and columns.
    return small - small.mean(axis=1, keepdims=True) - small.mean(axis=0, keepdims=True)


_KITTI_GRAY = re.compile(r"(^|/)image_0?0(/|$)")
_RECTIFIED = re.compile("(?:(?:^|(?<!non)(?<!not)[/_. -])[Rr]ect|(?<=[a-z])Rect)(?:ified)?(?![a-z])")
"""In names of images, as in those of topics: ``rectified_left``, ``left_rect_0``, ``imageRectified``."""


def recognise_stereo(path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
    """Return every layout at a path, once for each file there that calibrates it, or without a calibration.

    Files that ``given`` names (``left`` and ``right``, or ``both`` and ``layout``) are the only layout. A ``layout`` of
    both views in one picture is that of the file at the path, or of each film or folder of images below it.

    Raises
    ------
    VfoaError
        If named files cannot be read, or images are there but no pair of them is recognised.
    """
    if path.is_file() and path.suffix.lower() not in IMAGE_SUFFIXES | VIDEO_SUFFIXES:
        return ()
    named = _named_files(given)
    root = path if path.is_dir() else path.parent
    if named is not None:
        layouts: tuple[FoundLayout, ...] = (read_layout(root, named),)
    elif str(given.get("layout")).endswith(PACKINGS):
        files = _packed_files(path, str(given["layout"]).startswith("video"))
        layouts = tuple(read_layout(root, _view_files({**given, "both": both})) for both in files)
    else:
        layouts = find_layouts(path)
    if not layouts:
        _refuse_unpaired(path)
    return tuple(reading for layout in layouts for reading in _calibrated(layout, path, given))


def _named_files(given: Mapping[str, Any]) -> PairFiles | None:
    """The user's settings of the views, if they are sufficient to read them."""
    if not ({"left", "right"} <= given.keys() or {"layout", "both"} <= given.keys()):
        return None
    is_video = "layout" not in given and Path(str(given["left"])).suffix.lower() in VIDEO_SUFFIXES
    return _view_files({**given, "layout": "videos"} if is_video else given)


def _view_files(given: Mapping[str, Any]) -> PairFiles:
    keys = ("layout", "left", "right", "both", "stamps", "tolerance_ms", "right_offset")
    return parse(PairFiles, {key: given[key] for key in keys if key in given}, "--set")


def _packed_files(path: Path, is_video: bool) -> list[str]:
    """The files that may hold both views, as a manifest names them: films, or folders of images."""
    if path.is_file():
        return [path.name]
    if is_video:
        return [film for films in _files_by_folder(path, VIDEO_SUFFIXES).values() for film in films]
    return list(_files_by_folder(path, IMAGE_SUFFIXES))


def _refuse_unpaired(path: Path) -> None:
    """Say how to name the views of images, or of films if there are no images."""
    folders = _files_by_folder(path, IMAGE_SUFFIXES) if path.is_dir() else {}
    for left, right in islice(_sides_by_name(path, folders), 1):
        try:
            find_sides(path, left, right)
        except VfoaError as error:
            raise VfoaError(f"{path}: {error} (files are named by --set left=FILES --set right=FILES)") from None
    files = folders.values() if path.is_dir() else [[path.name]]
    is_film = path.is_file() and path.suffix.lower() in VIDEO_SUFFIXES
    if films := [] if any(files) and not is_film else _packed_files(path, is_video=True):
        raise VfoaError(
            f"{path}: no two views are seen in {listed(films, 4)}; expected --set layout=video_side_by_side (or "
            "video_top_bottom) where one film has both, or two films: --set left=LEFT.mp4 --set right=RIGHT.mp4 of "
            "their folder; of a film of one camera, OpenFace's table or a folder with people.csv is a clip by itself "
            "(docs/sources.md, Measurements without images)"
        )
    if images := [name for names in files for name in names]:
        raise VfoaError(
            f"{path}: no two views are seen in the names of {counted(len(images), 'image')} ({listed(images, 1)}); "
            "expected --set left=FILES --set right=FILES (a folder, a file, a glob or a pattern such as left_%04d.png; "
            "in the manifest: left = and right = in [source]), or --set layout=images_side_by_side (or "
            "images_top_bottom) where one image has both, or --set colour=FILES --set depth=FILES of measured depth"
        )


def _is_called_rectified(layout: FoundLayout) -> bool:
    """Whether the names of both views say that they are rectified."""
    names = [layout.source.get(side) for side in ("left", "right")]
    return all(name is not None and _RECTIFIED.search(f"{layout.root.name}/{name}") for name in names)


def _calibrated(layout: FoundLayout, path: Path, given: Mapping[str, Any]) -> list[Recognised]:
    """The layout with each calibration for images of this size, at most two folders below or one above."""
    gray = bool(_KITTI_GRAY.search(layout.source.get("left", "")))
    is_rectified = "rectified" not in given and _is_called_rectified(layout)
    settings = {key: given[key] for key in Options.model_fields if key in given}
    settings |= {"rectified": True} if is_rectified else {}
    options = parse(Options, {"calibration_cameras": (0, 1), **settings} if gray else settings, "--set")
    calibrations, incomplete = list[tuple[str, ...]](), list[str]()
    if "calibration" not in given and "camera" not in given:
        calibrations, incomplete = find_calibrations(layout.root, lambda: layout.size_px, options)

    def recognised(files: tuple[str, ...]) -> Recognised:
        source: dict[str, Any] = {**layout.source}
        if files:
            source["calibration"] = files[0] if len(files) == 1 else list(files)
            source |= {"calibration_cameras": [0, 1]} if gray and files[0].endswith(".txt") else {}
        if is_rectified and "camera" not in given:
            source["rectified"] = True
        return Recognised(
            root=layout.root,
            source=source,
            layout=f"{layout}{', rectified by their names' if 'rectified' in source else ''}",
            name=path.stem if path.is_file() else path.name,
            calibration=" and ".join(files) or None,
            # A file that cannot be used alone is reported only if no other can.
            incomplete=() if calibrations else tuple(dict.fromkeys(incomplete)),
        )

    return [recognised(files) for files in calibrations or [()]]
