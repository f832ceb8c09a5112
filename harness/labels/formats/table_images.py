"""Images in the cells of a table: their names in place of the frame, or beside it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePath

from harness.files.dialects import Row, is_missing, plain_name
from harness.labels.formats.exchange import Exchange
from harness.labels.formats.table_times import frame_number, is_time
from harness.sources.media.frame_files import DIGITS, IMAGE_SUFFIXES
from harness.sources.media.frame_times import TICKS_NS, stamp_unit
from vfoa.errors import VfoaError

_OF_IMAGES = (
    *("image", "image_name", "image_file", "image_filename", "image_path", "image_id"),
    *("img", "img_name", "img_file", "img_path", "img_id", "frame_name", "frame_file", "frame_path"),
)
"""Names of columns of images, which may lack their suffix."""
_OF_FILES = ("filename", "file_name", "file", "file_path", "filepath", "path")


def with_frames_of_images(
    rows: Sequence[Row], meant: Sequence[str | None], exchange: Exchange, path: Path
) -> tuple[Sequence[Row], list[str]]:
    """A header and rows with a column ``frame``, of those with the names of images in it, or in place of it; notes.

    ``meant`` is what each column is known as. Names of images do not count beside other columns of frames or times.
    Of images that are named by times, as those of a recording, and not by the clip's frames, the column is ``time_ns``.

    Raises
    ------
    VfoaError
        If a name in a column of images is none of an image with a number, or the names do not differ in one number.
    """
    (line, header), *lines = rows
    if "frame" in meant:
        place, is_short = meant.index("frame"), False
    elif any(is_time(name) or (name and name.endswith("_frame")) for name in meant):
        return rows, []
    elif (found := _column_of_images(header)) is not None:
        place, is_short = found
    else:
        return rows, []
    names, column = {cells[place] for _, cells in lines if not is_missing(cells[place])}, "frame"
    notes = list[str]()
    if all(frame_number(name) is not None for name in names):
        numbers = {name: name for name in names}
    elif all(_is_image(name, is_short=is_short) for name in names):
        frames, notes = _frames_of(names, exchange, f"{path}: {header[place]}")
        numbers, unit = {name: str(frame) for name, frame in frames.items()}, stamp_unit(frames.values())
        if unit is not None and not {*frames.values()} <= {*exchange.frames} and not any(map(is_time, meant)):
            column, numbers = "time_ns", {name: str(int(n) * TICKS_NS[unit]) for name, n in numbers.items()}
    elif "frame" not in meant and (is_short or any(_is_image(name, is_short=False) for name in names)):
        at, wrong = next((at, cells[place]) for at, cells in lines if not _is_image(cells[place], is_short=is_short))
        raise VfoaError(
            f"{path}:{at}: {header[place]}: found {wrong[:40]!r}; expected the name of an image with its number in "
            "each row, such as frame_0001.png"
        )
    else:
        return rows, []
    header = [*header[:place], column, *header[place + 1 :]]
    of_frames = [(at, [*cells[:place], numbers.get(cells[place], ""), *cells[place + 1 :]]) for at, cells in lines]
    return [(line, header), *of_frames], notes


def check_images(rows: Sequence[Row], meant: Sequence[str | None], exchange: Exchange, path: Path) -> None:
    """Reject a frame beside the name of another frame's image, where a clip's frames have the numbers of its images.

    Those of a film, or at a given rate, may be counted from another beginning than its pictures.

    Raises
    ------
    VfoaError
        With the first such row.
    """
    (_, header), *lines = rows
    found = _column_of_images(header)
    if "frame" not in meant or found is None:
        return
    (at, is_short), frame = found, meant.index("frame")
    names = {cells[at] for _, cells in lines if not is_missing(cells[at])}
    if not all(_is_image(name, is_short=is_short) and frame_number(name) is None for name in names):
        return
    try:
        of_images, _ = _frames_of(names, exchange, f"{path}: {header[at]}")
    except VfoaError:  # the names have no numbers of frames
        return
    own_numbers = {*exchange.frames}
    both = [
        (line, number, cells[at])
        for line, cells in lines
        if (number := frame_number(cells[frame])) is not None and of_images.get(cells[at]) in own_numbers
    ]
    is_shifted = (exchange.films or exchange.fps) and len({number - of_images[name] for _, number, name in both}) == 1
    for line, number, name in [] if is_shifted else both:
        if number != of_images[name]:
            raise VfoaError(
                f"{path}:{line}: {header[frame]} and {header[at]}: found {number} and {name}, which is that of frame "
                f"{of_images[name]}; expected the same frame, or one of the two columns"
            )


def _column_of_images(header: Sequence[str]) -> tuple[int, bool] | None:
    """The place of the only column of images, and whether their suffix may be missing; None if there is no such one."""
    places = [at for at, name in enumerate(header) if plain_name(name) in (*_OF_IMAGES, *_OF_FILES)]
    return (places[0], plain_name(header[places[0]]) in _OF_IMAGES) if len(places) == 1 else None


def _frames_of(names: Iterable[str], exchange: Exchange, where: str) -> tuple[dict[str, int], list[str]]:
    """The frame of each image by its present name, and notes; raises as :meth:`Exchange.frames_of_images`."""
    own = _before_upload(names)
    frames, notes = exchange.frames_of_images({*own.values()}, where)
    return {name: frames[before] for name, before in own.items()}, notes


_UPLOADED = re.compile(r"(?<![^/])([0-9a-f]{8})-(?=[^/]+$)")
"""What Label Studio puts before the name of each image that is uploaded; dates have digits alone."""


def _before_upload(names: Iterable[str]) -> dict[str, str]:
    """The names of images before their upload to Label Studio, by those that they have now."""
    found = {name: _UPLOADED.search(name) for name in names}
    is_uploaded = all(found.values()) and any(match and not match[1].isdecimal() for match in found.values())
    return {name: _UPLOADED.sub("", name) if is_uploaded else name for name in found}


def _is_image(name: str, *, is_short: bool) -> bool:
    """Whether it is the name of an image with a number; ``is_short``: the suffix may be missing."""
    plain = PurePath(name)
    return bool(DIGITS.search(plain.stem)) and plain.suffix.lower() in (*IMAGE_SUFFIXES, *([""] if is_short else []))
