"""Files of frames by their names: the digits are the number or the time, words the side."""

from __future__ import annotations

import glob
import math
import os
import re
from array import array
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np

from harness.files.ascending import place_in
from harness.files.groups import grouped
from harness.sources.media import yarp
from harness.sources.media.dated_names import counts_by_one, find_dates
from vfoa.errors import VfoaError

Value = TypeVar("Value")

DIGITS = re.compile(r"\d+")
"""A number in a name."""
_PRINTF = re.compile(r"%0?(\d*)d")
_LARGEST = 2**63 - 1
DEPTH = 3
"""Levels of folders below a path that are searched: ``mav0/cam0/data``."""
IMAGE_SUFFIXES = frozenset(
    {
        *(".png", ".jpg", ".jpeg", ".jpe", ".jfif", ".bmp", ".tif", ".tiff", ".webp", ".avif", ".jp2"),
        *(".ppm", ".pgm", ".pnm"),
    }
)


class FolderFiles(Mapping[int, Path]):
    """Files of one folder by frame number, ascending. They are kept in arrays: an hour of video has 90,000."""

    def __init__(self, folder: Path, names: Mapping[int, str]) -> None:
        self._folder, self._numbers = folder, array("q", names)
        self._names = np.array([os.fsencode(name) for name in names.values()])

    def __getitem__(self, number: int) -> Path:
        return self._folder / os.fsdecode(self._names[self.place(number)])

    def place(self, number: int) -> int:
        """The place of a frame in their order; raises a :class:`KeyError` if there is no such frame."""
        if (place := place_in(self._numbers, number)) is None:
            raise KeyError(number)
        return place

    def __iter__(self) -> Iterator[int]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)


def walk_files(root: Path, suffixes: frozenset[str] | None) -> Iterator[tuple[Path, list[str]]]:
    """Yield each folder at most three levels below ``root``, relative to it, and the names of its files, sorted.

    ``suffixes`` are those of the files to list, None is any. Hidden files are left out, and two kinds that are no
    frames: Middlebury's pictures under other lights (``ambient``), and the preview that ``vfoa calibrate`` writes
    beside its ``stereo.yml``.
    """
    for folder, subfolders, files in os.walk(root):
        relative = Path(folder).relative_to(root)
        no_frames = {"ambient"} if "calib.txt" in files else set()
        previews = {Path(name).stem + ".png" for name in files if name.endswith(".yml")} & {*files}
        no_frames |= previews if len(previews) == 1 else set()  # of more, each image has a file of its own
        names = [name for name in sorted(files) if suffixes is None or Path(name).suffix.lower() in suffixes]
        yield relative, [name for name in names if not name.startswith(".") and name not in no_frames]
        is_deep = len(relative.parts) >= DEPTH
        subfolders[:] = sorted(n for n in subfolders if not (is_deep or n.startswith(".") or n in no_frames))


def find_frames(root: Path, pattern: str, where: str, suffixes: frozenset[str] = IMAGE_SUFFIXES) -> Mapping[int, Path]:
    """Return the files under ``root`` by frame number, ascending.

    ``pattern`` is a folder (all its files with these ``suffixes``), a file, a glob (``left/*.png``), or has one printf
    field for the number (``left/%06d.png``, ``left/%06d_*.png``). Without a field, the number is the run of digits that
    differs between the names, or the index beside a time stamp; a single file without digits is frame 0. Hidden files,
    such as macOS's ``._left_01.png``, are left out. YARP's ``data.log`` has the images beside it, by their time in ns.
    ``where`` (file and key) starts the messages.

    Raises
    ------
    VfoaError
        If nothing is found, or a name's number is missing, ambiguous, repeated or of more than 63 bits.
    """
    folder = root / pattern
    if folder.is_dir():
        return _folder_frames(folder, pattern, where, suffixes)
    if folder.is_file():
        if folder.name == yarp.LOG:
            return yarp.read_log(folder)
        files = [folder]
    elif _PRINTF.search(pattern):
        return _printf_frames(root, pattern, where)
    else:
        files = _glob(root, pattern)
    if not files:
        expected = f"a folder of images, a glob or a pattern such as left/%06d.png under {root}"
        raise VfoaError(f"{where}: {pattern!r} matches no file; expected {expected}")
    by_name = {path.name: path for path in files}
    if len(by_name) != len(files):
        raise VfoaError(f"{where}: {pattern!r} matches files of the same name in several folders; expected one folder")
    numbers = number_names(by_name, f"{where}: {pattern!r}", pattern.rpartition("/")[0])
    return {number: by_name[name] for number, name in numbers.items()}


