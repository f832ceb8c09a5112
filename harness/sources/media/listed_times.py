"""The times of images in a file beside them: a line for each, or a column of a table."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

import numpy as np

from harness.files.dialects import check_width, plain_name, table_rows, table_text
from harness.sources.media.frame_files import IMAGE_SUFFIXES
from harness.sources.media.frame_times import DATE, SINCE_1970_NS, TICKS_NS, UNIT_OF_DIGITS, StampUnit, date_ns
from vfoa.errors import VfoaError, listed, reported_as

_FILES = re.compile(r"(?:(?:(?:frame|image|left|rgb|colou?r)_)?timestamps|times)\.(?:txt|csv)", re.IGNORECASE)
"""The name of such a file: KITTI's, and people's."""
_NUMBER = re.compile(r"[0-9]{1,19}(?:\.[0-9]{0,20})?(?:[eE][+-]?[0-9]{1,2})?")  # np.savetxt writes 18 decimals
_CELL = re.compile(rf"{DATE.pattern}|[^,;\s]+")
_UNITS: dict[str, StampUnit] = {"sec": "s", "seconds": "s", "msec": "ms", **{unit: unit for unit in TICKS_NS}}
"""Units at the end of a column's name."""
_TIMES = frozenset({"timestamp", "timestamps", "time_stamp", "time", "times", "ts", "t"})
"""Names of a column of times, without the unit."""
_ANY_TIMES = re.compile(r"(?:.+_)?time_?stamps?(?:_.+)?|t_.+")
_OF_OTHERS = frozenset({"right", "depth", "imu", "ir"})
_OF_IMAGES = frozenset({"left", "rgb", "color", "colour"})
"""Words beside such a name: of other sensors, and of the images that the times are of."""
_LONGEST_STEP_S = 5
"""Least median step of numbers that are probably no seconds, as 33.3 ms; 1000 times as much where they are dates."""


def find_times(root: Path, images: str) -> str | None:
    """The file of times in the folder of these images (a folder, a glob or a pattern), or in the one above it.

    The path is relative to ``root``, as it stands in a manifest.
    """
    folder = Path(images) if (root / images).is_dir() else Path(images).parent
    for each in dict.fromkeys((folder, folder.parent)):
        if names := [path.name for path in (root / each).glob("*") if _FILES.fullmatch(path.name)]:
            return (each / min(names, key=lambda name: ("_" in name, name))).as_posix()  # of no camera before of one
    return None


def read_times(path: Path, numbers: Collection[int]) -> dict[int, int]:
    """The time in ns of each image, from lines such as ``2011-09-26 13:02:25.964389445``, or of one number.

    Numbers are seconds with a decimal point, or s, ms, us or ns since 1970, by their digits. Beside them may be numbers
    of frames, which count by one, or names of images. Lines that begin with ``#`` are left out. Of a table it is the
    column ``timestamp`` or ``time``, or ``timestamp_ms`` in ms.

    Raises
    ------
    VfoaError
        If a line is not a time, times do not ascend, or their number is not that of the images.
    """
    lines, unit = _column_of_times(path) if path.suffix.lower() == ".csv" else (_bare_lines(path), None)
    times_ns = [_line_ns(text, unit, f"{path}:{number}") for number, text in lines]
    for (number, text), before, time_ns in zip(lines[1:], times_ns, times_ns[1:], strict=False):
        if time_ns <= before:
            raise VfoaError(f"{path}:{number}: {text!r} is not after the time before it")
    if len(lines) != len(numbers):
        raise VfoaError(f"{path}: found {len(lines)} times; expected {len(numbers)}, one for each image")
    if unit is None:
        _check_are_seconds(times_ns, path)
    return dict(zip(numbers, times_ns, strict=True))


def _check_are_seconds(times_ns: Sequence[int], path: Path) -> None:
    """Raise a :class:`VfoaError` for steps of a camera's ms or us since it was started, taken for seconds."""
    step_s = float(np.median(np.diff(times_ns))) / 1e9 if len(times_ns) > 1 else 0.0
    if step_s >= (_LONGEST_STEP_S if times_ns[0] < SINCE_1970_NS else 1000 * _LONGEST_STEP_S):
        raise VfoaError(
            f"{path}: found times that are {step_s:g} s apart (median) if they are seconds; expected less: if they are "
            "ms, say so in the name of their column, as timestamp_ms in a table timestamps.csv"
        )


