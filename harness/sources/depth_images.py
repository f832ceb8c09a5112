"""Join colour and depth files to frames: by number, or by time if lists give times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.sources.media.frame_files import find_frames
from harness.sources.recordings.pairing import join
from harness.sources.recordings.topics import Place
from harness.sources.stamped_list import read_stamped_list
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthFrame:
    """The files of one frame; ``time_ns`` is None if there are only numbers."""

    colour: Path
    depth: Path
    time_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthFrames:
    """Frames by number, ascending, and a note for each kind of file that belongs to no frame."""

    by_number: dict[int, DepthFrame]
    notes: tuple[str, ...]


def find_depth_frames(folder: Path, colour: str, depth: str, tolerance_ms: float) -> DepthFrames:
    """Return the frames of two patterns of files (``rgb/*.png``), or of two lists of files with times (``rgb.txt``).

    Frames of lists are numbered from 1 by the colour images' times, at most ``tolerance_ms`` from the depth's.

    Raises
    ------
    VfoaError
        If no frame has both.
    """
    if colour.endswith(".txt") != depth.endswith(".txt"):
        raise VfoaError(f"{folder}: colour {colour!r} and depth {depth!r}: expected two lists (.txt), or none")
    if colour.endswith(".txt"):
        return _by_time(folder, colour, depth, tolerance_ms)
    colours, depths = (find_frames(folder, pattern, str(folder)) for pattern in (colour, depth))
    common = sorted(colours.keys() & depths.keys())
    if not common:
        raise VfoaError(
            f"{folder}: no frame number is in both {colour!r} ({_span(colours)}) and {depth!r} ({_span(depths)})"
        )
    notes = [
        f"{name}: {len(found) - len(common)} of {len(found)} images have no partner of the same number"
        for name, found in ((colour, colours), (depth, depths))
        if len(found) > len(common)
    ]
    frames = {n: DepthFrame(colour=colours[n], depth=depths[n], time_ns=None) for n in common}
    return DepthFrames(by_number=frames, notes=tuple(notes))


def _by_time(folder: Path, colour: str, depth: str, tolerance_ms: float) -> DepthFrames:
    words = ("rgb", "depth") if colour == depth else ("", "")  # one list of both, such as associations.txt
    lists = [read_stamped_list(folder / name, word) for name, word in zip((colour, depth), words, strict=True)]
    files = [list(found.values()) for found in lists]
    places = [[Place(stamp, 0, number, 0) for number, stamp in enumerate(found)] for found in lists]
    pairs = join(places[0], places[1], round(tolerance_ms * 1e6))
    if not pairs:
        raise VfoaError(f"{folder}: no two times of {colour} and {depth} are within {tolerance_ms:g} ms (tolerance_ms)")
    notes = [
        f"{name}: {len(found) - len(pairs)} of {len(found)} images have no partner within {tolerance_ms:g} ms"
        for name, found in zip((colour, depth), files, strict=True)
        if len(found) > len(pairs)
    ]
    frames = {
        number: DepthFrame(colour=files[0][one.offset], depth=files[1][two.offset], time_ns=one.stamp_ns)
        for number, (one, two) in enumerate(pairs, start=1)
    }
    return DepthFrames(by_number=frames, notes=tuple(notes))


def _span(files: Mapping[int, Path]) -> str:
    numbers = list(files)
    return f"{numbers[0]} to {numbers[-1]}"