def number_names(names: Iterable[str], where: str, folder: str = "") -> dict[int, str]:
    """File names by frame number, ascending: the number is the one run of digits that differs between them.

    Of an index and a time stamp that both differ, it is the index. Seconds since 1970 and their decimals are one
    number, and so are a date and its time of day: ms since 1970, or us or ns. The ``folder`` is that of patterns in
    messages.
    """
    names = sorted(names)
    runs = {name: DIGITS.findall(os.path.splitext(name)[0]) for name in names}
    if twice := [name for name, other in pairwise(names) if name == other]:
        raise VfoaError(f"{where}: {twice[0]!r} occurs twice; expected one image of each name")
    if len(names) == 1:
        return _unique([(int((runs[names[0]] or [0])[-1]), names[0])], where)
    first, words = names[0], {name: DIGITS.sub("0", os.path.splitext(name)[0]).casefold() for name in names}
    if odd := [name for name in names if words[name] != words[first] or not runs[name]]:
        raise VfoaError(
            f"{where}: {first!r} and {odd[0]!r} do not share one numbering; "
            "expected the images of one clip, whose names differ in a frame number, or a pattern with %d for it"
        )
    columns = list(zip(*runs.values(), strict=True))
    dates = find_dates([os.path.splitext(name)[0] for name in names])
    if dates is None:
        numbers = _numbers_of(with_decimals(first, columns))
    else:
        beside = [column for place, column in _varying(columns).items() if place not in dates.runs]
        numbers = _numbers_of([list(map(str, dates.times)), *beside])
    if numbers is None:
        varying = _varying(columns)
        raise VfoaError(
            f"{where}: {len(varying)} numbers differ between {first!r} and {names[-1]!r}; expected one, or "
            f"{_expected_pattern(folder, first, varying)}"
        )
    return _unique(zip(numbers, names, strict=True), where)


def count_from_1(numbers: Collection[int], frames: Sequence[int]) -> bool:
    """Whether the numbers of images count from 1, where a clip's ``frames`` count from 0.

    ffmpeg counts the pictures of a film from 1, a clip of it from 0: they end with the number after the last frame's.
    """
    return bool(numbers) and counts_from_0(frames) and min(numbers) > 0 and max(numbers) == len(frames)


def counts_from_0(frames: Sequence[int]) -> bool:
    """Whether a clip's frames are 0, 1, 2 and so on."""
    return bool(frames) and frames[0] == 0 and frames[-1] == len(frames) - 1


_SECONDS, _MILLISECONDS = re.compile(r"1\d{9}"), re.compile(r"1\d{12}")
_CLOCKDIGITS, _LEAST_STEP_S = (6, 9), 1e-4
"""Numbers of decimals of a clock in us or ns, and the least step of frames, seconds."""
_STAMPDIGITS = 9
"""Least digits of a time stamp; today's have 10 in seconds."""
_FEWERDIGITS = 3
"""By how many digits an index is shorter than a stamp beside it."""


def _varying(columns: Sequence[Sequence[str]]) -> dict[int, Sequence[str]]:
    """The numbers that differ between names, by their place."""
    return {place: column for place, column in enumerate(columns) if len(set(map(int, column))) > 1}


def with_decimals(name: str, columns: Sequence[Sequence[str]]) -> list[Sequence[str]]:
    """The numbers that differ between names such as this one; seconds with decimals become ms, us or ns, and ms ns.

    Such are ``1718000000.123456``, ``1718000000_123456789`` and ``1718000000123.45678``, also where all have the same
    decimals or the same seconds, and ``12.300000`` of a simulation, if these are not an index. Those of several lengths
    stay apart: it is not known what they count.
    """
    spans, varying = [match.span() for match in DIGITS.finditer(name)], _varying(columns)

    def has_decimals(place: int) -> bool:
        after = columns[place + 1]
        if len({*map(len, after)}) != 1 or (place not in varying and counts_by_one(after)):
            return False
        digits, between = len(after[0]), name[spans[place][1] : spans[place + 1][0]]
        if all(map(_MILLISECONDS.fullmatch, columns[place])):
            return between == "."
        if all(map(_SECONDS.fullmatch, columns[place])):
            return between in {*("._-" if digits == 9 else "." if digits < 9 else "")}
        return between == "." and digits in _CLOCKDIGITS and _is_clock(columns[place], after)

    def joined(place: int) -> list[str]:
        is_ms = _MILLISECONDS.fullmatch(columns[place][0])
        width = 6 if is_ms else math.ceil(len(columns[place + 1][0]) / 3) * 3
        both = zip(columns[place], columns[place + 1], strict=True)
        return [whole + decimals[:width].ljust(width, "0") for whole, decimals in both]

    pairs = (place for place in range(len(columns) - 1) if {place, place + 1} & varying.keys())
    seconds = {place for place in pairs if has_decimals(place)}
    decimals = {place + 1 for place in seconds}
    return [
        joined(place) if place in seconds else column
        for place, column in enumerate(columns)
        if place not in decimals and place in seconds | varying.keys()
    ]