def _bare_lines(path: Path) -> list[tuple[int, str]]:
    """Lines of one cell, or those of the times beside frames; other lines are whole."""
    numbered = enumerate(table_text(path).splitlines(), start=1)
    lines = [(number, text) for number, line in numbered if (text := line.strip()) and not text.startswith("#")]
    rows = [(number, [cell[0] for cell in _CELL.finditer(text)]) for number, text in lines]
    return _beside_frames(rows) or lines


def _beside_frames(rows: Sequence[tuple[int, Sequence[str]]]) -> list[tuple[int, str]] | None:
    """The times of rows of two cells whose other one is the number of a frame or the name of an image; else None."""
    if any(len(cells) != 2 for _, cells in rows):
        return None
    for time, frame in ((1, 0), (0, 1)):
        if all(_line_is_time(cells[time]) for _, cells in rows) and _are_frames([cells[frame] for _, cells in rows]):
            return [(line, cells[time]) for line, cells in rows]
    return None


def _are_frames(cells: Sequence[str]) -> bool:
    if all(Path(cell).suffix.lower() in IMAGE_SUFFIXES for cell in cells):
        return True
    return all(map(str.isdecimal, cells)) and all(int(after) - int(cell) == 1 for cell, after in pairwise(cells))


def _column_of_times(path: Path) -> tuple[list[tuple[int, str]], StampUnit | None]:
    """Lines and cells of a table's column of times, and the unit that its name says; one column may have no name."""
    lines = _bare_lines(path)
    if lines and all(_line_is_time(text) for _, text in lines[1:]):  # blanks in a date separate no columns
        is_bare = _line_is_time(lines[0][1])
        return (lines, None) if is_bare else (lines[1:], _find_column([lines[0][1]], path)[1])
    rows = table_rows(path)
    header = rows[0][1] if rows else []
    if (without_header := _beside_frames(rows)) is not None:
        return without_header, None
    place, unit = _find_column(header, path)
    for line, cells in rows:
        check_width(cells, header, f"{path}:{line}")
    return [(line, cells[place]) for line, cells in rows[1:]], unit


def _line_is_time(text: str) -> bool:
    return bool(DATE.fullmatch(text) or _NUMBER.fullmatch(text))


def _find_column(header: Sequence[str], path: Path) -> tuple[int, StampUnit | None]:
    """The place of the column of times, and the unit that its name says."""
    names = [plain_name(name).split("_") for name in header]
    units = [_UNITS.get(words[-1]) if len(words) > 1 else None for words in names]
    bare = [words[:-1] if unit else words for words, unit in zip(names, units, strict=True)]
    exact = [place for place, words in enumerate(bare) if "_".join(words) in _TIMES]
    others = [
        place for place, words in enumerate(bare) if _ANY_TIMES.fullmatch("_".join(words)) and not _OF_OTHERS & {*words}
    ]
    of_images = [place for place in others if _OF_IMAGES & {*bare[place]}]
    found = next((places for places in (exact, others, of_images) if len(places) == 1), None)
    if found is None:
        raise VfoaError(
            f"{path}: found the columns {listed(header, 8)}; expected one of them with the time of each image, as "
            "timestamp or time, with a unit after it (timestamp_ms) or without"
        )
    return found[0], units[found[0]]


def _line_ns(text: str, unit: StampUnit | None, where: str) -> int:
    with reported_as(where):
        if (since_1970 := date_ns(text)) is not None:
            return since_1970
    if _NUMBER.fullmatch(text):
        value, is_whole = Decimal(text), text.isdecimal()
        digits = len(str(int(value)))
        own = unit or UNIT_OF_DIGITS.get(digits) or (None if is_whole or digits > 10 else "s")
        if own is not None:
            return round(value * TICKS_NS[own])
    expected = "seconds with a decimal point, or a number of s, ms, us or ns since 1970"
    raise VfoaError(
        f"{where}: found {text[:60]!r}; expected date and time, such as 2011-09-26 13:02:25.964389445, "
        f"{expected if unit is None else f'or a number of {unit}'}"
    )
