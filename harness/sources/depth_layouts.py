"""Files of ``depth_folder``: joined to frames by number or by listed times, and the layouts that fit a path.

Lists are TUM RGB-D's: ``timestamp filename``, in seconds. ``associations.txt``, which TUM's ``associate.py`` writes,
has both images of a frame in a line::

    1305031102.175304 rgb/1305031102.175304.png 1305031102.160407 depth/1305031102.160407.png
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from harness.files.io import read_text
from harness.sources import Recognised
from harness.sources.calibration_files.depth_unit import counts_per_metre
from harness.sources.calibration_files.documents import SUFFIXES
from harness.sources.calibration_files.one_camera import read_one_camera
from harness.sources.media.frame_files import DIGITS, IMAGE_SUFFIXES, find_frames, folders_by_number, walk_files
from harness.sources.media.frame_times import TICKS_NS, StampUnit, join_times, numbered_apart, stamp_unit, times_beside
from harness.sources.media.images import read_rgb
from harness.sources.media.listed_times import find_times, read_times
from harness.sources.media.maps import DEPTH_SUFFIXES, read_depth_file
from harness.sources.recordings.settings import DEPTH_TOLERANCE_MS
from vfoa.errors import VfoaError, counted

Found = TypeVar("Found")


def read_stamped_list(path: Path) -> dict[int, Path]:
    """Files by their time in ns, ascending; lines that begin with ``#`` are left out.

    Raises
    ------
    VfoaError
        If a line is of another form, or a time occurs twice.
    """
    rows = _by_time(path, "a time in seconds and a file", lambda cells: (cells[0], path.parent / " ".join(cells[1:])))
    return dict(rows)


def read_associations(path: Path) -> tuple[dict[int, Path], dict[int, Path]]:
    """The colour image and the depth map of each line, both by the time of the colour image in ns, ascending.

    A line is a frame, however far apart its times are: whoever wrote it knows what belongs together. What follows
    in a line, such as a pose, is left out. Raises as :func:`read_stamped_list`.
    """

    def images(cells: list[str]) -> tuple[str, tuple[Path, Path]]:
        pairs = cells[:2], cells[2:4]  # ICL-NUIM has depth first
        for time, _ in pairs:
            Decimal(time)  # a file would have been cut at a blank
        depth, colour = sorted(pairs, key=lambda pair: _likeness_to_colour(pair[1].lower()))
        return colour[0], (path.parent / colour[1], path.parent / depth[1])

    rows = _by_time(path, "a time in seconds and a file, twice", images)
    return {time_ns: colour for time_ns, (colour, _) in rows}, {time_ns: depth for time_ns, (_, depth) in rows}


def _by_time(path: Path, expected: str, read: Callable[[list[str]], tuple[str, Found]]) -> list[tuple[int, Found]]:
    """What is read of the cells of each line, beside its time in ns, ascending."""
    rows: dict[int, Found] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        cells = line.split()
        if not cells or cells[0].startswith("#"):
            continue
        try:
            time, found = read(cells)
            stamp_ns = round(Decimal(time) * 10**9)
            if len(cells) == 1:
                raise ValueError
        except (InvalidOperation, ValueError, OverflowError, IndexError):
            raise VfoaError(f"{path}:{number}: found {line.strip()!r}; expected {expected}") from None
        if stamp_ns in rows:
            raise VfoaError(f"{path}:{number}: the time {time} occurs twice")
        rows[stamp_ns] = found
    if not rows:
        raise VfoaError(f"{path}: no images; expected lines of {expected}")
    return sorted(rows.items(), key=lambda row: row[0])


def _likeness_to_colour(path: str) -> int:
    return ("rgb" in path) - ("depth" in path)


def _has_frame_numbers(path: Path) -> bool:
    """Whether a list has whole numbers in place of times that are too small for seconds since 1970."""
    lines = (line.strip() for line in read_text(path).splitlines())
    return all(re.match(r"\d{1,9}\s", line) for line in lines if line and not line.startswith("#"))


class DepthFrames(NamedTuple):
    """The files of each frame, ascending by number; its time in ns if it is known; notes on files without a frame."""

    colours: dict[int, Path]
    depths: dict[int, Path]
    times_ns: dict[int, int] | None
    notes: tuple[str, ...]


def find_depth_frames(
    folder: Path,
    colour: str,
    depth: str,
    tolerance_ms: float,
    stamps: StampUnit | None = None,
    times: str | None = None,
) -> DepthFrames:
    """Return the frames of two patterns of files (``rgb/*.png``), or of two lists of files with times (``rgb.txt``).

    Frames of lists are numbered from 1 by the colour images' times, at most ``tolerance_ms`` from the depth's. In one
    list of both (``associations.txt``), each line is a frame. Lists may have the frames' numbers in place of times, as
    ICL-NUIM's do.
    ``stamps``: so far apart, too, may the numbers in names be, which are times in this unit. ``times``: a file with the
    time of each colour image.

    Raises
    ------
    VfoaError
        If no frame has both, or the times are not those of the colour images.
    """
    if colour.endswith(".txt") != depth.endswith(".txt"):
        raise VfoaError(f"{folder}: colour {colour!r} and depth {depth!r}: expected two lists (.txt), or none")
    colours: Mapping[int, Path]
    depths: Mapping[int, Path]
    tick_ns = 1 if stamps is None else TICKS_NS[stamps]
    if is_listed := colour.endswith(".txt"):
        if colour == depth:
            colours, depths = read_associations(folder / colour)
        else:
            colours, depths = map(read_stamped_list, (folder / colour, folder / depth))
        if _has_frame_numbers(folder / colour) and _has_frame_numbers(folder / depth):
            is_listed, colours, depths = False, *({t // 10**9: each[t] for t in each} for each in (colours, depths))
    else:
        colours = find_frames(folder, colour, str(folder))
        depths = find_frames(folder, depth, str(folder), DEPTH_SUFFIXES)
    if has_times := is_listed or stamps is not None:
        own, others = list(colours), list(depths)
        pairs = [(own[i], others[j]) for i, j in join_times(own, others, round(tolerance_ms * 1e6 / tick_ns))]
        rule = f"within {tolerance_ms:g} ms (tolerance_ms)"
    else:
        pairs = [(number, number) for number in sorted(colours.keys() & depths.keys())]
        rule = "of the same number"
    if not pairs:
        raise VfoaError(f"{folder}: no image of {colour!r} has a partner in {depth!r} {rule}")
    numbered = dict(enumerate(pairs, start=1)) if is_listed else {pair[0]: pair for pair in pairs}
    shifted: tuple[str, ...] = ()
    if not has_times and numbered_apart(colours, depths):
        shifted = (
            f"{colour} has {len(colours)} images from {min(colours)}, {depth} {len(depths)} from {min(depths)}, joined "
            "by number: if the first ones belong together, number them alike (ffmpeg -start_number)",
        )
    times_ns = {key: key * tick_ns for key in colours} if has_times else times_beside(colours)
    if times is not None:
        times_ns = read_times(folder / times, colours)
    return DepthFrames(
        {number: colours[key] for number, (key, _) in numbered.items()},
        {number: depths[key] for number, (_, key) in numbered.items()},
        None if times_ns is None else {number: times_ns[key] for number, (key, _) in numbered.items()},
        tuple(
            f"{name}: {len(files) - len(pairs)} of {len(files)} images have no partner {rule}"
            for name, files in ((colour, colours), (depth, depths))
            if len(files) > len(pairs)
        )
        + shifted,
    )


_COLOUR_WORDS = ("rgb", "color", "colour", "image", "img", "left")
_CALIBRATIONS = re.compile(
    r"(?:(?:camera|cam|color|colour|rgb|realsense)[_-]?)?(?:intrinsics?|info|calib|calibration)|camera|k|ost|"
    r"(?:camera|cam)[_-]?(?:k|matrix|params?|parameters)",
    re.IGNORECASE,
)
"""The name, without its suffix, of one camera's calibration in Open3D, ROS, OpenCV and data sets."""
_CALIBRATION_SUFFIXES = frozenset({*SUFFIXES, ".txt", ".ini"})

TUM_SCALE = 5000.0
"""Counts per metre in TUM RGB-D; Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012."""

_TUM_LISTS = (("rgb.txt", "depth.txt"), *((name, name) for name in ("associations.txt", "associate.txt")))
"""Colour and depth: the data set's lists, or the one that its ``associate.py`` makes of them."""

_TUM_CAMERAS = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3),
    "freiburg2": (520.9, 521.0, 325.1, 249.7),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
}
"""fx, fy, cx, cy as TUM publishes them; the small lens distortion of the first two cameras is left out."""


_JOINING = frozenset({"stamps", "tolerance_ms"})
"""Settings on which it depends which colour and depth are a frame."""


def recognise_depth(path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
    """Return every way to read a folder as colour with depth; none for anything else.

    Files that ``given`` names as ``colour`` and ``depth`` are the only way. A file of times beside the images is left
    out if the rate is given, or that the numbers in names are times.

    Raises
    ------
    VfoaError
        If named files cannot be read, there are files called depth beside those of colour and no depth can be read from
        them, or a file of times beside them is not theirs.
    """
    if not path.is_dir():
        return ()
    for lists in _TUM_LISTS:
        has_lists = all((path / name).is_file() for name in lists)
        if has_lists and lists == (given.get("colour", lists[0]), given.get("depth", lists[1])):
            return (_recognised(path, {"colour": lists[0], "depth": lists[1], "depth_scale": TUM_SCALE}),)
    has_times = bool(given.keys() & {"rate_hz", "stamps", "times"})
    if given.keys() >= {"colour", "depth"}:
        named = {key: str(given[key]) for key in ("colour", "depth")}
        has_times |= named["colour"].endswith(".txt")
        stamps = {} if has_times else _stamps(path, named["colour"], named["depth"])
        reading = _recognised(path, {**named, **stamps, **{key: given[key] for key in _JOINING & given.keys()}})
        return (reading if has_times else _with_times(reading),)
    readings, faults = [], []
    for depth, first, colours in _depths(path):
        try:
            read_depth_file(first, None)
        except VfoaError as fault:
            faults.append(fault)
            continue
        for colour in colours:
            source = {"colour": colour, "depth": depth, **_stamps(path, colour, depth)}
            source |= {key: given[key] for key in _JOINING & given.keys()}
            with suppress(VfoaError):  # no partners
                readings.append(_recognised(path, source))
    if faults and not readings:
        raise faults[0]
    return tuple(readings if has_times else map(_with_times, readings))


def _with_times(reading: Recognised) -> Recognised:
    """The reading with the file of times beside its colour images, if there is one and their names have none."""
    colour = reading.source["colour"]
    times = None if "stamps" in reading.source else find_times(reading.root, colour)
    if times is None:
        return reading
    try:
        read_times(reading.root / times, find_frames(reading.root, colour, str(reading.root)))
    except VfoaError as error:
        raise VfoaError(f"{error} (--set rate_hz=RATE reads the images without it)") from None
    return replace(reading, source={**reading.source, "times": times})


def _stamps(path: Path, colour: str, depth: str) -> dict[str, StampUnit]:
    """The setting ``stamps``, if the numbers in the names are times."""
    both = find_frames(path, colour, str(path)), find_frames(path, depth, str(path), DEPTH_SUFFIXES)
    unit = stamp_unit(number for numbers in both for number in numbers)
    return {} if unit is None else {"stamps": unit}


def _recognised(path: Path, source: dict[str, Any]) -> Recognised:
    """The reading of these files, with a calibration beside them or, for TUM's cameras, the published one."""
    tolerance_ms = source.get("tolerance_ms", DEPTH_TOLERANCE_MS)
    found = find_depth_frames(path, source["colour"], source["depth"], tolerance_ms, source.get("stamps"))
    colours = found.colours
    calibration, incomplete = None, list[str]()
    for file in _calibrations(path):
        try:
            height, width = read_rgb(next(iter(colours.values()))).shape[:2]
            read_one_camera(file, (width, height))
            source["calibration"] = calibration = file.name
            if counts_per_metre(file) is not None:  # not TUM's unit
                source.pop("depth_scale", None)
            break
        except VfoaError as error:
            incomplete.append(str(error))
    known = next((name for name in _TUM_CAMERAS if name in path.name.lower() and "depth_scale" in source), None)
    if calibration is None and known is not None:
        source["camera"] = dict(zip(("fx_px", "fy_px", "cx_px", "cy_px"), _TUM_CAMERAS[known], strict=True))
        calibration = f"as published for {known}, without its lens distortion"
    scale = f", {source['depth_scale']:g} counts a metre (TUM RGB-D)" if "depth_scale" in source else ""
    layout = f"colour {source['colour']!r} and depth {source['depth']!r}: {counted(len(colours), 'frame')}{scale}"
    return Recognised(
        root=path,
        source=source,
        layout=layout,
        name=path.name,
        calibration=calibration,
        incomplete=() if calibration else tuple(incomplete),
    )


def _calibrations(folder: Path) -> list[Path]:
    """The files beside the images that are named as the calibration of one camera."""
    return sorted(
        entry
        for entry in folder.iterdir()
        if entry.suffix.lower() in _CALIBRATION_SUFFIXES and _CALIBRATIONS.fullmatch(entry.stem) and entry.is_file()
    )


def _depths(path: Path) -> Iterator[tuple[str, Path, list[str]]]:
    """Yield globs of files of depth, with their first file and the globs that differ by a word for colour instead."""
    patterns = _patterns(path)
    depths = {pattern: first for pattern, first in patterns.items() if "depth" in pattern.lower()}
    for depth, first in depths.items():
        if colours := [each for each in patterns if each not in depths and _is_colour_of(each, depth)]:
            yield depth, first, colours


def _patterns(root: Path) -> dict[str, Path]:
    """Patterns, with ``*`` for runs of digits in names, of the files under the root, each with its first file."""
    patterns: dict[str, Path] = {}
    by_folder = {folder: names for folder, names in walk_files(root, IMAGE_SUFFIXES | DEPTH_SUFFIXES) if names}
    of_frames = _folders_of_frames(by_folder)
    for folder, names in by_folder.items():
        for name in map(Path, names):
            pattern = re.sub(r"\d+(?:\.\d+)?(?=\D*$)|\d+", "*", name.stem) + name.suffix
            patterns.setdefault((of_frames.get(folder, folder) / pattern).as_posix(), root / folder / name)
    return {_of_digits_alone(pattern, patterns): first for pattern, first in patterns.items()}


def _folders_of_frames(by_folder: Mapping[Path, list[str]]) -> dict[Path, Path]:
    """The folders of single frames, by what they are called but for one number: each has the same files, and a depth.

    ``frame_0001/color.png`` and ``frame_0001/depth.png`` are in ``frame_%d``.
    """
    by_number = folders_by_number(folder.as_posix() for folder in by_folder)
    return {
        folder: Path(pattern)
        for pattern, names in by_number.items()
        if len(names) > 1 and len({tuple(by_folder[Path(name)]) for name in names}) == 1
        for folder in map(Path, names)
        if not any(DIGITS.search(name) for name in by_folder[folder])
        if sum("depth" in name.lower() for name in by_folder[folder]) == 1
    }


def _of_digits_alone(pattern: str, others: Iterable[str]) -> str:
    """The glob, as a printf pattern if it also fits other files: ``depth_*`` fits ``depth_colormap_0``."""
    fits_others = any(other != pattern and fnmatchcase(other.replace("*", "0"), pattern) for other in others)
    return pattern.replace("*", "%d") if fits_others and pattern.count("*") == 1 else pattern


def _is_colour_of(colour: str, depth: str) -> bool:
    """Whether two patterns differ only by the word depth in one, and a word for colour or nothing in the other."""
    if Path(colour).suffix.lower() not in IMAGE_SUFFIXES:
        return False
    folders = [Path(pattern).parent.as_posix().lower() for pattern in (colour, depth)]
    in_folders, in_names = "depth" in folders[1], "depth" in Path(depth).name.lower()
    if in_folders and Path(folders[0]).parent != Path(folders[1]).parent and not in_names:
        return False
    if not in_folders and folders[0] != folders[1]:
        return False
    name = folders[0] if in_folders else Path(colour).name.lower()
    return any(word in name for word in _COLOUR_WORDS)