def _is_clock(seconds: Iterable[str], decimals: Iterable[str]) -> bool:
    """Whether numbers and their decimals are times, and not a take and the index of a frame, which counts by one."""
    times_s = sorted(float(f"{whole}.{part}") for whole, part in zip(seconds, decimals, strict=True))
    return float(np.median(np.diff(times_s))) >= _LEAST_STEP_S


def _numbers_of(columns: Sequence[Sequence[str]]) -> list[int] | None:
    """The frames' numbers, of the numbers that differ between names; None if it is not known which they are."""
    if not columns:
        return None
    index, *others = sorted(columns, key=lambda column: max(map(len, column)))
    numbers = list(map(int, index))
    least = max(_STAMPDIGITS, max(map(len, index)) + _FEWERDIGITS)
    if others and len(set(numbers)) < len(numbers):
        return None
    if any(len(digits) < least for column in others for digits in column):
        return None
    in_order = sorted(range(len(numbers)), key=numbers.__getitem__)
    for column in others:
        stamps = [int(column[place]) for place in in_order]
        if stamps != sorted(stamps):
            return None  # decimals of the seconds beside them
    return numbers


def _expected_pattern(folder: str, name: str, varying: Mapping[int, Sequence[str]]) -> str:
    """A pattern for names such as this one by the first number that counts through all of them, if one does."""
    rows = sorted({tuple(map(int, row)) for row in zip(*varying.values(), strict=True)})
    columns = zip(varying, zip(*rows, strict=True), strict=True)
    frame = next((place for place, column in columns if [*column] == sorted(set(column))), None)
    if frame is None:
        return "files renamed by frame (000001.png), as none of these numbers counts through all names"
    matches = list(DIGITS.finditer(os.path.splitext(name)[0]))
    for place in reversed(list(varying)):
        field = "%d" if place == frame else "*"
        name = name[: matches[place].start()] + field + name[matches[place].end() :]
    return f"a pattern with %d for the frame number and * for the others, such as {os.path.join(folder, name)}"


def printf_name(pattern: str, number: int) -> str:
    """Return the name of one frame's file: the pattern with its printf field filled in."""
    return _PRINTF.sub(lambda match: str(number).zfill(int(match[1] or 0)), pattern, count=1)


def check_printf(pattern: str, where: str) -> None:
    """Reject a pattern without exactly one field for the frame number."""
    if len(_PRINTF.findall(pattern)) != 1:
        raise VfoaError(f"{where}: {pattern!r}; expected one field for the frame number, such as frame_%04d.png")


def _folder_frames(folder: Path, pattern: str, where: str, suffixes: frozenset[str]) -> FolderFiles:
    ends = tuple(sorted(suffixes))
    names = [name for name in os.listdir(folder) if name.lower().endswith(ends) and not name.startswith(".")]
    if not names:
        raise VfoaError(f"{where}: {pattern!r} matches no file; expected files {', '.join(ends)} in {folder}")
    return FolderFiles(folder, number_names(names, f"{where}: {pattern!r}", pattern))


def _printf_frames(root: Path, pattern: str, where: str) -> dict[int, Path]:
    check_printf(pattern, where)
    before, _, after = _PRINTF.split(pattern)
    named = re.compile(_wildcards(re.escape, before) + r"(\d+)" + _wildcards(re.escape, after))
    anywhere = f"{_wildcards(glob.escape, before, '*')}*{_wildcards(glob.escape, after, '*')}"
    files = _glob(root, re.sub(r"\*+", "*", anywhere))  # ** would be folders of any depth
    matches = [(named.fullmatch(path.relative_to(root).as_posix()), path) for path in files]
    numbered = [(int(match[1]), path) for match, path in matches if match]
    if not numbered:
        raise VfoaError(f"{where}: {pattern!r} matches no file under {root}")
    return _unique(numbered, where)


def _wildcards(escape: Callable[[str], str], text: str, anything: str = "[^/]*?") -> str:
    """The text in another pattern language, each ``*`` as ``anything``."""
    return anything.join(map(escape, text.split("*")))


def _glob(root: Path, pattern: str) -> list[Path]:
    try:
        return sorted(path for path in root.glob(pattern) if path.is_file() and not path.name.startswith("."))
    except (ValueError, NotImplementedError):  # an empty pattern, or an absolute one
        return []


