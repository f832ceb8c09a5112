"""The times of images in a file beside them: a line for each, or a column of a table."""

from __future__ import annotations

import re
from collections.abc import Collection
from decimal import Decimal
from pathlib import Path

import numpy as np

from harness.files.dialects import check_width, plain_name, table_rows
from harness.files.io import read_text
from harness.sources.media.frame_files import TICKS_NS, StampUnit
from vfoa.errors import VfoaError, listed, reported_as

NAMES = ("timestamps.txt", "times.txt", "timestamps.csv", "times.csv")
"""Names of such a file: KITTI's, and people's."""

_TIME = re.compile(r"(?:19|20|21)[0-9]{2}-[0-9]{2}-[0-9]{2}[ T][0-9]{2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?")
_SECONDS = re.compile(r"[0-9]{1,10}\.[0-9]{0,12}(?:[eE][+-]?[0-9]{1,2})?")
_NUMBER = re.compile(r"[0-9]{1,19}(?:\.[0-9]{0,12})?")
_TIMES = re.compile(r"(?:time_?stamps?|times?)(?:_(?P<unit>s|ms|us|ns))?")
"""The name of a column of times."""
_UNIT_OF_DIGITS: dict[int, StampUnit] = {10: "s", 13: "ms", 16: "us", 19: "ns"}
"""The unit of a whole number that is a time since 1970, by its digits."""


def find_times(root: Path, images: str) -> str | None:
    """The file of times in the folder of these images (a folder, a glob or a pattern), or in the one above it.

    The path is relative to ``root``, as it stands in a manifest.
    """
    folder = Path(images) if (root / images).is_dir() else Path(images).parent
    files = [each / name for each in dict.fromkeys((folder, folder.parent)) for name in NAMES]
    return next((file.as_posix() for file in files if (root / file).is_file()), None)


def read_times(path: Path, numbers: Collection[int]) -> dict[int, int]:
    """The time in ns of each image, from lines such as ``2011-09-26 13:02:25.964389445``, or of one number.

    Numbers with a decimal point are seconds; whole numbers s, ms, us or ns since 1970, by their digits. Lines that
    begin with ``#`` are left out. Of a table it is the column ``timestamp`` or ``time``, or ``timestamp_ms`` in ms.

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
    return dict(zip(numbers, times_ns, strict=True))


def _bare_lines(path: Path) -> list[tuple[int, str]]:
    lines = enumerate(read_text(path).splitlines(), start=1)
    return [(number, text) for number, line in lines if (text := line.strip()) and not text.startswith("#")]


def _column_of_times(path: Path) -> tuple[list[tuple[int, str]], StampUnit | None]:
    """Lines and cells of a table's column of times, and the unit that its name says; one column may have no name."""
    rows = table_rows(path)
    header = rows[0][1] if rows else []
    named = [(place, match) for place, name in enumerate(header) if (match := _TIMES.fullmatch(plain_name(name)))]
    if not named and len(header) == 1:
        return [(line, cells[0]) for line, cells in rows], None
    if len(named) != 1:
        raise VfoaError(
            f"{path}: found the columns {listed(header, 8)}; expected one of them with the time of each image, as "
            "timestamp or time, with a unit after it (timestamp_ms) or without"
        )
    ((place, match),) = named
    for line, cells in rows:
        check_width(cells, header, f"{path}:{line}")
    unit = match["unit"]
    return [(line, cells[place]) for line, cells in rows[1:]], next((each for each in TICKS_NS if each == unit), None)


def _line_ns(text: str, unit: StampUnit | None, where: str) -> int:
    if _TIME.fullmatch(text):
        with reported_as(where):
            return int(np.datetime64(text, "ns").astype(np.int64))
    if unit is not None and _NUMBER.fullmatch(text):
        return round(Decimal(text) * TICKS_NS[unit])
    if unit is None and _SECONDS.fullmatch(text):
        return round(Decimal(text) * 10**9)
    by_digits = _UNIT_OF_DIGITS.get(len(text))
    if unit is not None or by_digits is None or not (text.isascii() and text.isdecimal()):
        expected = "seconds with a decimal point, or a whole number of s, ms, us or ns since 1970"
        raise VfoaError(
            f"{where}: found {text[:60]!r}; expected date and time, such as 2011-09-26 13:02:25.964389445, "
            f"{expected if unit is None else f'or a number of {unit}'}"
        )
    return int(text) * TICKS_NS[by_digits]