def _unique(pairs: Iterable[tuple[int, Value]], where: str) -> dict[int, Value]:
    by_number: dict[int, Value] = {}
    for number, value in pairs:
        if number in by_number:
            raise VfoaError(f"{where}: frame {number} occurs twice: {by_number[number]} and {value}")
        if number > _LARGEST:
            raise VfoaError(f"{where}: {value}: the frame number {number} is too large; expected at most {_LARGEST}")
        by_number[number] = value
    return dict(sorted(by_number.items()))


_WORD = re.compile(r"left|right", re.IGNORECASE)
_LETTER = re.compile(r"(?<![A-Za-z])[lr](?![A-Za-z])", re.IGNORECASE)
_SUFFIX = re.compile(r"(?<=[a-z0-9])[LR](?![A-Za-z])")
_CAMERA = re.compile(
    r"(?<![A-Za-z])(?:(?:camera|cam|image|img|im|i|infra|view|sensor|video)[_-]?|infrared )(\d{1,2})(?!\d)",
    re.IGNORECASE,
)
_WAYS = (("word", _WORD, 0), ("letter", _LETTER, 0), ("letter", _SUFFIX, 0), ("camera", _CAMERA, 1))
_NUMBERED_VIEW = re.compile(r"(im|view)(\d+)(\.[^.]+)")

_NUMBERED_VIEWS = (("im", (0, 1), 1), ("im", (2, 6), 8), ("view", (1, 5), 6))
"""Middlebury's pairs: the word, the numbers of left and right, and the greatest number beside them."""


def folders_by_number(folders: Iterable[str]) -> dict[str, list[str]]:
    """Folders that are called alike but for their only number, by the pattern of all (``frame_%d``)."""
    return grouped(
        (DIGITS.sub("%d", folder), folder)
        for folder in folders
        if len(DIGITS.findall(folder)) == 1 and "%" not in folder
    )


def pair_names(names: Iterable[str], *, numbered: bool) -> tuple[tuple[str, str], ...]:
    """Return every way to find two sides in names (of files, or paths of folders), most pairs first: (left, right).

    ``numbered``: runs of digits beside the side may differ within a side (frame numbers), and the two are globs with
    ``*`` for them. Cameras are paired as (0, 1), (2, 3), or as (1, 2) if there is no 0.
    """
    ways: defaultdict[tuple[str, str, str], defaultdict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for name in sorted(names):
        for way, pattern, group in _WAYS:
            for match in pattern.finditer(name):
                before, after = name[: match.start(group)], name[match.end(group) :]
                if numbered:
                    before, after = (DIGITS.sub("*", glob.escape(part)) for part in (before, after))
                if way == "camera" and numbered and "*" not in before + after:
                    continue  # image_1, image_2 ...: a sequence, not a pair of cameras
                ways[way, before, after][match[group]].add(name)
    pairs = [
        (min(len(sides[side]), len(sides[other])), f"{before}{side}{after}", f"{before}{other}{after}")
        for (way, before, after), sides in ways.items()
        for side in sorted(sides)
        if (other := _opposite(way, side, sides)) in sides
    ]
    return tuple((left, right) for _, left, right in sorted(pairs, key=lambda pair: -pair[0]))


def numbered_views(names: Iterable[str]) -> tuple[tuple[str, str], ...]:
    """Middlebury's pairs among the files of one folder: im0 and im1, im2 and im6, view1 and view5.

    A folder that also holds the word with a greater number is a sequence.
    """
    by_word: defaultdict[tuple[str, str], dict[int, str]] = defaultdict(dict)
    for name in names:
        if match := _NUMBERED_VIEW.fullmatch(name):
            by_word[match[1], match[3]][int(match[2])] = name
    return tuple(
        (files[left], files[right])
        for (word, _), files in by_word.items()
        for listed_word, (left, right), last in _NUMBERED_VIEWS
        if word == listed_word and {left, right} <= files.keys() and max(files) <= last
    )


def _opposite(way: str, side: str, sides: Mapping[str, set[str]]) -> str:
    """The right side's word for a left side's, none for a right side."""
    if way == "camera":
        number = int(side)
        is_left = number % 2 == 0 or f"{number - 1:0{len(side)}d}" not in sides
        return f"{number + 1:0{len(side)}d}" if is_left else ""
    words = {"left": "right", "Left": "Right", "LEFT": "RIGHT", "l": "r", "L": "R"}
    opposite = words.get(side, "")
    if opposite in sides:
        return opposite
    return next((other for other in sides if other.lower() == opposite.lower()), opposite)  # stereoLeft, stereoright
